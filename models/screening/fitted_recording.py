"""A recording as it is fitted: assessed, its part with the most movement, S and J of that part.

    recording -> quality -> stretch -> command -> stick-slip fit -> archive -> interval

A recording with an obstacle is assessed and no more.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

from stemwatch.models.decision.shaken_loose import dead_bands_of, without_slow_actuator
from stemwatch.models.limits import Limits
from stemwatch.models.mismatch.measurement.between_samples import Archive, as_sampled
from stemwatch.models.preparation.fit_window import FitWindow, choose_fit_window
from stemwatch.models.preparation.loop_pace import at_loop_pace
from stemwatch.models.preparation.own_clock import on_own_clock
from stemwatch.models.record_checks.quality import Assessment, assess, with_obstacles
from stemwatch.models.recording import Recording
from stemwatch.models.screening.prepared_command import PreparedCommand, prepare_command
from stemwatch.models.signals.dead_band import DeadBand
from stemwatch.models.stickslip.fit import StickSlipFit, fit_stickslip
from stemwatch.models.stickslip.interval import StickSlipSample, bootstrap
from stemwatch.models.stickslip.parameters import S_and_J
from stemwatch.models.stickslip.stored_range import in_percent
from stemwatch.models.stickslip.stroke_curve import KnownCurve, StrokeCurve


@dataclass(frozen=True, kw_only=True)
class AssessedRecording:
    """A recording that has been assessed, and its command prepared where nothing was in the way.

    ``whole`` is all of it, in percent and seconds, at the pace of its loop. ``recording`` is what
    is to be fitted, on its own clock: all of it, or its ``stretch``; ``masked`` the same without
    what record effects spoilt.
    """

    whole: Recording
    assessment: Assessment  # of the whole recording, on its own clock
    recording: Recording
    masked: Recording
    stretch: FitWindow | None = None
    late_s: float = 0.0  # by which OP was shifted earlier in ``masked``
    perhaps_exchanged: bool = False  # OP seems late, and may as well be the position
    within_steps: bool = False  # OP was reconstructed within its coarse steps from PV and set point
    curve: StrokeCurve | None = None
    curve_changed: str = ""  # how it differs from the known curve, or empty
    seconds: float = 0.0


@dataclass(frozen=True, kw_only=True)
class FittedRecording(AssessedRecording):
    """A recording with its S and J: ``fit`` and ``sample`` are in percent of travel where there is
    a ``curve`` from OP to stroke, else in percent of OP, which is then the same.
    """

    fit: StickSlipFit
    sample: StickSlipSample
    archive: Archive | None
    dead_bands: tuple[DeadBand, ...]  # of a slow archive, see ``decision.shaken_loose``

    @property
    def op_per_travel(self) -> float:
        """Percent of OP for a percent of travel."""
        return 1.0 if self.curve is None else 1.0 / abs(self.curve.slope)

    @property
    def S_alone(self) -> float:
        """S of S and J alone, without an actuator beside them, percent of OP."""
        return S_and_J(self.fit.naive)[0] * self.op_per_travel

    @property
    def missed(self) -> float:
        """By how much S and J are too small because the archive lost peaks of OP, percent of
        travel."""
        if self.archive is None:
            return 0.0
        evaluator = self.fit.evaluator
        return self.archive.missed_by(evaluator.problem, evaluator.simulate(self.fit.candidate))


def fit_recording(
    as_read: Recording, known_curve: KnownCurve | None, limits: Limits
) -> AssessedRecording:
    """The recording, assessed; a ``FittedRecording`` where nothing is in the way."""
    started = time.perf_counter()
    whole = at_loop_pace(in_percent(as_read), round(limits.fitted_samples))
    recording = on_own_clock(whole)
    assessment = assess(recording, limits)
    assessed = AssessedRecording(
        whole=whole, assessment=assessment, recording=recording, masked=assessment.recording
    )
    if not assessment.obstacles:
        assessed = _fit_part(assessed, known_curve, limits)
    return replace(assessed, seconds=time.perf_counter() - started)


def _fit_part(
    assessed: AssessedRecording, known_curve: KnownCurve | None, limits: Limits
) -> AssessedRecording:
    """The part with the most movement fitted, unless its command shows another obstacle."""
    recording, masked, stretch = _to_fit(assessed.recording, assessed.assessment, limits)
    command = prepare_command(masked, known_curve)
    prepared = replace(
        assessed,
        assessment=with_obstacles(assessed.assessment, command.obstacles),
        recording=recording,
        masked=command.on_time,
        stretch=stretch,
        late_s=command.late_s,
        perhaps_exchanged=command.perhaps_exchanged,
        within_steps=command.within_steps,
        curve=command.curve,
        curve_changed=command.curve_changed,
    )
    return prepared if command.obstacles else _fitted(prepared, command)


def _to_fit(
    recording: Recording, assessment: Assessment, limits: Limits
) -> tuple[Recording, Recording, FitWindow | None]:
    """The part to fit, as recorded and masked: the shortest stretch without an obstacle, where each
    one tried is twice as long as the one before; else the whole recording.
    """
    samples = round(limits.fitted_samples)
    while (stretch := choose_fit_window(recording, samples)) is not None:
        part = recording.part(stretch.first, stretch.last)
        checked = assess(part, limits)
        if not checked.obstacles:
            return part, checked.recording, stretch
        samples *= 2
    return recording, assessment.recording, None


def _fitted(prepared: AssessedRecording, command: PreparedCommand) -> FittedRecording:
    """S and J of the prepared command, as far as its archive and a dead band in it allow."""
    alone = fit_stickslip(command.commanded, command.unsure_degree, command.first_look)
    sampled, archive = as_sampled(alone, command.commanded)
    # A report by exception rests as well.
    reports = archive is not None and archive.deviation > 0.0
    bands = () if reports else dead_bands_of(sampled)
    fit = without_slow_actuator(sampled, bands)
    sample = bootstrap(fit, peaks_kept=archive is None)
    return FittedRecording(
        **vars(prepared), fit=fit, sample=sample, archive=archive, dead_bands=bands
    )
