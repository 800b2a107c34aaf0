"""Whether all breakaways together show dwell, or play, where no trajectory does.

A trajectory is the wrong evidence for these: one unusual breakaway hides what a hundred of them
show together. But each rest of the stem is a trial of its breakaway level. With ``f`` the distance
of the command from the resting stem, towards the motion that it would cause, the stem has held as
long as

    f < L (1 + s e) + b ln(1 + rest/t0) + p (same - 1/2) - min(d r^(2/3), J),

with a level ``L`` for either direction, ``e`` normal, ``same`` 1 where it would go on the way that
it came and 0 where it would turn, and the command's speed ``r``. ``b`` is dwell. ``p`` is play:
after a turn the reading lags by half of it the other way.

``d`` is a packing that gives before it lets go, and lets go the earlier the quicker it is loaded,
which looks like dwell, because a slow force means a long rest. The power is that of the LuGre model
(doi:10.1109/9.376053): below its level ``Fs`` a stem creeps at a speed ``v`` with
``v (1 - F/g(v)) = r/s0``, where the bristles have the stiffness ``s0`` and
``g(v) = Fs (1 - a v^2/vs^2)`` at low speed. With ``e = 1 - F/Fs`` the left side is at most
``2/3 vs e sqrt(e/(3 a))``; where ``r/s0`` is more than that, nothing holds the stem. So it lets go
``e ~ r^(2/3)`` below its level, and never below the kinetic one, which is ``J`` lower.

What is maximised is the likelihood of holding until the sample before the breakaway and of letting
go then, as of any duration that depends on what happened during it (Cox, 1972,
doi:10.1111/j.2517-6161.1972.tb00899.x): a breakaway that comes late by chance has rested longer
for it, and a regression over the rests takes that for dwell. Only breakaways are used with which
the model lets go too: a stem that slides slowly behind its noise seems to rest and start.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple, Self

import numpy as np
from scipy.optimize import minimize

from stemwatch.models.compiled import compiled
from stemwatch.models.mismatch.fit import base_coordinate
from stemwatch.models.mismatch.fit.batched_search import conclude
from stemwatch.models.mismatch.fit.crossfit import CAREFUL, Fitted, refit, scored
from stemwatch.models.mismatch.fit.evaluator import Evaluator
from stemwatch.models.mismatch.likelihood.breakaway_filter import RATE_POWER
from stemwatch.models.mismatch.stem_model import stem as stem_number
from stemwatch.models.mismatch.terms.dwell_dependent_breakaway import T0_S
from stemwatch.models.recording import Floats
from stemwatch.models.stickslip.onsets import Samples
from stemwatch.models.stickslip.parameters import Bounds

DWELL, PLAY = "dwell_dependent_breakaway", "lost_motion"
FEWEST_EVENTS = 8
FEWEST_EACH_WAY = 3  # breakaways after a turn, and on the same way, that tell play
# Dwell is a rise for each e-fold of rest. Where nine rests of ten lie within less than one, that is
# an extrapolation, and in so steady a cycle the command's speed decides how long the stem rests:
# the rests of a loop that slips every 7 s spread by 0.9, those of ten with dwell by 1.1 to 2.6
# (seed 4062).
LEAST_SPREAD = 1.0
# Of 195 simulated valves with nothing hidden, 12 % scatter and bristles among them, dwell reaches
# 3.3 (with a size just below LEAST_SIZE) and 2.9, play 3.1 and 2.5 (`draw_nulls`, seeds 4063 to
# 4065). A spring with hysteresis reaches 4 to 7 of play.
LEAST_Z = {DWELL: 3.0, PLAY: 4.0}
# Least t of the trajectories with what the breakaways tell: dwell they need not show, and must not
# contradict. Play they show (1.4 to 2.4 on seven valves, seed 4096); a spring with hysteresis, of
# whose breakaways the same is seen, they do not (-0.2 on one).
LEAST_T = {DWELL: -1.0, PLAY: 1.0}
LEAST_SIZE = {DWELL: 0.1, PLAY: 0.3}  # percent of span per e-fold of rest, percent of travel
MOST_SIZE = {DWELL: 1.0, PLAY: 6.0}
# Of the size (dwell: the usual rise), how much of it S and J alone have fitted as S and as J. Dwell
# raises the breakaway only, and so both; play is a part of S, or has been taken away from J.
LESS = {DWELL: ((1.0, 1.0),), PLAY: ((0.0, -1.0), (0.5, -0.5), (1.0, 0.0))}
SEEN_JUMP, ABOVE_NOISE = 0.4, 4.0  # shares of J, standard deviations: a slip that is seen as one
# ``d`` in shares of the level: where its search begins, and its limit either way. A search that
# begins without any may end there although more of it explains the breakaways better, which is then
# taken for dwell.
RATE_STARTS, MOST_BY_RATE = (0.0, 0.4), 3.0
ODD = 0.04  # share of the breakaways that something else caused
ODD_WIDTH, ODD_LEAST = 0.4, 1e-3
LONGEST_MEAN = 40  # samples over which a resting position is averaged
_UP, _DOWN, _SCATTER, _BY_REST, _BY_WAY, _BY_RATE, _MOST_BY_RATE = range(7)
_SMALLEST = 1e-6
STEP = 1e-4  # of differences for slopes


class _Rests(NamedTuple):
    """The rests of a stem, samples ``first`` to ``last`` (m,), the last that of the breakaway to
    ``side`` (m,); the motion before was to ``before`` (m,), 0 where none was.

    Over the samples (n,): ``distance`` of the force from the resting stem, percent; ``raised`` by
    how much its levels are above the usual ones there, percent; ``rest`` ln(1 + rest/t0); ``rate``
    the force's speed in percent/s to the power 2/3.
    """

    first: Samples
    last: Samples
    side: Floats
    before: Floats
    distance: Floats
    raised: Floats
    rest: Floats
    rate: Floats


@dataclass(frozen=True)
class BreakawayEvidence:
    """An effect ``slug`` and its ``size`` (percent of span per e-fold of rest, or percent of
    travel) with its standard ``error`` and normal score ``z``, the lesser of that alone and that
    beside the other effect; ``usual`` is the mean of ``ln(1 + rest/t0)``, ``events`` the number of
    breakaways. ``rate_z`` is the score of letting go earlier the quicker it is loaded, beside the
    effect."""

    slug: str
    size: float
    z: float
    usual: float
    events: int
    rate_z: float

    @property
    def error(self) -> float:
        """The standard error of the size."""
        return abs(self.size) / max(abs(self.z), _SMALLEST)

    @property
    def convincing(self) -> bool:
        """True where the score is beyond what valves without the effect show, and the size one
        that matters and that it can have."""
        if self.z < LEAST_Z[self.slug]:
            return False
        return LEAST_SIZE[self.slug] <= self.size <= MOST_SIZE[self.slug]


def breakaway_evidence(evaluator: Evaluator, fitted: Fitted) -> list[BreakawayEvidence]:
    """What the breakaways tell of dwell and play beside what is ``fitted``, the higher score first.

    One that is not convincing alone is not sought beside the other, nor what the rate does to it.
    Empty with fewer than eight breakaways, and where an archive drew lines, so that the time of a
    breakaway is not known well enough. Without dwell where all rests are about as long.
    """
    if evaluator.slack.any():
        return []
    middle = fitted.candidates.mean(axis=0)
    rests = _rests(evaluator, fitted, middle)
    if rests.side.size < FEWEST_EVENTS:
        return []
    S, ratio = middle[base_coordinate.S_PERCENT], middle[base_coordinate.RATIO]
    level = max(0.5 * float(S * (1.0 + ratio)), 0.3)
    starts = _starts(rests, level, float(S * ratio))
    found = [_best(rests, level, start, (_BY_RATE,)) for start in starts]
    neither = max(value for value, _ in found)
    starts = [start for _, start in found]
    with_dwell, of_dwell = _best_of(rests, level, starts, (_BY_RATE, _BY_REST))
    with_play, of_play = _best_of(rests, level, starts, (_BY_RATE, _BY_WAY))
    rested = rests.rest[rests.last]
    spread = float(np.ptp(np.percentile(rested, (5.0, 95.0))))
    count, goes_on = rests.side.size, np.count_nonzero(rests.side == rests.before)
    tells_way = min(goes_on, count - goes_on) >= FEWEST_EACH_WAY
    found_of = {DWELL: (_BY_REST, with_dwell, of_dwell), PLAY: (_BY_WAY, with_play, of_play)}
    answers = [
        BreakawayEvidence(
            slug,
            float(numbers[place]),
            _z(with_it - neither, float(numbers[place])),
            float(np.mean(rested)),
            int(count),
            0.0,
        )
        for slug, (place, with_it, numbers) in found_of.items()
        if (spread >= LEAST_SPREAD if slug == DWELL else tells_way)
    ]
    if any(answer.convincing for answer in answers):
        both = _best_of(rests, level, [of_dwell, of_play], (_BY_RATE, _BY_REST, _BY_WAY))
        answers = [
            _beside(rests, level, found_of, both, one) if one.convincing else one for one in answers
        ]
    return sorted(answers, key=lambda answer: -answer.z)


def _beside(
    rests: _Rests,
    level: float,
    found_of: Mapping[str, tuple[int, float, Floats]],
    both: tuple[float, Floats],
    answer: BreakawayEvidence,
) -> BreakawayEvidence:
    """An ``answer`` with its score beside the other effect as well, and with that of the rate;
    ``found_of`` has, for either effect, its place among the numbers, the best log likelihood with
    it alone, and the numbers (7,) of that; ``both`` the likelihood and numbers with both.
    """
    with_both, of_both = both
    place, with_it, numbers = found_of[answer.slug]
    (without,) = (value for slug, (_, value, _) in found_of.items() if slug != answer.slug)
    return replace(
        answer,
        z=min(answer.z, _z(with_both - without, float(of_both[place]))),
        rate_z=_rate_z(rests, level, numbers, with_it, place),
    )


def _rate_z(rests: _Rests, level: float, numbers: Floats, value: float, place: int) -> float:
    """The score of what the rate does in the best ``numbers`` (7,), whose log likelihood is
    ``value``, beside that at ``place``."""
    without = numbers.copy()
    without[_BY_RATE] = 0.0
    return _z(value - _best(rests, level, without, (place,))[0], float(numbers[_BY_RATE]))


def _starts(rests: _Rests, level: float, jump: float) -> list[Floats]:
    """Numbers (7,) to begin with: breakaways of about the ``level``, whatever the rate does."""
    usual = float(np.mean(rests.rate[rests.last]))
    starts = []
    for share in RATE_STARTS:
        held = level + min(share * level * usual, jump)
        starts.append(np.array([held, held, math.log(0.08), 0.0, 0.0, share * level, jump]))
    return starts


def _z(gained: float, size: float) -> float:
    """The signed root of twice a gain of the log likelihood: a normal score by chance alone."""
    return math.copysign(math.sqrt(2.0 * max(gained, 0.0)), size)


class _FittedStem(NamedTuple):
    """Of a candidate, over the samples (n,): the ``force`` on the stem, percent; where it is, by
    its ``reading``, percent of travel; and by how much its levels are ``raised`` there above those
    at the beginning, percent."""

    force: Floats
    place: Floats
    raised: Floats

    @classmethod
    def of(cls, evaluator: Evaluator, fitted: Fitted, candidate: Floats, reading: Floats) -> Self:
        """That of a ``candidate`` (size,) where the stem is read at ``reading`` (n,), percent."""
        forces, (row,), (q,), tables = evaluator.laid_out(fitted.layout, candidate[None])
        force = forces[row]
        since = np.arange(reading.size) / reading.size
        offset = q[stem_number.ZERO] + q[stem_number.DRIFT] * (since - 0.5)
        if q[stem_number.BY_TIME] != 0.0:
            offset = offset + tables.wander[0, : reading.size]
        place = (reading - offset - 50.0) / q[stem_number.GAIN] + 50.0
        level = 0.5 * (q[stem_number.S] + q[stem_number.J])
        raised, pushing = level * q[stem_number.GROWTH] * since, np.zeros(reading.size)
        if q[stem_number.BY_PLACE] != 0.0:
            raised = raised + np.interp(place, stem_number.places(), tables.friction[0])
            pushing = np.interp(place, stem_number.places(), tables.force[0])
        return cls(force - pushing, place, raised)


def _rests(evaluator: Evaluator, fitted: Fitted, candidate: Floats) -> _Rests:
    """The rests that end with a slip which the model of ``candidate`` makes too."""
    problem, onsets = evaluator.problem, evaluator.onsets
    mv, interval_s = problem.mv, problem.interval_s
    _, early_late = evaluator.assimilated(fitted.layout, candidate)
    jump = candidate[base_coordinate.S_PERCENT] * candidate[base_coordinate.RATIO]
    reading, rest = mv.copy(), np.zeros(mv.size)
    kept: list[tuple[int, int, float, float]] = []
    before = 0.0
    for at, side, rested, place, agrees in zip(
        onsets.at, onsets.side, onsets.rested, onsets.place, early_late != 0.0, strict=True
    ):
        first, after = max(int(at - rested), 0) + 1, min(int(at) + 1, mv.size - 1)
        slip = abs(float(np.median(mv[at : at + 3])) - place)
        way = float(side)
        if (
            agrees
            and at - first >= 2
            and jump > ABOVE_NOISE * problem.sigma
            and slip >= SEEN_JUMP * jump
            and way * (mv[after] - place) > 0.0
            and np.isfinite(mv[first:at]).all()
        ):
            reading[first : at + 1] = np.mean(mv[first:at][-LONGEST_MEAN:])
            rest[first : at + 1] = np.log1p(np.arange(1, at - first + 2) * interval_s / T0_S)
            kept.append((first, int(at), way, before))
        before = way
    columns = np.array(kept, dtype=np.float64).reshape(-1, 4).T
    begins, ends = columns[0].astype(np.int64), columns[1].astype(np.int64)
    stem = _FittedStem.of(evaluator, fitted, candidate, reading)
    rate = (np.abs(np.diff(stem.force, prepend=stem.force[0])) / interval_s) ** RATE_POWER
    sides = columns[2].copy(), columns[3].copy()
    return _Rests(begins, ends, *sides, stem.force - stem.place, stem.raised, rest, rate)


def _best_of(
    rests: _Rests, level: float, starts: Iterable[Floats], more: tuple[int, ...]
) -> tuple[float, Floats]:
    """The best of what ``_best`` finds from each of ``starts``."""
    return max((_best(rests, level, start, more) for start in starts), key=lambda best: best[0])


def _best(rests: _Rests, level: float, start: Floats, more: Iterable[int]) -> tuple[float, Floats]:
    """The largest log likelihood and its numbers (7,), ``more`` of them free beside the levels and
    the scatter."""
    free = np.array([_UP, _DOWN, _SCATTER, *more])
    unit = np.array([level, level, 1.0, 1.0, 1.0, level])[free]
    reach = (
        (0.2 * level, 5.0 * level),
        (0.2 * level, 5.0 * level),
        (-4.0, -0.7),
        (-3.0, 3.0),
        (-8.0, 8.0),
        (-MOST_BY_RATE * level, MOST_BY_RATE * level),
    )
    numbers = start.copy()

    def missing(scaled: Floats) -> tuple[float, Floats]:
        numbers[free] = scaled * unit
        value, slope = _with_slope(numbers, free, *rests)
        return -value, -slope * unit

    bounds = [(reach[i][0] / u, reach[i][1] / u) for i, u in zip(free, unit, strict=True)]
    found = minimize(missing, start[free] / unit, jac=True, method="L-BFGS-B", bounds=bounds)
    best = start.copy()
    best[free] = found.x * unit
    return -float(found.fun), best


@compiled()
def _below(score: float) -> float:
    """The normal distribution function."""
    return 0.5 * math.erfc(-score / 1.4142135623730951)


@compiled()
def _asked_of(
    numbers: Floats,
    first: Samples,
    last: Samples,
    before: Floats,
    distance: Floats,
    levels: Floats,
    rest: Floats,
    rate: Floats,
    asked: Floats,
) -> None:
    """The largest force that each rest has asked for, beyond what its levels were raised by, into
    ``asked`` (m, 6): at its first sample, up to two samples before the breakaway, and with it,
    rising and falling, percent. The levels and their scatter are not asked for."""
    for i in range(first.size):
        play = 0.5 * numbers[_BY_WAY] * before[i]
        rose = fell = held_up = held_down = begun_up = begun_down = -1e9
        for k in range(first[i], last[i] + 1):
            if k == last[i] - 1:
                held_up, held_down = rose, fell
            sooner = min(numbers[_BY_RATE] * rate[k], numbers[_MOST_BY_RATE])
            raised = levels[k] + numbers[_BY_REST] * rest[k] - sooner
            rose = max(rose, distance[k] - raised - play)
            fell = max(fell, play - distance[k] - raised)
            if k == first[i]:
                begun_up, begun_down = rose, fell
        asked[i, 0], asked[i, 1], asked[i, 2] = begun_up, max(held_up, begun_up), rose
        asked[i, 3], asked[i, 4], asked[i, 5] = begun_down, max(held_down, begun_down), fell


@compiled()
def _log_likelihood(numbers: Floats, side: Floats, asked: Floats) -> float:
    """Of all rests: each level held up to two samples before the breakaway, and the one to its side
    gave way then; the sampling of OP does not tell it better. ``asked`` as of ``_asked_of``."""
    up, down, total = 1.0 / numbers[_UP], 1.0 / numbers[_DOWN], 0.0
    wide = math.exp(-numbers[_SCATTER])
    for i in range(side.size):
        begun, held, most = asked[i, 0] * up, asked[i, 1] * up, asked[i, 2] * up
        gave_way = side[i] > 0.0
        total += _of_one_way(most - 1.0, held - 1.0, begun - 1.0, wide, gave_way)
        begun, held, most = asked[i, 3] * down, asked[i, 4] * down, asked[i, 5] * down
        gave_way = side[i] < 0.0
        total += _of_one_way(most - 1.0, held - 1.0, begun - 1.0, wide, gave_way)
    return total


@compiled()
def _of_one_way(most: float, held: float, begun: float, wide: float, gave_way: bool) -> float:
    """The log likelihood of one rest and one direction: where the force over its level, less 1, was
    ``begun`` first, ``held`` before the breakaway and ``most`` with it."""
    so_far = max(1.0 - _below(begun * wide), 1e-6)
    if gave_way:
        share = (_below(most * wide) - _below(held * wide)) / so_far
        odd = _below(most / ODD_WIDTH) - _below(held / ODD_WIDTH) + ODD_LEAST
    else:
        share, odd = (1.0 - _below(held * wide)) / so_far, 1.0
    return math.log((1.0 - ODD) * share + ODD * odd)


@compiled()
def _with_slope(
    numbers: Floats,
    free: Samples,
    first: Samples,
    last: Samples,
    side: Floats,
    before: Floats,
    distance: Floats,
    levels: Floats,
    rest: Floats,
    rate: Floats,
) -> tuple[float, Floats]:
    """The log likelihood, and its slopes along the ``free`` numbers by differences."""
    asked, other = np.empty((side.size, 6)), np.empty((side.size, 6))
    _asked_of(numbers, first, last, before, distance, levels, rest, rate, asked)
    value = _log_likelihood(numbers, side, asked)
    slope, moved = np.empty(free.size), numbers.copy()
    for i in range(free.size):
        moved[free[i]] += STEP
        if free[i] > _SCATTER:
            _asked_of(moved, first, last, before, distance, levels, rest, rate, other)
            beside = _log_likelihood(moved, side, other)
        else:  # levels and scatter ask for nothing else
            beside = _log_likelihood(moved, side, asked)
        slope[i] = (beside - value) / STEP
        moved[free[i]] = numbers[free[i]]
    return value, slope


def refit_with_size(evaluator: Evaluator, neutral_fit: Fitted, seen: BreakawayEvidence) -> Fitted:
    """``neutral_fit``, a fit with the term at neutral, refitted with the size that was ``seen``.

    The size is held within two standard errors of that value: trajectories are hardly sensitive to
    it, and the fit would trade it for another S and J.
    """
    coordinate_slice = neutral_fit.layout.places[seen.slug]
    low, high = neutral_fit.layout.bounds.low.copy(), neutral_fit.layout.bounds.high.copy()
    low[coordinate_slice] = max(seen.size - 2.0 * seen.error, LEAST_SIZE[seen.slug])
    high[coordinate_slice] = min(seen.size + 2.0 * seen.error, MOST_SIZE[seen.slug])
    layout = replace(neutral_fit.layout, bounds=Bounds(low, high))
    starts = [
        layout.bounds.clip(_with_size(neutral_fit.candidates, coordinate_slice, seen, *parts))
        for parts in LESS[seen.slug]
    ]
    first = conclude(evaluator, scored(layout, starts[0]))
    return conclude(evaluator, refit(evaluator, first, CAREFUL, *starts[1:]))


def _with_size(
    candidates: Floats,
    coordinate_slice: slice,
    seen: BreakawayEvidence,
    S_less: float,
    J_less: float,
) -> Floats:
    """(2, size) the candidates with the size that was seen, and S and J less their parts of it."""
    changed = candidates.copy()
    S = candidates[:, base_coordinate.S_PERCENT]
    J = S * candidates[:, base_coordinate.RATIO]
    by = seen.size * (seen.usual if seen.slug == DWELL else 1.0)
    S_then = np.maximum(S - S_less * by, 0.1 * S)
    J_then = np.clip(J - J_less * by, 0.0, S_then)
    changed[:, base_coordinate.S_PERCENT] = S_then
    changed[:, base_coordinate.RATIO] = J_then / np.maximum(S_then, _SMALLEST)
    changed[:, coordinate_slice] = seen.size
    return changed
