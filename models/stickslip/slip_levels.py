"""Breakaway and kinetic level of a stem whose command is known at the samples only.

Where a loop answers a slip before the next sample is kept, no sample holds the command at which the
stem let go. It lies between two bounds: the farthest command at which the stem was seen at rest,
and the command extrapolated to the next sample. With the level ``L`` of a packing that scatters by
``s`` from one breakaway to the next, a zero ``z`` of the reading, and bounds ``a, b`` of each slip
to the side ``w`` (1 rising, -1 falling), the likelihood is

    product of ((1 - e) (F((b - L - z w)/s) - F((a - L - z w)/s))/(b - a) + e/range)

with the normal distribution ``F`` and a share ``e`` of onsets that are no slips: the likelihood of
interval-censored observations (Turnbull 1976, doi:10.1111/j.2517-6161.1976.tb01597.x). Where the
stem stops, it is the kinetic level behind the farthest command since, which has the same bounds. A
set-point step in the sample of a slip only widens its bounds, so that the slip has little weight.

Only the reading's gain and zero come from a fit: a free run whose command lost its peaks is wrong
by as much as the command.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtr

from stemwatch.models.recording import Bools, Floats
from stemwatch.models.stickslip.breakaways import LEAST_J, distances
from stemwatch.models.stickslip.onsets import Samples, least_departure, onsets
from stemwatch.models.stickslip.problem import FitProblem

FEWEST = 8
FEWEST_OF_A_SIDE = 4
LEAST_JUMP, LEAST_JUMP_PERCENT = 0.35, 0.15  # of the usual jump: an onset that is a slip; percent
NARROW, WIDE = 2.0, 3.0  # of the usual distance of the bounds
STRAY = 0.08  # share of onsets that are not slips
LEVELS, REACH = 81, 1.3  # grid; of the farthest bound
SCATTERS = (0.01, 0.03, 0.06, 0.1, 0.15, 0.25)  # of the usual level
ZEROS, ZERO_REACH = 9, 0.25  # of the usual level
# Shares of the distance of the bounds. A command slows down before it turns, so a stem lets go
# nearer to the first bound than to the second (SLOWED); after a slip it is dragged on before the
# command turns (DRAGGED). Means of 30 sticking valves of `stemwatch robustness` (seeds 5151, 6161,
# 9393) kept every 5 and 10 s. The bounds of an average lie about the time of the slip that its
# value tells, so nothing is to be taken off them: with SLOWED the levels of 19 such valves (5151,
# 9393) were too low by a seventh of the distance, and of 23 others (6161, 8383) by a fifth.
SLOWED, DRAGGED = 0.2, 0.28
# Standard deviations over loops, as shares of the distance of the bounds, of an error that both
# levels have in common, twice of which is in S and nothing in J, and of opposite errors of the two,
# twice of which is in J and nothing in S. Calibrated on 26 of these valves (5151, 9393, 8383) kept
# every 5 and 10 s, and on the 42 behind averages.
OVER_LOOPS, BETWEEN_LEVELS = 0.07, 0.12
OVER_AVERAGES, BETWEEN_AVERAGES = 0.15, 0.15
MODEL_ERROR = 0.02  # of the level, for either level, as for breakaways that are read at a sample
# A slip is seen where it leaves the noise (``onsets.least_departure``). Of those about that size
# only the larger ones are, so that J comes out too large by this share of it, half of it in either
# level, and S does not: 0.43 of it behind averages of 10 s, 0.37 every 5 and 10 s (115 recordings
# of 69 sticking valves of `stemwatch robustness`, seeds 5151, 7171, 8181; either half of the seeds
# takes a third off the error of J in the other).
UNSEEN_SHARE = 0.4
WITHIN = 0.3  # of the command's move in a sample: the time of a slip within its average


@dataclass(frozen=True)
class SlipLevels:
    """``count`` slips; both levels with their own standard errors, that of an error ``common`` to
    both, and that of one by which they are moved ``apart``, percent of OP; ``bounds`` is how far
    apart the bounds of a slip are, and ``per_sample`` how far OP goes in the sample of a slip,
    percent of OP (medians)."""

    count: int
    level: float
    level_error: float
    kinetic: float
    kinetic_error: float
    common: float
    apart: float
    bounds: float
    per_sample: float

    @property
    def may_slide(self) -> bool:
        """Whether a slip is no larger than what OP goes in its sample, or than what looks like
        creep: a stem that slides on with its command, without any jump, would be seen at the same
        places."""
        return self.J <= max(self.per_sample, LEAST_J)

    @property
    def S(self) -> float:
        """Dead band plus stick band, percent of OP."""
        return self.level + self.kinetic

    @property
    def J(self) -> float:
        """Slip jump, percent of OP."""
        return max(self.level - self.kinetic, 0.0)

    @property
    def S_error(self) -> float:
        """Standard error of S, the sum of the levels, percent of OP."""
        return float(np.hypot(self._own_errors, 2.0 * self.common))

    @property
    def J_error(self) -> float:
        """Standard error of J, the difference of the levels, percent of OP."""
        return float(np.hypot(self._own_errors, 2.0 * self.apart))

    @property
    def _own_errors(self) -> float:
        return float(np.hypot(self.level_error, self.kinetic_error))


@dataclass(frozen=True)
class Slips:
    """Slips (m,): their direction, the bounds of the command at the breakaway, the farthest command
    possible until the stem's new place was read, and the size of the jump, percent of OP; OP's
    speed after the sample of a slip as a share of that before it. ``sigma`` is the noise of the
    position, percent of OP.
    """

    side: Floats
    low: Floats
    high: Floats
    farthest: Floats
    jump: Floats
    speed: Floats
    sigma: float
    averaged: bool = False

    @property
    def answered(self) -> float:
        """OP's speed after a slip as a share of that before it (median): 1 where the loop has not
        answered yet."""
        return float(np.median(self.speed))

    @property
    def let_go(self) -> tuple[Floats, Floats]:
        """Bounds of the breakaway level (m,), percent of OP."""
        slowed = 0.0 if self.averaged else SLOWED
        return self.low, self.high - slowed * (self.high - self.low)

    @property
    def stayed_behind(self) -> tuple[Floats, Floats]:
        """Bounds of the kinetic level (m,), percent of OP."""
        dragged = DRAGGED * (self.high - self.low)
        return self.low + dragged - self.jump, self.farthest - self.jump

    @property
    def middle(self) -> tuple[float, float]:
        """Both levels as the medians between their bounds: near those of the likelihood, at a
        hundredth of its cost."""
        return _middle(*self.let_go), _middle(*self.stayed_behind)

    def only(self, chosen: Bools) -> Slips:
        """Those of the slips that are chosen."""
        names = ("side", "low", "high", "farthest", "jump", "speed")
        return replace(self, **{name: getattr(self, name)[chosen] for name in names})


def _middle(low: Floats, high: Floats) -> float:
    return float(np.median(0.5 * (low + high)))


def slip_levels(slips: Slips) -> SlipLevels:
    """Both levels from ``slips``."""
    level, level_error = _censored(*slips.let_go, slips.side, 0.5 * slips.sigma)
    kinetic, kinetic_error = _censored(*slips.stayed_behind, slips.side, slips.sigma, level)
    unseen = min(0.5 * UNSEEN_SHARE * least_departure(slips.sigma), 0.5 * max(level - kinetic, 0.0))
    level, kinetic = level - unseen, kinetic + unseen
    usual_width = float(np.median(slips.high - slips.low))
    model_error = MODEL_ERROR * level
    return SlipLevels(
        count=slips.side.size,
        level=level,
        level_error=float(np.hypot(level_error, model_error)),
        kinetic=kinetic,
        kinetic_error=float(np.hypot(kinetic_error, model_error)),
        common=usual_width * (OVER_AVERAGES if slips.averaged else OVER_LOOPS),
        apart=usual_width * (BETWEEN_AVERAGES if slips.averaged else BETWEEN_LEVELS),
        bounds=usual_width,
        per_sample=usual_width / (2.0 * WITHIN) if slips.averaged else usual_width,
    )


def seen_slips(
    problem: FitProblem, gain: float, zero: float, *, averaged: bool = False
) -> Slips | None:
    """The slips of a recorded position, or ``None`` where too few are seen.

    ``gain`` is MV's percent for one of OP and ``zero`` its offset, percent of MV; ``averaged``
    whether a sample is the average over its interval.
    """
    if gain == 0.0:
        return None
    found_onsets = onsets(problem.mv, problem.scored, problem.sigma, problem.interval_s)
    away_from_ends = (found_onsets.at >= 3) & (found_onsets.at < problem.op.size - 2)
    if np.count_nonzero(away_from_ends) < FEWEST:
        return None
    starts, side, places = (
        found_onsets.at[away_from_ends],
        found_onsets.side[away_from_ends],
        (found_onsets.place[away_from_ends] - zero) / gain,
    )
    stem, direction = (problem.mv - zero) / gain, side * np.sign(gain)
    last_before = distances(
        stem, problem.op, starts, direction, found_onsets.rested[away_from_ends], places
    )[0]
    ahead = [direction * (problem.op[starts + step] - places) for step in (-3, -2, -1, 0, 1)]
    before = ahead[2] - ahead[1]
    speed = np.stack((before, 0.5 * (ahead[2] - ahead[0])))
    if averaged:
        low, high = _of_averages(direction, places, stem, starts, ahead, speed, last_before)
        # The average over the sample of a slip lies between the old and the new place.
        jump, farthest = direction * (stem[starts + 1] - places), np.maximum(high, ahead[4])
    else:
        low, high = last_before, np.maximum(ahead[2] + np.maximum(speed.max(axis=0), 0.0), ahead[3])
        high = np.maximum(high, last_before)
        jump, farthest = direction * (stem[starts] - places), high
    no_travel = np.abs(before) < 1e-9
    answered_share = np.where(
        no_travel, 1.0, (ahead[4] - ahead[3]) / np.where(no_travel, 1.0, before)
    )
    sigma = problem.sigma / abs(gain)
    return _chosen(Slips(direction, low, high, farthest, jump, answered_share, sigma, averaged))


def _of_averages(
    direction: Floats,
    places: Floats,
    stem: Floats,
    starts: Samples,
    ahead: list[Floats],
    speed: Floats,
    last_before: Floats,
) -> tuple[Floats, Floats]:
    """Bounds of the command at a slip within an average: the value of the average between the old
    and the new place gives the time of the slip in its interval.
    """
    whole_move, part = direction * (stem[starts + 1] - places), direction * (stem[starts] - places)
    share = np.clip(part / np.where(whole_move > 0.0, whole_move, np.inf), 0.0, 1.0)
    share = np.where(whole_move > 0.0, share, 1.0)
    mean = speed.mean(axis=0)
    then, within = ahead[2] + mean * (1.5 - share), WITHIN * np.abs(mean)
    low = np.maximum(np.maximum(then - within, 0.0), last_before - 0.5 * np.abs(mean))
    high = np.maximum(then + within, low)
    stepped = np.maximum(ahead[3] - np.abs(mean), ahead[4] - 2.0 * np.abs(mean)) > high
    return low, np.where(stepped, np.maximum(ahead[3], ahead[4]), high)


def _chosen(slips: Slips) -> Slips | None:
    """The onsets that are slips, and not a stem that creeps or follows its command; ``None`` where
    too few are left.
    """
    width, moved = slips.high - slips.low, slips.jump > LEAST_JUMP_PERCENT
    if np.count_nonzero(moved) < FEWEST:
        return None
    narrow = moved & (width <= NARROW * np.median(width[moved]) + 0.1)
    usual_jump = float(np.median(slips.jump[narrow])) if narrow.any() else 0.0
    slipped = slips.jump - 0.5 * width >= LEAST_JUMP * usual_jump
    slipped |= moved & (width > WIDE * np.median(width))
    return slips.only(slipped) if np.count_nonzero(slipped) >= FEWEST else None


def _censored(
    low: Floats, high: Floats, side: Floats, noise: float, farthest: float | None = None
) -> tuple[float, float]:
    """Mean and standard error of the level from the bounds of each slip (m,), percent."""
    top = REACH * (float(np.percentile(high, 98.0)) if farthest is None else farthest) + 0.5
    usual_middle = max(float(np.median(0.5 * (low + high))), 0.3)
    zeros = np.linspace(-ZERO_REACH, ZERO_REACH, ZEROS) * max(usual_middle, 0.5)
    if min(np.count_nonzero(side > 0.0), np.count_nonzero(side < 0.0)) < FEWEST_OF_A_SIDE:
        zeros = np.zeros(1)
    levels, scatters = np.linspace(0.0, top, LEVELS), np.array(SCATTERS) * usual_middle
    spread = np.hypot(scatters, noise)[None, None, :, None]
    centre = levels[:, None, None, None] + zeros[None, :, None, None] * side
    slack = 1e-3
    share = ndtr((high + slack - centre) / spread) - ndtr((low - slack - centre) / spread)
    density = (1.0 - STRAY) * share / (high - low + 2.0 * slack) + STRAY / top
    log = np.log(density).sum(axis=-1)
    weights = np.exp(log - log.max())
    weights = weights.sum(axis=(1, 2)) / weights.sum()
    mean = float(weights @ levels)
    # The step of the grid is part of the error.
    step = top / (LEVELS - 1)
    return mean, float(np.sqrt(weights @ (levels - mean) ** 2 + step**2 / 12.0))
