"""A long recording explained as several windows: each is a search of its own, and they must agree.

    recording -> at most MOST windows in which OP moves most -> each explained alone
              -> what two of them agree on, or one names and the silent ones gain by -> S, J pooled

One search over eight hours costs as much as eight over one hour each, and a poor optimum spoils one
window, not the record. A record of so many samples that it has fewer than ``FEWEST`` windows is
explained in one piece.

An effect that shows in few places of each hour, such as play, is found better in eight hours. Where
the windows agree on nothing and yet gain by some effect together, the record is therefore also
explained as a whole, if it is no longer than the windows together. An effect named there counts
where the windows gain by it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta

from stemwatch.models.history.evidence_over_windows import (
    AGREE,
    MEMORY,
    FindingState,
    LastingFinding,
    WindowEvidence,
    gain_together,
    lasting_findings,
    pooled_stiction,
)
from stemwatch.models.mismatch.findings import Finding, Mismatch, Stiction
from stemwatch.models.preparation.fit_window import FitWindow, windows_with_most_movement
from stemwatch.models.recording import Recording

MOST, FEWEST = MEMORY, 4
# For a recording without dates: only the order and the distance of the windows matter.
NO_DATE = datetime(2000, 1, 1, tzinfo=UTC)


@dataclass(frozen=True, kw_only=True)
class ExplainedWindows:
    """The windows of one recording taken together.

    ``mismatch`` is that of window ``shown``, the first that names exactly the confirmed effects, on
    the clock of the whole recording; its p value is the smallest of the confirmed effects.
    ``pooled`` are S and J, where at least two windows name exactly these. ``findings`` begin with
    those that hold; ``windows`` is the evidence of each, on a clock that ``began`` with the
    recording. ``by_whole`` are the effects that hold because the recording as a whole names them
    and the windows gain by them: ``mismatch`` is then that of the whole, and ``shown`` is ``None``.
    """

    mismatch: Mismatch
    began: datetime
    shown: FitWindow | None
    windows: tuple[WindowEvidence, ...]
    findings: tuple[LastingFinding, ...]
    pooled: Stiction | None = None
    by_whole: tuple[str, ...] = ()


Explain = Callable[[Recording], Mismatch]


def explain_windows(
    recording: Recording, samples: int, explain: Explain, shown_by: Explain | None = None
) -> ExplainedWindows | None:
    """The windows of ``recording``, of ``samples`` samples and a little more, explained and taken
    together; ``None`` where it has fewer than ``FEWEST``.

    ``explain`` explains a part of it, and ``shown_by`` once more the one that is shown, where that
    may cost more.
    """
    windows = windows_with_most_movement(recording, samples, MOST)
    if len(windows) < FEWEST:
        return None
    explanations = [explain(recording.part(window.first, window.last)) for window in windows]
    evidence = tuple(
        _evidence(recording, window, mismatch)
        for window, mismatch in zip(windows, explanations, strict=True)
    )
    findings = lasting_findings(evidence)
    holding = [finding.slug for finding in findings if finding.holds]
    seconds = sum(mismatch.seconds for mismatch in explanations)
    suspected = _suspected(evidence)
    if suspected and not holding and len(recording) // samples <= MOST:
        whole_mismatch = explain(recording)
        seconds += whole_mismatch.seconds
        if whole_mismatch.defects and all(
            set(effect.members) & suspected for effect in whole_mismatch.defects
        ):
            whole_mismatch = replace(whole_mismatch, seconds=seconds)
            return _as_whole(
                whole_mismatch, _start_of_recording(recording), evidence, findings, suspected
            )
    best = _window_to_show(explanations, evidence, holding)
    # Where nothing is named, an effect in a single window still biases its S and J.
    clear = bool(holding) or all(mismatch.finding is Finding.NONE for mismatch in explanations)
    pooled = pooled_stiction(evidence, findings) if clear else None
    shown_window = windows[best]
    mismatch = explanations[best]
    if shown_by is not None:
        mismatch = shown_by(recording.part(shown_window.first, shown_window.last))
        seconds += mismatch.seconds
    runs = mismatch.runs
    mismatch = replace(
        mismatch,
        runs=None if runs is None else runs.within(shown_window.first, len(recording)),
        p_value=min(
            (finding.p_value for finding in findings if finding.holds), default=mismatch.p_value
        ),
        seconds=seconds,
    )
    return ExplainedWindows(
        mismatch=mismatch,
        began=_start_of_recording(recording),
        shown=shown_window,
        windows=evidence,
        findings=findings,
        pooled=pooled,
    )


def _suspected(evidence: Sequence[WindowEvidence]) -> set[str]:
    """The effects by which the windows gain together, or that two of them name."""
    scored_slugs = {score.slug for window in evidence for score in window.scores}
    named = {slug: sum(window.names(slug) for window in evidence) for slug in scored_slugs}
    return {slug for slug in scored_slugs if named[slug] >= AGREE or gain_together(slug, evidence)}


def _as_whole(
    whole_mismatch: Mismatch,
    recording_began: datetime,
    evidence: tuple[WindowEvidence, ...],
    findings: Sequence[LastingFinding],
    suspected: set[str],
) -> ExplainedWindows:
    """The effects that the recording as a whole names and by which, or by one that cannot be
    separated from it, the windows gain.
    """
    slugs = tuple(
        next(slug for slug in (effect.slug, *effect.members) if slug in suspected)
        for effect in whole_mismatch.defects
    )
    confirmed = tuple(_by_whole(slug, whole_mismatch, evidence) for slug in slugs)
    others = tuple(finding for finding in findings if finding.slug not in slugs)
    return ExplainedWindows(
        mismatch=whole_mismatch,
        began=recording_began,
        shown=None,
        windows=evidence,
        findings=(*confirmed, *others),
        by_whole=slugs,
    )


def _by_whole(
    slug: str, whole_mismatch: Mismatch, evidence: Sequence[WindowEvidence]
) -> LastingFinding:
    looked = [window for window in evidence if window.looked_for(slug)]
    return LastingFinding(
        slug=slug,
        state=FindingState.CONFIRMED,
        first_seen=looked[0].at,
        last_seen=looked[-1].at,
        confirmed=looked[-1].at,
        named=sum(window.names(slug) for window in looked),
        of=len(looked),
        p_value=1.0 if whole_mismatch.p_value is None else whole_mismatch.p_value,
    )


def _start_of_recording(recording: Recording) -> datetime:
    return recording.start or NO_DATE


def _evidence(recording: Recording, window: FitWindow, mismatch: Mismatch) -> WindowEvidence:
    start, window_end = (
        _start_of_recording(recording) + timedelta(seconds=sample * recording.interval_s)
        for sample in (window.first, window.last)
    )
    return WindowEvidence.of(mismatch, window_end, start=start)


def _window_to_show(
    mismatches: Sequence[Mismatch], evidence: Sequence[WindowEvidence], holding: Sequence[str]
) -> int:
    """The window whose defects are nearest to those that hold and, among these, whose finding most
    others share; the first of equals.
    """

    def differences(index: int) -> int:
        missing = sum(not evidence[index].names(slug) for slug in holding)
        not_confirmed = sum(not set(members) & set(holding) for members in evidence[index].named)
        return missing + 2 * not_confirmed

    nearest = min(map(differences, range(len(mismatches))))
    closest_windows = [index for index in range(len(mismatches)) if differences(index) == nearest]
    counts = [
        sum(mismatches[other].finding is mismatches[index].finding for other in closest_windows)
        for index in closest_windows
    ]
    return closest_windows[counts.index(max(counts))]
