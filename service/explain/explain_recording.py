"""``explain_one``: read and fit a recording, train a network on it, and find what S and J leave
out.

The content of a recording never raises an error: one that cannot be read or fitted gives a mismatch
that was not testable, with the reason.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace
from importlib import import_module
from typing import TYPE_CHECKING

from stemwatch.connectors.connector import ConnectorError
from stemwatch.models.decision.no_verdict import MORE
from stemwatch.models.limits import Limits
from stemwatch.models.mismatch.findings import Finding, Mismatch, Stiction
from stemwatch.models.recording import Recording
from stemwatch.models.verdict import NoVerdict
from stemwatch.service.explain.requested_recordings import RecordingToExplain
from stemwatch.service.presenter.evidence_of_weeks import EvidenceOfWeeks
from stemwatch.service.presenter.wording import signals_read
from stemwatch.service.run.task import recording_of

if TYPE_CHECKING:
    from stemwatch.models.screening_result import Screening
    from stemwatch.models.stickslip.stroke_curve import KnownCurve

# Where the position tells nothing of the stem, and so nothing of what S and J leave out.
HIDES_THE_STEM = (
    NoVerdict.POSITION_FROZEN,
    NoVerdict.POSITION_STILL,
    NoVerdict.POSITION_SUMS_OP,
    NoVerdict.BAD_SAMPLES,
)


@dataclass(frozen=True, kw_only=True)
class Explained:
    """One valve's recording and what was found; ``recording`` is ``None`` where none was read.

    ``by_window`` is set where a long recording was explained as several windows.
    """

    source: str  # the path as it was given
    valve: str
    mismatch: Mismatch
    recording: Recording | None = None
    by_window: EvidenceOfWeeks | None = None

    @property
    def signals_read(self) -> str:
        """The tags that were read and which were not; empty where nothing was read."""
        signals = {} if self.recording is None else self.recording.signals
        return signals_read({role: signal.tag for role, signal in signals.items()})


@dataclass(frozen=True, kw_only=True)
class Job:
    """One recording to be explained, as it is sent to a worker."""

    to_explain: RecordingToExplain
    narx: bool = True  # train the network that shows how much of the residual is systematic
    limits: Limits = field(default_factory=Limits)


def explain_one(job: Job) -> Explained:
    """The explanation of one valve in one source; never raises for what the source holds."""
    to_explain = job.to_explain
    if to_explain.task is None or to_explain.reason:
        return _not_explained(to_explain, to_explain.reason)
    try:
        recording = recording_of(to_explain.task)
    except ConnectorError as error:
        return _not_explained(to_explain, str(error))
    except (OSError, ValueError, MemoryError) as error:
        return _not_explained(to_explain, f"{to_explain.source}: {type(error).__name__}: {error}")
    return explain_recording(
        recording,
        to_explain.source,
        narx=job.narx,
        limits=job.limits,
        known_curve=to_explain.task.given_curve,
    )


def explain_recording(
    recording: Recording,
    source: str,
    *,
    narx: bool = True,
    limits: Limits | None = None,
    known_curve: KnownCurve | None = None,
) -> Explained:
    """The explanation of a recording that was read; never raises for what it holds.

    A long one is explained as several windows (``models.history.explained_windows``), each of as
    many samples as a screening fits. ``known_curve`` is how OP strokes the valve, where the plant
    file says it.
    """
    from stemwatch.models.preparation.loop_pace import at_loop_pace
    from stemwatch.models.stickslip.stored_range import in_percent

    by_window, limits = None, limits or Limits()
    try:
        # Prepared as in a screening, so that the pictures fit the runs of the models.
        as_stored = recording
        recording = at_loop_pace(in_percent(as_stored), round(limits.fitted_samples))
        mismatch, by_window = _explained(as_stored, recording, narx, limits, known_curve)
    except Exception as error:  # one valve must not end the others
        reason = f"the search broke down on this recording ({type(error).__name__}: {error})."
        mismatch = Mismatch.unknown(reason)
    return Explained(
        source=source,
        valve=recording.valve,
        mismatch=mismatch,
        recording=recording,
        by_window=by_window,
    )


def _not_explained(to_explain: RecordingToExplain, reason: str) -> Explained:
    mismatch = Mismatch.unknown(reason or "there is nothing to explain")
    return Explained(source=to_explain.source, valve=to_explain.valve, mismatch=mismatch)


def _explained(
    as_stored: Recording,
    recording: Recording,
    narx: bool,
    limits: Limits,
    known_curve: KnownCurve | None,
) -> tuple[Mismatch, EvidenceOfWeeks | None]:
    """The mismatch of a recording, resampled to the pace of its loop, and for a long recording what
    its windows say together. S and J are always those of the verdict."""
    from stemwatch.models.history.explained_windows import explain_windows

    samples = round(limits.fitted_samples)
    uncut = replace(limits, fitted_samples=float(max(len(recording), samples)))

    def explain_alone(part: Recording) -> Mismatch:
        return _mismatch(part, False, uncut, known_curve)

    def explain_shown(part: Recording) -> Mismatch:
        return _mismatch(part, True, uncut, known_curve)

    evidence_windows = explain_windows(
        recording, samples, explain_alone, explain_shown if narx else None
    )
    if evidence_windows is None:
        return _mismatch(as_stored, narx, limits, known_curve), None
    evidence = EvidenceOfWeeks(
        windows=evidence_windows.windows,
        findings=evidence_windows.findings,
        pooled=evidence_windows.pooled,
        recording_began=evidence_windows.began,
        by_whole=evidence_windows.by_whole,
    )
    sentences = list(evidence.sentences())
    if evidence_windows.shown is not None:
        begin = evidence_windows.shown.first * recording.interval_s / 3600.0
        hours = evidence_windows.shown.length * recording.interval_s / 3600.0
        position_text = (
            f"What follows is of the window of {hours:.3g} h that begins after {begin:.3g} h."
        )
        sentences.append(position_text)
    mismatch = evidence_windows.mismatch
    verdict = _screened(as_stored, False, limits, known_curve)
    return replace(
        mismatch,
        sentence=" ".join((*sentences, mismatch.sentence)),
        restated=Stiction(S=verdict.S, J=verdict.J),
    ), evidence


def _mismatch(
    recording: Recording, narx: bool, limits: Limits, known_curve: KnownCurve | None
) -> Mismatch:
    """The mismatch from the recording's screening, with the same S and J. Where the screening
    cannot judge the recording: the reason, and what can be tested nevertheless."""
    from stemwatch.models.mismatch.explain import explain

    if narx:
        import_module("stemwatch.models.narx.training")  # so that timing excludes the import
    started = time.perf_counter()
    screening = _screened(recording, narx, limits, known_curve)
    mismatch = screening.mismatch
    if mismatch is None:
        as_read = screening.recording or recording
        mismatch = explain(as_read, look_for_curve=known_curve is None)
        mismatch = _without_verdict(screening, mismatch)
    return replace(mismatch, seconds=time.perf_counter() - started)


def _screened(
    recording: Recording, narx: bool, limits: Limits, known_curve: KnownCurve | None
) -> Screening:
    from stemwatch.models.screening.screen import Case, Options, screen

    case = Case(recording=recording, known_curve=known_curve)
    (screening,) = screen([case], Options(limits=limits, narx=narx))
    return screening


def _without_verdict(screening: Screening, mismatch: Mismatch) -> Mismatch:
    """The mismatch of a recording that cannot be judged.

    A compressing archive, and a flow in place of the position, hide no more than is stated. A
    position that is frozen, mostly missing, or really a commanded speed allows no finding. The
    finding that nothing was left out is allowed only behind a compressing archive.
    """
    compressed = any(effect.slug == "historian_compression" for effect in mismatch.record_effects)
    reason = _with_all_obstacles(screening)
    told = f"{reason} {screening.advice}"
    untold = screening.no_verdict in HIDES_THE_STEM
    if untold or (mismatch.finding is Finding.NONE and not compressed):
        return Mismatch.unknown(told)
    if mismatch.finding is not Finding.NOT_TESTABLE:
        told = f"No verdict. {reason} {mismatch.sentence}"
    return replace(mismatch, sentence=told)


def _with_all_obstacles(screening: Screening) -> str:
    """The reason with the obstacles that it only counts: an explanation has no data quality."""
    others = screening.quality.reasons[1:]
    for count in range(1, len(others) + 1):
        if MORE.format(count) in screening.reason:
            return f"{screening.reason} Data quality: {'; '.join(others[:count])}."
    return screening.reason
