"""S and J read from the breakaways themselves: the distance of command and stem when the stem
breaks away.

No two breakaways of a packing are equal. A free run with one level slips sometimes too early and
sometimes too late, and the S and J of the best free run are then not those of the mean breakaway:
with 12 % scatter they come out 8 % too small. The breakaways give both levels without a run: the
distance of command and stem at the breakaway is the breakaway level, and after the slip the stem
stays behind its command by the kinetic level. Choudhury's parameters follow from the two
(doi:10.1016/j.conengprac.2004.05.005):

    (S + J)/2 = breakaway level,   (S - J)/2 = kinetic level.

A stem answers its command a little late, which matters where the command is fast. So both levels
are computed for each of several delays, and the delays are weighted by how well the breakaways then
agree with one another.

Where OP was read through a curve to stroke that is itself estimated, an error ``e(OP)`` of the
curve shifts both distances, each by ``e`` at its place. It shifts the two directions oppositely, so
that slips at many places separate it from the levels: the levels and a polynomial ``e`` are found
together by least squares. (In the free run with which the curve was found, a wrong curve and
another S look much alike.)
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stemwatch.models.compiled import compiled
from stemwatch.models.recording import Bools, Floats
from stemwatch.models.signals.forensics import position_step
from stemwatch.models.stickslip.onsets import Samples, least_departure, onsets
from stemwatch.models.stickslip.problem import FitProblem
from stemwatch.models.stickslip.stroke_curve import USED, shapes_of

FEWEST = 8
FEWEST_OF_A_SIDE = 4  # else the two directions cannot be separated
LEAST_J = 0.4  # percent; a smaller slip looks like a stem that creeps with its command
LEAST_JUMP = 0.4  # of J, beyond the command's own move: an onset of motion this large is a slip
SLIPPING_SAMPLES = 2  # from its first sample of motion until a slip is over
# Share of a slip made after its first sample of motion, beyond the command's own move. From this
# share on, that sample does not show where the stem stopped. 41 valves of `draw_valves` and
# `draw_sticky` (seeds 5151, 6161, 7171, 8181) have 0.06 at most at 1 s; at 10 Hz three of four have
# 0.18 to 0.31, and J read from that sample was too small by a quarter, S too large by as much.
UNFINISHED = 0.1
FARTHEST = 0.35  # share of the fitted level; beyond it the onsets are not this element's slips
ALIKE = 0.02  # scatter below which a run with one level gives S and J as well
TRIM = 3.5  # robust standard deviations
# Delay of a stem in samples: mean and standard deviation over valves. A fitted delay has the same
# standard deviation plus a quarter of its own value. Twice the deviation lets chance choose: S of
# 92 sticking valves of `stemwatch robustness` (seeds 5151 to 9393) was then off by 0.11 % and not
# by 0.08 (medians), and half of it costs valves of draw_sticky, whose lags are longer, 0.02.
LATE, LATE_SHARE = (0.2, 0.2), 0.25
# And this share of valves has any delay at all: where the command moves at one speed, the slips do
# not show how much. The estimate uses the usual delays, and the interval includes the others too:
# with that of friction alone (``interval``) those of S of 39 valves of draw_sticky (seeds 5151,
# 7171, 8383) hold in 36, and of 24 of `stemwatch robustness` (5151, 6161, 8383) in 23, as before.
UNUSUALLY_LATE = 0.06
SLOW_SAMPLES = 1.0  # from which the fitted dead time and lag are taken as real
TRIED, FARTHEST_TRIED = 17, 1.6  # delays, from 0 to this many samples
# Share of the command's move in a sample that lies between a slip and the next sample, mean and
# standard deviation: 0 for a stem that slides on with its command, a half for one that sticks at
# once.
SINCE = (0.4, 0.4)
TILT = 0.15  # share of the level by which the two directions differ, one standard deviation
LEAST_SCATTER = 0.01  # of the level
# Standard deviation of the model error, which more breakaways do not reduce, of the breakaway and
# of the kinetic level, as a share of the first: a stem is not exactly a two-level element. These
# three are calibrated on the 92 valves above and 28 of draw_sticky, seed 6161; `stemwatch trial`
# and `stemwatch robustness` print on others how many intervals hold.
MODEL_ERROR, KINETIC_ERROR = 0.015, 0.008
# The same for both levels together, as a share of the command's move in a sample: the record does
# not hold when in its sample the stem broke away, nor what OP did in the rest of it. Most of it is
# in the delay already, over which the draws go: with 0.2 all intervals of S of 47 valves of
# `stemwatch robustness` (seeds 5151, 8383, 9393) hold, 0.72 % wide, and with 0.1 all, 0.63 % wide;
# of 28 of draw_sticky (5151, 7171, 8383) 23 with either.
WITHIN_SAMPLE = 0.1
# The same for the breakaway level alone: bristles bend before they let go. The level read from a
# LuGre packing is 0.2 of a sample's move higher than its true one without noise.
LETS_GO = 0.3
# This error grows as the slip gets smaller: a stem of bristles that hardly jumps first creeps with
# its command, so that its motion is seen late. Of 12 such valves (`draw_valves`, seeds 5151, 6161,
# 7171) the level of the two with a J of 0.5 and 0.75 % is 0.6 of a sample's move too high, and that
# of those above 1 % is 0.1 too high in the median.
SMALL_JUMP = 1.0  # percent
# The same where the position is recorded in steps that a slip hardly exceeds. Only slips of a step
# and a half beyond the noise are seen, so that the smaller ones of a packing that scatters are
# missed: a J of 2.1 steps (seed 7171) was read as 2.4. The rounding error of both levels, as a
# share of the step.
FEW_STEPS, OF_A_STEP = 3.0, 12.0**-0.5
# Of slips about as large as what must be exceeded to be seen in the noise, or in coarse steps
# (``onsets.least_departure``), only the larger ones are seen: a J that is read as less than this
# many times of it is anything between the J of the fit, which does not depend on that, and the one
# that is read. Of 11 such recordings (as they are, in steps, every 5 s; `draw_valves`, seeds 5151
# and 7171) J by the slips is 0.23 % too large in the mean and by the fit 0.10 % too small; above
# it 0.02 too large and 0.22 too small.
CLEARLY_SEEN, BETWEEN_BOTH = 1.5, 0.5  # times what must be exceeded; share of the draws
# For slips of any size: a resting place is rounded alike each time the stem comes there, at the end
# of a slip one way and at the start of the next the other way. That moves the two levels apart and
# leaves S as it is: standard deviation of J, as a share of the step, of a stem with one place at
# either end of its slips; more places reduce it as independent roundings.
OF_A_PLACE = 6.0**-0.5
# Prior standard deviation of the error of an estimated curve: of its slope as a share, of its bends
# in percent of travel. Three times as much or a third of it changes S by hundredths of a percent.
UNSURE_SLOPE, UNSURE_BEND = 0.03, 1.5
LEAST_CHORD = 0.5  # of the slope that was found
CURVE_ROUNDS = 3  # of least squares, after each of which outliers are left out


@dataclass(frozen=True)
class _Levels:
    """The levels for one delay. ``weight`` is the log-likelihood of the delay with its prior,
    ``unusual`` its distance from the prior mean in standard deviations. ``chord`` is the factor by
    which the mean slope of the curve from OP to stroke is off, and ``covariance`` (3, 3) that of
    level, kinetic level and chord.
    """

    weight: float
    level: float
    kinetic: float
    covariance: Floats
    scatter: float
    rate: float
    count: int
    unusual: float
    chord: float = 1.0


@dataclass(frozen=True)
class Breakaways:
    """``count`` breakaways: the mean distance of command and stem at the breakaway (``level``) and
    after the slip (``kinetic``), percent of OP, and the ``scatter`` from one breakaway to the next,
    a share of the level. ``rate`` is the command's move in the sample of a slip, percent of OP
    (median); ``step`` the resolution of the position's recorder where it is coarse, and ``places``
    the number of different resting places in it. ``least_seen`` is how far a stem must depart to be
    seen, and ``fitted_J`` the jump of the fit, percent of OP. ``tried`` are the levels for each
    delay of the stem, with ``weights`` that sum to one.
    """

    count: int
    level: float
    kinetic: float
    scatter: float
    rate: float
    tried: tuple[_Levels, ...]
    weights: Floats
    step: float = 0.0
    places: int = 1
    least_seen: float = 0.0
    fitted_J: float = 0.0

    @property
    def S(self) -> float:
        """Dead band plus stick band, percent of OP."""
        return max(self.level + self.kinetic, 0.0)

    @property
    def J(self) -> float:
        """Slip jump, percent of OP."""
        return max(self.level - self.kinetic, 0.0)

    def near(self, level: float) -> bool:
        """Whether these may be breakaways of an element that was fitted with this ``level``."""
        return abs(self.level - level) <= FARTHEST * level

    @property
    def agreement(self) -> float:
        """How well the breakaways agree at the delay that suits them best: the log-likelihood of
        one of them, halved as in ``_weight``."""
        return max((one.weight + 0.5 * one.unusual**2) / one.count for one in self.tried)

    @property
    def _of_any_delay(self) -> Floats:
        """(n,) weights of the delays by the agreement of the breakaways alone."""
        level_weights = np.array([levels.weight + 0.5 * levels.unusual**2 for levels in self.tried])
        weights = np.exp(level_weights - level_weights.max())
        return np.asarray(weights / weights.sum())

    def draws(self, count: int, rng: np.random.Generator) -> tuple[Floats, Floats]:
        """Draw S and J, (count,) each, from their distribution by the breakaways, percent of OP.

        An unknown delay shifts both levels the same way, and so S more than J.
        """
        delays = rng.choice(len(self.tried), size=count, p=self.weights)
        late_count = round(UNUSUALLY_LATE * count)
        delays[:late_count] = rng.choice(len(self.tried), size=late_count, p=self._of_any_delay)
        means = np.array([(levels.level, levels.kinetic, levels.chord) for levels in self.tried])
        within = (WITHIN_SAMPLE * self.rate) ** 2
        lets_go = LETS_GO * max(SMALL_JUMP / max(self.J, LEAST_J), 1.0)
        own_error = (MODEL_ERROR * self.level) ** 2 + (lets_go * self.rate) ** 2
        own_kinetic = (KINETIC_ERROR * self.level) ** 2
        if self.J < FEW_STEPS * self.step:
            own_error += (OF_A_STEP * self.step) ** 2
            own_kinetic += (OF_A_STEP * self.step) ** 2
        apart = 0.25 * (OF_A_PLACE * self.step) ** 2 / self.places
        model = np.array(
            [
                [within + own_error + apart, within - apart, 0.0],
                [within - apart, within + own_kinetic + apart, 0.0],
                [0.0, 0.0, 1e-12],
            ]
        )
        roots = np.linalg.cholesky([levels.covariance + model for levels in self.tried])
        normal = rng.standard_normal((count, 3))
        level, kinetic, chord = (means[delays] + np.einsum("dij,dj->di", roots[delays], normal)).T
        chord = np.maximum(chord, LEAST_CHORD)
        S, J = np.maximum(level + kinetic, 0.0), np.maximum(level - kinetic, 0.0)
        if self.J < CLEARLY_SEEN * self.least_seen:
            smaller = round(BETWEEN_BOTH * count)
            J[-smaller:] -= max(self.J - self.fitted_J, 0.0) * rng.random(smaller)
        return S / chord, np.maximum(J, 0.0) / chord


def breakaways(
    problem: FitProblem,
    gain: float,
    zero: float,
    S: float,
    J: float,
    late_s: float = 0.0,
    unhindered: Floats | None = None,
) -> Breakaways | None:
    """The breakaways of a recorded position, or ``None`` where there are too few clear ones.

    ``gain`` is MV's percent for one of OP and ``zero`` its offset, percent of MV. ``S`` and ``J``,
    percent of OP, are those of the fitted element: an onset of motion without a jump is no
    breakaway, and a level far from the fitted one is not the element's. ``late_s`` is the dead time
    and lag that were fitted, and ``unhindered`` (n,) where the stem would be behind them without
    friction, percent of MV: a lag of a sample or more cannot be replaced by a delay of OP.
    """
    if J < LEAST_J:
        return None
    seen = seen_breakaways(problem, gain, zero, J, late_s, unhindered)
    if seen is None or not seen.near(0.5 * (S + J)):
        return None
    return replace(seen, fitted_J=J)


def seen_breakaways(
    problem: FitProblem,
    gain: float,
    zero: float,
    J: float,
    late_s: float = 0.0,
    unhindered: Floats | None = None,
) -> Breakaways | None:
    """``breakaways`` of jumps of about ``J``, percent of OP, whatever level was fitted.

    Breakaways that are all alike add nothing to a fit, and slips that take longer than a sample do
    not show at their first sample where the stem stopped.
    """
    found_onsets = onsets(problem.mv, problem.scored, problem.sigma, problem.interval_s)
    stem, onset_place = (problem.mv - zero) / gain, (found_onsets.place - zero) / gain
    side, sigma = found_onsets.side * np.sign(gain), problem.sigma / abs(gain)
    clock = np.arange(problem.op.size, dtype=np.float64)
    late, command = late_s / problem.interval_s, problem.op
    usual_late, delays = LATE[0], np.linspace(0.0, FARTHEST_TRIED, TRIED)
    if unhindered is not None and late >= SLOW_SAMPLES:
        usual_late, delays = 0.0, np.linspace(-late, late, TRIED)
        command = (unhindered - zero) / gain
    spread = LATE[1] + LATE_SHARE * late
    unsure = problem.unsure_degree
    low, high = np.percentile(problem.op, USED) if unsure else (0.0, 0.0)
    if _unfinished(problem.op, stem, found_onsets.at, side, onset_place, LEAST_JUMP * J):
        return None
    levels_tried = []
    for delay in delays:
        command_then = np.interp(clock - delay, clock, command)
        last_before, first_after, after, rate, jump = distances(
            stem, command_then, found_onsets.at, side, found_onsets.rested, onset_place
        )
        slip = (jump >= LEAST_JUMP * J) & (first_after > 0.0)
        if np.count_nonzero(slip) < FEWEST:
            continue
        slips = _Slips(
            last_before[slip], first_after[slip], after[slip], rate[slip], side[slip], sigma
        )
        unusual = (float(delay) - usual_late) / spread
        if unsure and high > low:
            onset_sample = found_onsets.at[slip]
            then = 0.5 * (command_then[onset_sample - 1] + command_then[onset_sample])
            borne = shapes_of(then, problem.op, unsure)
            stopped = shapes_of(command_then[onset_sample], problem.op, unsure)
            levels_tried.append(
                _with_curve(slips, unusual, borne, stopped, 0.5 * float(high - low))
            )
        else:
            levels_tried.append(_levels(slips, unusual))
    if not levels_tried:
        return None
    found_breakaways = _weighted(levels_tried)
    if found_breakaways.scatter < ALIKE:
        return None
    found_breakaways = replace(found_breakaways, least_seen=least_departure(sigma))
    step = position_step(problem.mv)
    if not step:
        return found_breakaways
    places = np.unique(np.round(found_onsets.place / step)).size
    return replace(found_breakaways, step=step / abs(gain), places=places)


def _unfinished(
    command: Floats, stem: Floats, onset: Samples, side: Floats, place: Floats, least: float
) -> bool:
    """Whether most slips, of at least ``least`` percent, go on after their first sample of motion,
    because the recording resolves them.
    """
    inside = onset < stem.size - SLIPPING_SAMPLES
    onset, side, place = onset[inside], side[inside], place[inside]
    whole = side * (stem[onset + SLIPPING_SAMPLES] - place)
    commanded = side * (command[onset + SLIPPING_SAMPLES] - command[onset - 1])
    slip = whole - np.maximum(commanded, 0.0) >= least
    if np.count_nonzero(slip) < FEWEST_OF_A_SIDE:
        return False
    later = side * (stem[onset + 1] - stem[onset])
    pushed = np.maximum(side * (command[onset + 1] - command[onset]), 0.0)
    return bool(np.median(((later - pushed) / np.maximum(whole, 1e-9))[slip]) >= UNFINISHED)


@compiled()
def distances(
    stem: Floats, command: Floats, at: Samples, side: Floats, rested: Samples, onset_place: Floats
) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """(m,) each, of the onsets: the largest distance of command and stem before the breakaway, that
    at the first sample of motion, the distance after the slip, the command's move in that sample,
    and how far the stem jumped beyond the command's move.
    """
    m, n = at.size, stem.size
    last_before, first_after, after = np.zeros(m), np.zeros(m), np.zeros(m)
    rate, jump = np.zeros(m), np.zeros(m)
    for i in range(m):
        k, direction = at[i], side[i]
        for j in range(max(k - rested[i] + 1, 0), k):
            # A distance that the packing held on the other side it would have held on this one too.
            last_before[i] = max(last_before[i], abs(command[j] - onset_place[i]))
        first_after[i] = max(direction * (command[k] - onset_place[i]), last_before[i])
        after[i] = direction * (command[k] - stem[k])
        rate[i] = direction * (command[k] - command[k - 1])
        end = min(k + SLIPPING_SAMPLES, n - 1)
        commanded = max(direction * (command[end] - command[k - 1]), 0.0)
        jump[i] = direction * (stem[end] - onset_place[i]) - commanded
    return last_before, first_after, after, rate, jump


@dataclass(frozen=True)
class _Slips:
    """Slips (m,) for one delay, percent of OP as ``distances`` has them, with noise ``sigma``."""

    near: Floats
    far: Floats
    after: Floats
    rate: Floats
    side: Floats
    sigma: float

    @property
    def half(self) -> Floats:
        """(m,) Half the distance of the bounds between which the stem let go."""
        return 0.5 * (self.far - self.near)

    def within(self, selected: Bools) -> float:
        """Variance of where in its sample a slip was; the resting place is a mean of five."""
        return float(np.mean(self.half[selected] ** 2)) / 3.0 + self.sigma**2 / 5.0


def _variances(slips: _Slips, spread: float, within: float, level: float) -> tuple[float, float]:
    """Variance of a breakaway, and the scatter of the level as a share of it."""
    variance = max(spread**2, 0.5 * within, (LEAST_SCATTER * level) ** 2)
    return variance, float(np.sqrt(max(spread**2 - within, 0.0)) / max(level, 1e-9))


def _weight(count: int, variance: float, unusual: float) -> float:
    """Half the log-likelihood of independent slips, because slips of one oscillation are
    correlated. The delay is ``unusual`` standard deviations from its prior mean.
    """
    return float(-0.25 * count * np.log(variance) - 0.5 * unusual**2)


def _levels(slips: _Slips, unusual: float) -> _Levels:
    """Both levels for one delay."""
    level, spread, error, is_used = _mean_of_sides(slips.near + slips.half, slips.side)
    variance, scatter = _variances(slips, spread, slips.within(is_used), level)
    kinetic, kinetic_error = _kinetic(slips.after, slips.rate, slips.side, slips.sigma, level)
    return _Levels(
        weight=_weight(int(is_used.sum()), variance, unusual),
        level=level,
        kinetic=kinetic,
        covariance=np.diag([error**2, kinetic_error**2, 0.0]),
        scatter=scatter,
        rate=float(np.median(np.abs(slips.rate))),
        count=int(is_used.sum()),
        unusual=unusual,
    )


def _with_curve(
    slips: _Slips, unusual: float, borne: Floats, stopped: Floats, half_range: float
) -> _Levels:
    """Both levels for one delay, and by how much the curve is off, by least squares.

    ``borne`` and ``stopped`` (m, k + 1) are the shapes of the curve's error, at the command of each
    breakaway and at that of the reading after it; the first, a constant, is the zero of the
    reading. ``half_range`` is half the part of the command that was used, percent.
    """
    side, values = slips.side, slips.near + slips.half
    too_few = min(np.count_nonzero(side < 0.0), np.count_nonzero(side > 0.0)) < FEWEST_OF_A_SIDE
    level, spread, _, is_used = _mean_of_sides(values, side)
    _, after_spread, _, after_kept = _mean_of_sides(slips.after - SINCE[0] * slips.rate, side)
    bends = borne.shape[1] - 1
    zeros = np.zeros(side.size)
    # Unknowns: level, kinetic level, zero, tilt and ``since`` as in ``_kinetic``, and the curve.
    side_columns = -side[:, None]
    let_go = np.column_stack(
        (zeros + 1, zeros, -side_columns, zeros, zeros, side_columns * borne[:, 1:])
    )
    halted = np.column_stack(
        (zeros, zeros + 1, zeros, -side_columns, slips.rate, side_columns * stopped[:, 1:])
    )
    slope, bend = (1.0 / np.square((UNSURE_SLOPE * half_range, UNSURE_BEND))).tolist()
    for _ in range(CURVE_ROUNDS):
        variance, scatter = _variances(slips, spread, slips.within(is_used), level)
        after_variance = max(after_spread**2, slips.sigma**2, 1e-6)
        tilt = max(TILT * level, 1e-3)
        prior = np.array([0.0, 0.0, 1e6 if too_few else 1e-6, tilt**-2, SINCE[1] ** -2, slope])
        prior = np.append(prior, np.full(bends - 1, bend))
        rows = np.vstack(
            (let_go[is_used] / variance**0.5, halted[after_kept] / after_variance**0.5)
        )
        weighted_values = np.append(
            values[is_used] / variance**0.5, slips.after[after_kept] / after_variance**0.5
        )
        inverse = np.linalg.inv(rows.T @ rows + np.diag(prior))
        prior_mean = np.zeros(prior.size)
        prior_mean[4] = SINCE[0]
        best = inverse @ (rows.T @ weighted_values + prior * prior_mean)
        level = float(best[0])
        spread, is_used = _residual_spread(values - let_go @ best, 2.0 + 0.5 * bends)
        after_spread, after_kept = _residual_spread(slips.after - halted @ best, 2.0 + 0.5 * bends)
    # The mean slope is that between the ends, where odd shapes are 1 and -1, and even ones are
    # equal.
    chord = np.zeros(best.size)
    chord[5::2] = 1.0 / half_range
    combinations = np.stack((np.eye(best.size)[0], np.eye(best.size)[1], chord))
    return _Levels(
        weight=_weight(int(is_used.sum()), variance, unusual),
        level=level,
        kinetic=float(best[1]),
        covariance=combinations @ inverse @ combinations.T,
        scatter=scatter,
        rate=float(np.median(np.abs(slips.rate))),
        count=int(is_used.sum()),
        unusual=unusual,
        chord=max(1.0 + float(chord @ best), LEAST_CHORD),
    )


def _residual_spread(residuals: Floats, unknown: float) -> tuple[float, Bools]:
    """Spread of ``residuals`` (m,) of a fit with ``unknown`` parameters, and which of them are
    kept; the others count with the limit.
    """
    reach = TRIM * max(1.4826 * float(np.median(np.abs(residuals))), 1e-3)
    is_used = np.abs(residuals) <= reach
    squares = float(np.minimum(residuals**2, reach**2).sum())
    return float(np.sqrt(squares / max(residuals.size - unknown, 1.0))), is_used


def _mean_of_sides(values: Floats, side: Floats) -> tuple[float, float, float, Bools]:
    """Mean, spread and standard error of values (m,), and which of them are kept.

    A wrong zero of the reading shifts the two directions apart and leaves their mean.
    """
    groups = [side < 0.0, side > 0.0]
    if min(np.count_nonzero(group) for group in groups) < FEWEST_OF_A_SIDE:
        groups = [np.ones(values.size, dtype=bool)]
    deviation = np.zeros(values.size)
    for group in groups:
        deviation[group] = values[group] - np.median(values[group])
    reach = TRIM * max(1.4826 * float(np.median(np.abs(deviation))), 1e-3)
    is_used = np.abs(deviation) <= reach
    for group in groups:
        # Where one direction has two groups with the median between them, none of them is an
        # outlier.
        if not (group & is_used).any():
            is_used |= group
    parts = [values[group & is_used] for group in groups]
    # Outliers count with the limit, or leaving them out would look like agreement.
    squares = sum(float(((part - part.mean()) ** 2).sum()) for part in parts)
    squares += reach**2 * float(np.count_nonzero(~is_used))
    variance = squares / max(values.size - len(parts), 1)
    error = np.sqrt(variance * sum(1.0 / part.size for part in parts)) / len(parts)
    mean = float(np.mean([part.mean() for part in parts]))
    return mean, float(np.sqrt(variance)), float(error), is_used


def _kinetic(
    after: Floats, rate: Floats, side: Floats, sigma: float, level: float
) -> tuple[float, float]:
    """The distance after a slip for a command at rest, and its standard error.

    ``after = kinetic + tilt side + since rate`` by least squares with the priors ``TILT`` and
    ``SINCE``: whether a stem sticks or slides on, and the zero of the reading, are not known.
    """
    _, spread, _, is_used = _mean_of_sides(after - SINCE[0] * rate, side)
    variance = max(spread**2, sigma**2, 1e-6)
    columns = np.stack((np.ones(after.size), side, rate), axis=1)[is_used]
    tilt = max(TILT * level, 1e-3)
    precision = np.diag([0.0, variance / tilt**2, variance / SINCE[1] ** 2])
    inverse = np.linalg.inv(columns.T @ columns + precision)
    prior = precision @ np.array([0.0, 0.0, SINCE[0]])
    best = inverse @ (columns.T @ after[is_used] + prior)
    return float(best[0]), float(np.sqrt(variance * inverse[0, 0]))


def _weighted(levels_tried: list[_Levels]) -> Breakaways:
    """The mean over the delays."""
    weights = np.array([levels.weight for levels in levels_tried])
    weights = np.exp(weights - weights.max())
    weights /= weights.sum()

    def mean(name: str) -> float:
        return float(weights @ [getattr(levels, name) for levels in levels_tried])

    chords = np.array([levels.chord for levels in levels_tried])
    return Breakaways(
        count=round(mean("count")),
        level=float(weights @ (np.array([levels.level for levels in levels_tried]) / chords)),
        kinetic=float(weights @ (np.array([levels.kinetic for levels in levels_tried]) / chords)),
        scatter=mean("scatter"),
        rate=mean("rate"),
        tried=tuple(levels_tried),
        weights=weights,
    )
