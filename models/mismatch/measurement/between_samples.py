"""What an archive did not keep between its samples, and how far S and J are therefore too small.

A controller acts every second or faster, an archive keeps a sample every 5 to 60 s, averages over
them, or a value that has moved by its deviation. The stem lets go at a peak of OP; where that peak
lies between two samples, a fit sees a lower one, and reads S and J too small.

The distribution of ``MV - OP`` does not depend on the sampling: a tenth of the samples has the same
percentiles as all of them. A model fitted without the peaks breaks away too early, and its free run
then stays nearer to the command than the recorded stem does. With ``W`` the range from the 2nd to
the 98th percentile of ``MV - OP``, recorded and simulated on the same samples,

    missed = (W of the recording - W of the free run) / 2

is how far the fitted breakaway level ``(S + J)/2`` is too small. The sliding level ``(S - J)/2`` is
known from where the stem stops, so S and J are both too small by that much. Averages over a sample
clip a triangle that turns every ``n`` samples to ``1 - 1/(2 n)`` of its height, by which ``W`` is
divided.

Exception reporting leaves OP and position uncertain by up to the deviation. S and J may be too
small by it (the peak was not reported) or too large (the valve follows, and its reports come late).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from stemwatch.models.estimate import Estimate
from stemwatch.models.mismatch.findings import RecordEffect
from stemwatch.models.mismatch.measurement.compression import drawn_lines, held_reports
from stemwatch.models.preparation.own_clock import duration
from stemwatch.models.recording import PERCENT, Floats, Recording
from stemwatch.models.signals.averages_in_steps import keeps_averages
from stemwatch.models.signals.excitation import reversals
from stemwatch.models.stickslip import parameters as coordinate
from stemwatch.models.stickslip.fit import StickSlipFit
from stemwatch.models.stickslip.parameters import S_and_J
from stemwatch.models.stickslip.problem import FitProblem
from stemwatch.models.stickslip.slip_levels import SlipLevels, Slips, seen_slips, slip_levels

BAND = (2.0, 98.0)  # percentiles of MV - OP
# A turn of OP counts from this share of the band on: noise and hunting within it lose no peak.
TURN = 0.2
FEWEST_TURNS = 5
# A stem that stays nearer to its command than this sticks too little to matter.
LEAST_BAND = 1.5  # percent
# Samples from one turn of OP to the next, from which its peaks are kept well enough. `stemwatch
# calibrate-archives` derives this and the other limits of a slow archive from recordings that keep
# a sample every second.
FEW = 8.0
# Below this OP may have turned twice between two samples, and the recording does not show how often
# it did.
TOO_FEW = 2.0
ENOUGH = 6.0
TWICE_AS_OFTEN = (
    0.5  # of the present interval, which is too long: the interval advised is at most this
)
LATE_BY_SAMPLING = 1.2  # samples
# Share of the S of friction alone below which a lag, and not the sampling, stands for the rest.
LEFT_BY_A_LAG = 0.5
# Advantage of friction over an actuator without it (``stickslip.advantage``) from which it is
# evident that there is any.
EVIDENT_MEAN, EVIDENT_T = 0.5, 2.0
# Slips per turn of OP, from which those that were seen represent all. A stem that slips again
# before it was seen at rest shows its unusual slips only.
OF_TURNS = 0.15
# Where OP turns less often, its peaks are lost all the same if the loop answers a slip before the
# second sample after it. ANSWERED: OP's speed there, as a share of its speed before the slip. The
# fit is then believed where the slips agree with it (S_APART: in S, by this share of S; J_APART: in
# J, by this share of the breakaway level), or where they cannot decide: their jumps are less than
# CLEAR standard deviations of the noise, or their bounds are at least WIDEST times the level.
# Bounds that wide give no S either: of eight valves kept every 30 and 60 s for eight hours
# (`draw_valves`, seed 8383) three had them, and an S of up to twice the true one.
ANSWERED, S_APART, J_APART, CLEAR, WIDEST = 0.8, 0.1, 0.15, 7.0, 1.0
# A loop that turns in more samples than this keeps its peaks, whatever its slips seem to show: a
# stem that answers a sample late looks as if it had slipped later. Of 48 valves kept every second
# (`draw_sticky`, seeds 5 and 7171) the slips of eleven contradict a fit that is right; eight of
# these take more samples to turn. Of seven valves kept every 5 and 10 s whose slips rightly
# contradict the fit, one does.
RESOLVED = 30.0
# An average over a slip lies between its two places, whichever way the loop answers, and a free run
# has no such sample: the J of 14 sticking valves kept as averages of 10 s, whose peaks were kept
# well enough (`draw_valves`, seeds 5151, 7171, 8181), was off by 0.47 % by the fit and by 0.12 % by
# the slips (medians). So their slips are read wherever they are clear; beside the fit where it has
# a lag, for a stem that is late by part of a sample looks like an average too.
SURE = 4.0  # standard errors of the breakaway level, and two of J, from which slips prove friction
SLUG = "between_samples"
# Standard error of what is missed, as a share of it, and its least value, in percent: 24 simulated
# sticking valves (seeds 5151, 6161, 7171) kept every 5, 10 and 20 s against the same kept every
# second.
ERROR_OF_MISSED, LEAST_ERROR = 0.25, 0.1  # ; percent
BETWEEN = (0.1, 0.9)  # of the way of a slip: an average lies between, a snapshot hardly ever
MOSTLY = 0.5
# Share of the way of a slip that OP may go as well. Of 48 valves kept every 10 s (`draw_valves`,
# seeds 5151, 8383, 9393) three have values between as averages have, and none by such slips.
DRAGGED = 0.5
QUARTILE = 0.4506  # lower quartile of the size of white noise's steps, of its standard deviation
JUMP = 6.0  # standard deviations of the noise
LEAST_JUMP = 0.3  # percent
# Standard error of S and J, in deviations of an exception report, and by how many deviations S and
# J of sticking valves are too small: between half a deviation (OP's last report lies that far below
# its peak, on average) and a whole one (the stem's last report lags as much). Reports of 0.5 and 1
# % of 16 simulated sticking valves lacked 1.1 and 0.8 deviations of S (median), 1.0 and 0.7 of J.
REPORT_ERROR, REPORT_LACKS = 0.5, 0.75
# The same of lines between the corners of a swinging door, whose deviation is itself estimated. The
# intervals hold the S of 37 of 37 (`python tests/benchmarks/bench_door_corners.py`).
LINES_ERROR = 0.7
TELLING_DEVIATION = 0.05  # percent, of a swinging door that hides next to nothing
HIDES = 2.0  # deviations, up to which S may be zero
# Deviations, up to which S may come from the reports of OP and stem alone. The low end of its
# interval is then that of the fitted S.
MAY_BE_REPORTS = 3.0


class ArchiveKind(StrEnum):
    """What an archive keeps."""

    SNAPSHOTS = "snapshots"
    AVERAGES = "averages"
    REPORTS = "reports by exception"
    LINES = "lines between stored points"


@dataclass(frozen=True)
class Archive:
    """How the archive of a recording samples: what it kept of what the controller and the stem did.

    ``per_turn`` is how many samples lie between one turn of OP and the next (median); ``deviation``
    what reports by exception or drawn lines leave open, percent; ``interval_s`` seconds from one
    sample to the next, ``apart`` samples from one that was stored to the next. ``levels`` are the
    friction levels read from the slips, with the command known in bounds only; ``None`` where too
    few slips are seen. ``unseen``: neither the slips nor a free run show the friction that keeps
    the stem from its command. ``doubted``: the slips contradict the fit although the loop turns in
    enough samples; OP may have peaks between samples, or the stem may answer a sample late, and the
    recording cannot show which. ``kind_open``: a stem that its command drags looks like averages
    too, and next to no slip goes farther than its command.
    """

    kind: ArchiveKind
    per_turn: float
    deviation: float
    interval_s: float
    apart: float = 1.0
    levels: SlipLevels | None = None
    unseen: bool = False
    doubted: bool = False
    kind_open: bool = False

    @property
    def too_slow(self) -> bool:
        """Whether so few samples lie between two turns of OP that only a bound can be known."""
        if self.deviation > 0.0 or self.levels is not None:
            return False
        return self.unseen or self.per_turn < TOO_FEW

    @property
    def sufficient_interval_s(self) -> float:
        """The longest sampling interval at which S and J could be identified, in seconds, to two
        digits.
        """
        exact = self.interval_s * min(max(self.per_turn, 1.0) / ENOUGH, TWICE_AS_OFTEN)
        digit = 10.0 ** np.floor(np.log10(exact))
        return float(digit * np.floor(exact / digit + 1e-9))

    def missed_by(self, problem: FitProblem, simulated: Floats) -> float:
        """What S and J lack each in a fit whose free run is ``simulated`` (n,), percent of MV."""
        if self.deviation > 0.0:
            return 0.0
        if self.levels is not None:
            return 0.5 * self.levels.bounds
        scored = problem.scored
        op, mv, run = problem.op[scored], problem.mv[scored], simulated[scored]
        seen = _band(mv - op)
        if self.kind is ArchiveKind.AVERAGES:
            seen /= 1.0 - (0.5 if self.kind_open else 1.0) * self._clipped
        return max(0.5 * (seen - _band(run - op)), 0.0)

    @property
    def _clipped(self) -> float:
        """The share of a triangle's height that its averages lack."""
        return 0.5 / max(self.per_turn, 1.0)

    def restored(self, S: Estimate, J: Estimate, missed: float) -> tuple[Estimate, Estimate]:
        """S and J in percent of travel with what was ``missed``, and with its uncertainty.

        Only the low end of S, and a reason, where the sampling is too slow for this loop.
        """
        if S.value is None or J.value is None:
            return S, J
        if self.levels is not None:
            levels = self.levels
            S_of_slips = _of_slips(S, levels.S, levels.S_error)
            J_of_slips = _of_slips(J, levels.J, levels.J_error)
            if levels.may_slide:  # no jump at all leaves twice the sliding level, S - J
                lowest = max(levels.S - levels.J - 1.96 * levels.S_error, 0.0)
                S_of_slips = replace(S_of_slips, low=lowest)
            if self.doubted:
                return S.holding(S_of_slips), J.holding(J_of_slips)
            return S_of_slips, replace(J_of_slips, low=0.0) if levels.may_slide else J_of_slips
        if self.deviation > 0.0:
            lacks = self._lacks(S.value)
            by_lines = self.kind is ArchiveKind.LINES
            error = (LINES_ERROR if by_lines else REPORT_ERROR) * self.deviation
            moved = (_moved(S, lacks, error), _moved(J, lacks, error))
            if S.value > MAY_BE_REPORTS * self.deviation:
                return moved
            return moved[0].holding(_moved(S, 0.0, error)), moved[1].holding(_moved(J, 0.0, error))
        lowest, error = S.low or 0.0, max(ERROR_OF_MISSED * missed, LEAST_ERROR)
        if self.kind_open:  # half of what averages lack is added: it may be all or nothing
            error = float(
                np.hypot(error, 0.25 * self._clipped * (S.value + J.value + 2.0 * missed))
            )
        S, J = _moved(S, missed, error), _moved(J, missed, error)
        if not self.too_slow:
            return S, J
        bound = Estimate(low=max(lowest, 0.0), reason=self.reason, unit=PERCENT)
        return bound, Estimate.unknown(self.reason, unit=PERCENT)

    def with_slips(self, problem: FitProblem, gain: float, zero: float) -> Archive:
        """This archive with the friction levels that the slips of evenly spaced samples show, where
        enough slips are seen; ``gain`` and ``zero`` are those of the reading.
        """
        slips = self.slips(problem, gain, zero)
        return self if slips is None else replace(self, levels=slip_levels(slips))

    def slips(self, problem: FitProblem, gain: float, zero: float) -> Slips | None:
        """The slips between evenly spaced samples; ``None`` where too few are seen."""
        if self.deviation > 0.0:
            return None
        slips = seen_slips(problem, gain, zero, averaged=self.kind is ArchiveKind.AVERAGES)
        too_few = slips is None or slips.side.size < OF_TURNS * problem.op.size / self.per_turn
        return None if too_few else slips

    def _lacks(self, S: float) -> float:
        """By how much S and J are too small between two reports, percent; 0 for a small S, of which
        it is not known.
        """
        hidden = self.kind is not ArchiveKind.REPORTS or S <= HIDES * self.deviation
        return 0.0 if hidden else REPORT_LACKS * self.deviation

    @property
    def reason(self) -> str:
        """Why what the stem did between two samples is not known."""
        if self.kind is ArchiveKind.LINES and self.deviation > TELLING_DEVIATION:
            return (
                f"the archive stored {self.kind} to {self.deviation:.2g} %; exported with a "
                f"deviation of {TELLING_DEVIATION:g} % it would tell"
            )
        if self.deviation > 0.0:
            return f"the archive stored {self.kind} to {self.deviation:.2g} %"
        return (
            f"the archive keeps {self._what_is_kept} {_seconds(self.interval_s)} and OP turns "
            f"round every {self.per_turn:.2g} of them, so its peaks lie between; a sample every "
            f"{_seconds(self.sufficient_interval_s)} would do"
        )

    @property
    def _what_is_kept(self) -> str:
        averages = self.kind is ArchiveKind.AVERAGES
        return "the average of every" if averages else "a sample every"

    def as_effect(self, missed: float) -> RecordEffect:
        """This archive as a record effect; ``missed`` in percent of travel."""
        if self.deviation > 0.0:
            parameters = {"deviation_percent": self.deviation}
        else:
            parameters = {"samples_per_turn": self.per_turn, "missed_percent": missed}
        return RecordEffect(slug=SLUG, sentence=self.sentence(missed), parameters=parameters)

    def sentence(self, missed: float) -> str:
        """What an engineer reads about this archive; ``missed`` in percent of OP."""
        if self.deviation > 0.0:
            return (
                f"The archive stored {self.kind} to {self.deviation:.2g} %: S and J are known no "
                "better than that."
            )
        kept_text = (
            f"The archive keeps {self._what_is_kept} {_seconds(self.interval_s)}, and OP turns "
            f"round every {self.per_turn:.2g} samples"
        )
        if self.too_slow:
            enough_text = _seconds(self.sufficient_interval_s)
            return f"{kept_text}: too slow for this loop, a sample every {enough_text} would do."
        if self.levels is not None and self.doubted:
            return (
                f"{kept_text}: {self.levels.count} slips, at which the samples leave OP open by "
                f"{self.levels.bounds:.2g} %, would have S and J of {self.levels.S:.2g} and "
                f"{self.levels.J:.2g} %, and the intervals hold both."
            )
        if self.levels is not None:
            return (
                f"{kept_text}: S and J are read from {self.levels.count} slips, at which the "
                f"samples leave OP open by {self.levels.bounds:.2g} %."
            )
        return (
            f"{kept_text}: S and J are restored by {missed:.1f} % each for the peaks of OP between "
            "samples, by how far the stem was seen from its command."
        )


def as_sampled(fit: StickSlipFit, recording: Recording) -> tuple[StickSlipFit, Archive | None]:
    """The fit with S and J corrected for the archive of a ``recording`` in percent of travel, and
    that archive where S and J can be corrected.

    A slip is seen up to a sample after the peak that caused it, which looks like a dead time and a
    lag of about a sample each, with a smaller S: then S and J are taken from the fit of friction
    alone. A distance between command and stem that a slower actuator causes was not lost between
    samples. The breakaways lie between samples too, so they are not read one by one, but in bounds.
    """
    archive, friction = find_archive(recording), fit.of_sticking
    if archive is None or archive.deviation == 0.0:
        evident = friction.mean >= EVIDENT_MEAN and friction.t >= EVIDENT_T
        archive = _even(fit, recording, archive, evident=evident)
    if archive is None or archive.doubted:
        return fit, archive
    single, fit = fit, replace(fit, breakaways=None)
    if fit.hypothesis != "both":
        return fit, archive
    if S_and_J(fit.candidate)[0] < LEFT_BY_A_LAG * S_and_J(fit.naive)[0]:
        # Reports come late, which looks like a lag: S is known no better than their deviation.
        return (fit, archive) if archive.deviation > 0.0 else (single, None)
    c, sample = fit.candidate, archive.apart * fit.evaluator.problem.interval_s
    late = max(c[coordinate.DEAD_TIME_S], c[coordinate.LAG_UP_S], c[coordinate.LAG_DOWN_S])
    steps = np.abs(np.diff(fit.evaluator.problem.op))
    slow = max(c[coordinate.SLOW_UP], c[coordinate.SLOW_DOWN]) * np.percentile(steps, 90.0)
    if max(late, slow) > LATE_BY_SAMPLING * sample:
        return (fit, archive) if archive.deviation > 0.0 else (single, None)
    return replace(fit, hypothesis="sticking", candidate=fit.naive), archive


def _even(
    fit: StickSlipFit, recording: Recording, archive: Archive | None, *, evident: bool
) -> Archive | None:
    """The ``archive`` of evenly spaced samples with the levels read from the slips. An archive that
    keeps more samples counts as slow only where the slips contradict the fit. ``evident``: whether
    there is clearly friction.
    """
    seen = archive or even_archive(recording)
    if seen is None:
        return None
    c, problem = fit.candidate, fit.evaluator.problem
    gain, zero = 1.0 + float(c[coordinate.GAIN]), float(c[coordinate.ZERO])
    if archive is None:
        averaged = seen.kind is ArchiveKind.AVERAGES
        if seen.per_turn > RESOLVED or not (evident or averaged):
            return None
        slips = seen.slips(problem, gain, zero)
        if slips is None:
            return None
        return _resolved(fit, seen, slips, evident=evident)
    seen = seen.with_slips(problem, gain, zero)
    if seen.levels is not None and seen.levels.bounds > WIDEST * 0.5 * (fit.S + fit.J):
        return replace(seen, levels=None, unseen=True)
    if evident or (seen.levels is not None and _show_friction(seen.levels)):
        return seen
    # A loop that hunts faster than its samples leaves a fit next to no friction, but the stem is
    # seen as far from its command as ever.
    missed = seen.missed_by(problem, fit.evaluator.simulate(fit.candidate))
    seen = replace(seen, levels=None, unseen=True)
    return seen if max(fit.S, fit.J) + missed >= LEAST_BAND else None


def _resolved(fit: StickSlipFit, seen: Archive, slips: Slips, *, evident: bool) -> Archive | None:
    """The archive that was ``seen`` to keep the peaks of OP, with the levels of its ``slips``,
    where these are to be believed instead of the fit or beside it.
    """
    against = against_fit(fit, slips)
    averaged = seen.kind is ArchiveKind.AVERAGES and against.clear
    if not (averaged or (evident and against.contradicts)):
        return None
    levels = slip_levels(slips)
    if not (evident or _show_friction(levels)):
        return None
    if averaged and fit.hypothesis != "both":
        return replace(seen, levels=levels)
    return replace(seen, levels=levels, doubted=True) if against.differs else None


@dataclass(frozen=True)
class SlipsAgainstFit:
    """How the slips' S and J differ from those of a fit, as shares of S and of the breakaway level.
    ``answered``: OP's speed after a slip, as a share of that before; ``jump``: the size of a slip
    in standard deviations of the noise; ``bounds``: how far apart the bounds of a slip are, as a
    share of the level.
    """

    S: float
    J: float
    answered: float
    jump: float
    bounds: float

    @property
    def clear(self) -> bool:
        """Whether these slips stand out of the noise, and their bounds are close."""
        return self.jump >= CLEAR and self.bounds <= WIDEST

    @property
    def could(self) -> bool:
        """Whether these slips are clear enough to contradict a fit."""
        return self.answered < ANSWERED and self.clear

    @property
    def differs(self) -> bool:
        """Whether the slips have another S or J."""
        return self.S > S_APART or self.J > J_APART

    @property
    def contradicts(self) -> bool:
        """Whether the slips of a loop that answers them between samples have another S or J."""
        return self.could and self.differs


def against_fit(fit: StickSlipFit, slips: Slips) -> SlipsAgainstFit:
    """The slips' S and J, by the middle of their bounds, beside those of a fit."""
    level, kinetic = (max(level_value, 1e-9) for level_value in slips.middle)
    return SlipsAgainstFit(
        S=abs(level + kinetic - fit.S) / (level + kinetic),
        J=abs(level - kinetic - fit.J) / level,
        answered=slips.answered,
        jump=(level - kinetic) / slips.sigma,
        bounds=float(np.median(slips.high - slips.low)) / level,
    )


def _show_friction(levels: SlipLevels) -> bool:
    level_error = np.hypot(levels.level_error, np.hypot(levels.common, levels.apart))
    return bool(levels.level > SURE * level_error and levels.J > 0.5 * SURE * levels.J_error)


def stands_for_friction(S: Estimate, friction_alone: Estimate) -> bool:
    """Whether a lag explains most of the S that a fit of friction alone would have."""
    both_known = S.value is not None and friction_alone.value is not None
    return both_known and (S.value or 0.0) < LEFT_BY_A_LAG * (friction_alone.value or 0.0)


def find_archive(recording: Recording) -> Archive | None:
    """The slow archive of a recording in percent of travel. ``None`` where it kept enough samples,
    where this cannot be decided, or where the stem is never seen far from its command.
    """
    if recording.mv is None or recording.mv.unit != recording.op.unit:
        return None
    thinned = _thinned(recording)
    if thinned is not None:
        return thinned
    sampled = even_archive(recording)
    return sampled if sampled is not None and sampled.per_turn <= FEW else None


def even_archive(recording: Recording) -> Archive | None:
    """The archive of evenly spaced samples, however many; ``None`` where OP turns too seldom to
    decide, or the stem is never seen far from its command.
    """
    assert recording.mv is not None
    if np.count_nonzero(recording.usable) < FEWEST_TURNS:
        return None
    both_usable = recording.usable
    op, mv = recording.op.values[both_usable], recording.mv.values[both_usable]
    seen = _band(mv - op)
    if seen < LEAST_BAND:
        return None
    turns = reversals(op, TURN * seen)
    if turns.size < FEWEST_TURNS:
        return None
    per_turn = float(np.median(np.diff(turns)))
    averages = keeps_averages(recording)  # by steps of OP and set point, else by slips of the stem
    if averages is False or (averages is None and not _averaged(op, mv, by_itself=False)):
        return Archive(ArchiveKind.SNAPSHOTS, per_turn, 0.0, _every_s(recording))
    kind_open = averages is None and not _averaged(op, mv, by_itself=True)
    return Archive(ArchiveKind.AVERAGES, per_turn, 0.0, _every_s(recording), kind_open=kind_open)


def _thinned(recording: Recording) -> Archive | None:
    """An archive that stored reports by exception, or drew lines."""
    assert recording.mv is not None
    op, mv = recording.op.values, recording.mv.values
    if recording.mv.deviation is not None:
        deviation = max(recording.op.deviation or 0.0, recording.mv.deviation)
        return Archive(ArchiveKind.LINES, np.inf, deviation, _every_s(recording))
    # A stem that only rests and jumps looks like reports of its own; no controller's output does.
    reports = held_reports(op, mv)
    if reports is not None:
        spacing = float(np.median(np.diff(np.flatnonzero(reports.stored))))
        deviation = reports.deviation
        return Archive(ArchiveKind.REPORTS, np.inf, deviation, _every_s(recording), spacing)
    lines = drawn_lines(mv, op)
    if lines is None:
        return None
    return Archive(ArchiveKind.LINES, np.inf, lines.deviation, _every_s(recording))


def _every_s(recording: Recording) -> float:
    """Seconds from one sample to the next, whatever clock the recording is on."""
    return recording.interval_s * recording.unit_s


def _seconds(seconds: float) -> str:
    return duration(1.0, seconds, "g")


def _band(spacings: Floats) -> float:
    low, high = np.percentile(spacings, BAND)
    return float(high - low)


def _averaged(op: Floats, mv: Floats, *, by_itself: bool) -> bool:
    """Whether most slips have a value between where the stem was and where it came to rest; of
    slips ``by_itself`` only those count that its command has not dragged that far.
    """
    steps = np.diff(mv)
    # The stem may slip at every other sample, so the noise is estimated from the quieter steps.
    sigma = float(np.percentile(np.abs(steps), 25.0)) / QUARTILE
    jump_size = max(JUMP * sigma, LEAST_JUMP)
    directions = mv[3:-1] - mv[1:-3]
    at_rest = (np.abs(steps[:-3]) < 0.5 * jump_size) & (np.abs(steps[3:]) < 0.5 * jump_size)
    slipped = at_rest & (np.abs(directions) > jump_size)
    if by_itself:
        dragged = np.sign(directions) * (op[3:-1] - op[1:-3])
        slipped &= dragged <= DRAGGED * np.abs(directions)
    share = (mv[2:-2] - mv[1:-3])[slipped] / directions[slipped]
    return bool(share.size and np.mean((share > BETWEEN[0]) & (share < BETWEEN[1])) > MOSTLY)


def _of_slips(estimate: Estimate, value: float, error: float) -> Estimate:
    """``estimate`` replaced by the ``value`` that was read from the slips, with its standard
    ``error``.
    """
    low, high = max(value - 1.96 * error, 0.0), value + 1.96 * error
    return replace(estimate, value=value, low=low, high=high)


def _moved(estimate: Estimate, change: float, error: float) -> Estimate:
    """``estimate`` larger by ``change``, its interval wider by an ``error`` of one sigma.

    An interval that ended at zero is as wide below as above before it is moved: what ended it was
    that neither S nor J is negative, and not what the record says.
    """
    value = estimate.value
    assert value is not None
    low, high = estimate.low, estimate.high
    error_below = 0.0 if low is None else value - low
    error_above = 0.0 if high is None else high - value
    if change > 0.0 and value < error_above:
        error_below = max(error_below, error_above)
    value += change
    return replace(
        estimate,
        value=value,
        low=max(value - float(np.hypot(error_below, 1.96 * error)), 0.0),
        high=value + float(np.hypot(error_above, 1.96 * error)),
    )
