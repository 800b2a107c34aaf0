"""A long recording explained as several windows: each is a search of its own, and they must agree.

    recording -> at most MOST windows in which OP moves most -> each explained alone
              -> what two of them agree on, or one names and the others gain by -> S, J pooled

One search over eight hours costs as much and finds less than eight over one hour each (see
``docs/explain.md``): a poor optimum spoils one window, not the record. A record of so many samples
that it has fewer than ``FEWEST`` windows is explained in one piece.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta

from stemwatch.models.evidence_over_windows import (
    MEMORY,
    LastingFinding,
    WindowEvidence,
    lasting_findings,
    pooled_stiction,
)
from stemwatch.models.fit_window import FitWindow, telling_windows
from stemwatch.models.mismatch.findings import Finding, Mismatch, Stiction
from stemwatch.models.recording import Recording

MOST, FEWEST = MEMORY, 4
# Where a recording has no dates: only the order and the distance of the windows matter.
NO_DATE = datetime(2000, 1, 1, tzinfo=UTC)


@dataclass(frozen=True, kw_only=True)
class ExplainedWindows:
    """What the windows of one recording say together.

    ``mismatch`` is that of window ``shown``, the first that names just what they agree on, on the
    clock of the whole recording and with the ``pooled`` S and J, where at least two name just that.
    Its p value is the smallest of what holds. ``findings`` are those that hold first; ``windows``
    what each said, on a clock that ``began`` with the recording.
    """

    mismatch: Mismatch
    began: datetime
    shown: FitWindow
    windows: tuple[WindowEvidence, ...]
    findings: tuple[LastingFinding, ...]
    pooled: Stiction | None


def explain_windows(
    recording: Recording,
    samples: int,
    explain: Callable[[Recording], Mismatch],
    shown_by: Callable[[Recording], Mismatch] | None = None,
) -> ExplainedWindows | None:
    """The windows of ``recording``, of ``samples`` samples and a little more, explained and taken
    together; ``None`` where it has fewer than ``FEWEST``.

    ``explain`` explains a part of it, and ``shown_by`` once more the one that is shown, where that
    may cost more.
    """
    windows = telling_windows(recording, samples, MOST)
    if len(windows) < FEWEST:
        return None
    explanations = [explain(recording.part(window.first, window.last)) for window in windows]
    evidence = [
        _evidence(recording, window, one) for window, one in zip(windows, explanations, strict=True)
    ]
    findings = lasting_findings(evidence)
    holding = [finding.slug for finding in findings if finding.holds]
    best = _shown(explanations, evidence, holding)
    # What is left unexplained bends S and J in each window its own way.
    known = [
        one
        for one, mismatch_of_window in zip(evidence, explanations, strict=True)
        if mismatch_of_window.finding is not Finding.UNKNOWN
    ]
    pooled = pooled_stiction(known, findings)
    shown_window = windows[best]
    mismatch = explanations[best]
    if shown_by is not None:
        mismatch = shown_by(recording.part(shown_window.first, shown_window.last))
    if pooled is not None and mismatch.finding is not Finding.UNKNOWN:
        mismatch = replace(mismatch, restated=pooled)
    runs = mismatch.runs
    mismatch = replace(
        mismatch,
        runs=None if runs is None else runs.within(shown_window.first, len(recording)),
        p_value=min((one.p_value for one in findings if one.holds), default=mismatch.p_value),
        seconds=sum(one.seconds for one in explanations) + (mismatch.seconds if shown_by else 0.0),
    )
    return ExplainedWindows(
        mismatch=mismatch,
        began=_began(recording),
        shown=shown_window,
        windows=tuple(evidence),
        findings=findings,
        pooled=pooled,
    )


def _began(recording: Recording) -> datetime:
    return recording.start or NO_DATE


def _evidence(recording: Recording, window: FitWindow, mismatch: Mismatch) -> WindowEvidence:
    start, at = (
        _began(recording) + timedelta(seconds=sample * recording.interval_s)
        for sample in (window.first, window.last)
    )
    return WindowEvidence.of(mismatch, at, start=start)


def _shown(
    mismatches: Sequence[Mismatch], evidence: Sequence[WindowEvidence], holding: Sequence[str]
) -> int:
    """The window whose defects are most nearly those that hold, and whose finding most others of
    these share; the first of equals."""

    def apart(place: int) -> int:
        missing = sum(not evidence[place].names(slug) for slug in holding)
        beyond = sum(not set(members) & set(holding) for members in evidence[place].named)
        return missing + 2 * beyond

    nearest = min(map(apart, range(len(mismatches))))
    alike = [index for index in range(len(mismatches)) if apart(index) == nearest]
    counts = [
        sum(mismatches[other].finding is mismatches[index].finding for other in alike)
        for index in alike
    ]
    return alike[counts.index(max(counts))]
