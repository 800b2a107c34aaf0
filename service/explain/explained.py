"""``explain_one``: read a recording, fit it, train its ceiling, and ask what S and J leave out.

Nothing raises for what a recording holds: one that cannot be read or fitted is a mismatch that
was not testable, with the reason.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace
from importlib import import_module
from typing import TYPE_CHECKING

from stemwatch.connectors.connector import ConnectorError
from stemwatch.models.limits import Limits
from stemwatch.models.mismatch.findings import Mismatch
from stemwatch.models.recording import Floats, Recording
from stemwatch.service.explain.to_explain import ToExplain
from stemwatch.service.presenter.evidence_of_weeks import EvidenceOfWeeks
from stemwatch.service.run.task import recording_of

if TYPE_CHECKING:
    from stemwatch.models.stickslip.fit import StickSlipFit
    from stemwatch.models.stickslip.stroke_curve import KnownCurve, StrokeCurve


@dataclass(frozen=True, kw_only=True)
class Explained:
    """One valve's recording and what was found; ``recording`` is ``None`` where none was read.

    ``by_window`` is there where a long recording was explained as several windows.
    """

    source: str  # the path as it was given
    valve: str
    mismatch: Mismatch
    recording: Recording | None = None
    by_window: EvidenceOfWeeks | None = None


@dataclass(frozen=True, kw_only=True)
class Job:
    """One recording to be explained, as it is sent to a worker."""

    to_explain: ToExplain
    narx: bool = True  # train the network that says how much is systematic at all
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

    A long one is explained as several windows (``models.explained_windows``), each of as many
    samples as a screening fits. ``known_curve`` is how OP strokes the valve, where the plant file
    says it.
    """
    from stemwatch.models.loop_pace import at_loop_pace
    from stemwatch.models.stickslip.stored_range import in_percent

    by_window, limits = None, limits or Limits()
    try:
        # As a screening reads it; what is drawn beside the runs is so, too.
        recording = at_loop_pace(in_percent(recording), round(limits.fitted_samples))
        mismatch, by_window = _explained(recording, narx, limits, known_curve)
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


def _not_explained(to_explain: ToExplain, reason: str) -> Explained:
    mismatch = Mismatch.unknown(reason or "there is nothing to explain")
    return Explained(source=to_explain.source, valve=to_explain.valve, mismatch=mismatch)


def _explained(
    recording: Recording, narx: bool, limits: Limits, known_curve: KnownCurve | None
) -> tuple[Mismatch, EvidenceOfWeeks | None]:
    """The mismatch of a recording, and what its windows say together where it is a long one."""
    from stemwatch.models.explained_windows import explain_windows

    def explain_alone(part: Recording) -> Mismatch:
        return _mismatch(part, False, limits, known_curve)

    def explain_shown(part: Recording) -> Mismatch:
        return _mismatch(part, True, limits, known_curve)

    samples = round(limits.fitted_samples)
    evidence_windows = explain_windows(
        recording, samples, explain_alone, explain_shown if narx else None
    )
    if evidence_windows is None:
        return _mismatch(recording, narx, limits, known_curve), None
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
    sentence = " ".join((*sentences, evidence_windows.mismatch.sentence))
    return replace(evidence_windows.mismatch, sentence=sentence), evidence


def _mismatch(
    recording: Recording, narx: bool, limits: Limits, known_curve: KnownCurve | None
) -> Mismatch:
    from stemwatch.models.mismatch.explain import explain
    from stemwatch.models.own_clock import on_own_clock
    from stemwatch.models.quality import assess
    from stemwatch.models.stickslip.find_stroke_curve import stroke_curve_of
    from stemwatch.models.stickslip.fit import fit_stickslip
    from stemwatch.models.stickslip.stored_range import in_percent
    from stemwatch.models.stickslip.stroke_curve import in_travel

    if narx:
        import_module("stemwatch.models.narx.training")  # torch's two seconds are not the valve's
    started, recording = time.perf_counter(), on_own_clock(in_percent(recording))
    assessment = assess(recording, limits)
    masked, ceiling, curve = assessment.recording, None, None
    if not assessment.obstacles:
        curve, _ = stroke_curve_of(masked, known_curve)
        if narx:
            ceiling = _ceiling(masked, fit_stickslip(in_travel(masked, curve)), curve)
    # As it was read: record effects come first.
    mismatch = explain(recording, ceiling=ceiling, curve=curve, look_for_curve=known_curve is None)
    return replace(mismatch, seconds=time.perf_counter() - started)


def _ceiling(recording: Recording, fit: StickSlipFit, curve: StrokeCurve | None) -> Floats | None:
    """(n,) free run of the valve's network, ``None`` where it could not be trained."""
    from stemwatch.models.narx.example import NarxExample
    from stemwatch.models.narx.training import train  # torch takes two seconds to import
    from stemwatch.models.screening import network_start

    example = NarxExample.of(recording, fit.first_heldout, network_start(fit, curve))
    try:
        (network,) = train([example])
    except Exception:  # without its ceiling the explanation is as good
        return None
    return network.simulated
