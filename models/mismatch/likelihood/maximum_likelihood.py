"""The most likely parameters of a hypothesis, where the breakaways scatter (``breakaway_filter``).

Beside its own coordinates a hypothesis has two of the record: the logarithms of the scale of the
readings' noise and of the scatter of the levels. A climb follows the slopes of the logarithm of the
likelihood. How curved that is, the slopes of the single blocks of time tell, as Berndt, Hall, Hall
and Hausman propose (1974, Annals of Economic and Social Measurement 3, 653): no second derivatives
are needed. What it misses, where a stem that sticks a sample sooner makes a small step in it, steps
along the single coordinates find.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from stemwatch.models.mismatch.fit import base_coordinate
from stemwatch.models.mismatch.fit.crossfit import Fitted
from stemwatch.models.mismatch.fit.evaluator import CoordinateLayout, Evaluator
from stemwatch.models.mismatch.likelihood.breakaway_filter import GIVEN_UP, log_likelihoods
from stemwatch.models.mismatch.stem_model.kernel import Record
from stemwatch.models.mismatch.stem_model.lane_rows import LANES
from stemwatch.models.recording import Bools, Floats
from stemwatch.models.signals.forensics import position_step
from stemwatch.models.stickslip.onsets import Samples

COURSES = 12  # with 16 the likelihood is the same to a tenth
FEW_COURSES = 4  # of a first look
MORE_ROUNDS = 2  # of a first look, after its first step
OF_RECORD = 2  # coordinates of the record, the last of a point
# Of the level. A wider scatter than that of real stems would take the place of what is missing, so
# searches stop at 0.15. Simulated stems scatter by up to 0.12, and the breakaways of one record by
# more: of twelve with that scatter and nothing hidden eight end at the limit (seed 2119).
FIRST_SCATTER, OF_STEMS, SCATTERS, RELEASED = 0.05, 0.12, (0.01, 0.15), 0.2
SIGMAS = (0.02, 7.0)  # of the noise that is estimated from the readings
OF_A_STEP = 0.1  # of a coarse step, from which the noise of its readings is looked for
SLOPE_STEP = 0.004  # of the range of a coordinate, over which slopes are taken
BEGUN_FROM = 3  # starts that are climbed from
BEHIND = 50.0  # a run that falls so far behind the best is given up
ROUNDS, ALONE_ROUNDS = 8, 3  # of a climb, and of steps along single coordinates
TRIES = 4  # shorter steps of a round
WORTH_ANOTHER = 0.3  # gain of a round
SHORTER, LONGER = 0.4, 1.6  # steps along a coordinate, after a loss and after a gain


def _is_whole(by_block: Floats) -> bool:
    """Whether a run was followed to its end."""
    return bool((by_block > GIVEN_UP).all())


def _falls_behind(by_block: Floats, far_behind: Floats) -> bool:
    """Whether a run is so much less likely at the end of some block that it is given up there."""
    return bool((np.cumsum(by_block) < far_behind).any())


@dataclass(frozen=True)
class Likeliest:
    """The most likely ``point`` (size + 2,) of a layout that was found, and the logarithm of the
    likelihood of each scored block there."""

    layout: CoordinateLayout
    point: Floats
    by_block: Floats

    @cached_property
    def total(self) -> float:
        """The logarithm of the likelihood of the record."""
        return float(self.by_block.sum())

    @cached_property
    def far_behind(self) -> Floats:
        """(blocks,) the logarithm of the likelihood up to the end of each block, less what a run
        may fall behind it."""
        return np.asarray(np.cumsum(self.by_block) - BEHIND)

    @property
    def candidate(self) -> Floats:
        """(size,) the coordinates of the hypothesis."""
        return self.point[:-OF_RECORD]

    @property
    def of_record(self) -> Floats:
        """(2,) the logarithms of the noise, percent, and of the scatter."""
        return self.point[-OF_RECORD:]

    @property
    def noise(self) -> float:
        """The scale of the readings about the stem, percent."""
        return float(np.exp(self.point[-OF_RECORD]))

    @property
    def scatter(self) -> float:
        """The scatter of the breakaway levels, a share of them."""
        return float(np.exp(self.point[-1]))


@dataclass(frozen=True)
class RecordLikelihood:
    """The likelihood of the record of an ``evaluator`` by its hypotheses; ``courses`` of the stem
    are kept at most, and breakaways scatter by ``widest`` at most, a share of their level."""

    evaluator: Evaluator
    courses: int = COURSES
    widest: float = SCATTERS[1]

    @cached_property
    def _step(self) -> float:
        """The step of coarse readings, percent; 0 where they are fine, or drawn by an archive."""
        evaluator = self.evaluator
        if evaluator.slack.any():
            return 0.0
        return position_step(evaluator.problem.mv[evaluator.measured])

    @cached_property
    def _filled(self) -> Bools:
        return np.asarray(self.evaluator.counts > 0)

    @cached_property
    def _record(self) -> Record:
        problem, none = self.evaluator.problem, np.empty(0, dtype=np.int64)
        return Record(problem.mv, problem.start, none, none, problem.interval_s, 0.0)

    @cached_property
    def _no_least(self) -> Floats:
        return np.full(self.evaluator.problem.n_blocks, -np.inf)

    @cached_property
    def _latest_limits(self) -> list[tuple[CoordinateLayout, tuple[Floats, Floats]]]:
        """The layout that was asked for last, and its limits."""
        return []

    @cached_property
    def first_of_record(self) -> Floats:
        """(2,) noise and scatter to begin with, as logarithms."""
        sigma = self.evaluator.problem.sigma
        if self._step > 0.0:
            sigma = min(sigma, max(OF_A_STEP * self._step, SIGMAS[0] * sigma))
        return np.log([sigma, FIRST_SCATTER])

    def limits(self, layout: CoordinateLayout) -> tuple[Floats, Floats]:
        """The least and the largest point (size + 2,)."""
        latest = self._latest_limits
        if not latest or latest[0][0] is not layout:
            latest[:] = [(layout, self._limits(layout))]
        return latest[0][1]

    def _limits(self, layout: CoordinateLayout) -> tuple[Floats, Floats]:
        sigma = self.evaluator.problem.sigma
        # Values that were drawn between stored ones are as near as the archive draws them.
        least = 1.0 if self.evaluator.slack.any() else SIGMAS[0]
        low = np.log([least * sigma, SCATTERS[0]])
        high = np.log([SIGMAS[1] * sigma, self.widest])
        return np.append(layout.bounds.low, low), np.append(layout.bounds.high, high)

    def of_blocks(
        self, layout: CoordinateLayout, point: Floats, beside: Likeliest | None = None
    ) -> Floats:
        """(filled blocks,) the logarithm of the likelihood of each block that is scored; far less
        where a point falls far behind the one ``beside`` it.
        """
        known_of, least = self.evaluator.likelihoods, self._no_least
        key = layout.hypothesis.slugs, self.courses, point.tobytes()
        known = known_of.get(key)
        if known is not None and (beside is None or not _falls_behind(known, beside.far_behind)):
            return known
        if beside is not None:
            least = least.copy()
            least[self._filled] = beside.far_behind
        found: Floats = self._run(layout, point[None], least)[0]
        if _is_whole(found):
            known_of[key] = found
        return found

    def of_blocks_each(
        self, layout: CoordinateLayout, points: Floats, behind: float = np.inf
    ) -> Floats:
        """(m, filled blocks) what ``of_blocks`` gives of each of ``points`` (m, size + 2); far less
        where one falls ``behind`` the best before it.
        """
        known, slugs = self.evaluator.likelihoods, layout.hypothesis.slugs
        keys = [(slugs, self.courses, point.tobytes()) for point in points]
        if behind < np.inf:  # each is compared with those before it
            new = np.arange(len(keys))
        else:
            new = np.array([i for i, key in enumerate(keys) if key not in known], dtype=np.int64)
        found = self._run(layout, points[new], self._no_least, behind)
        at = dict(zip(new.tolist(), found, strict=True))
        known |= {keys[i]: row for i, row in at.items() if _is_whole(row)}
        return np.array([at[i] if i in at else known[key] for i, key in enumerate(keys)])

    def _run(
        self, layout: CoordinateLayout, points: Floats, least: Floats, behind: float = np.inf
    ) -> Floats:
        """(m, filled blocks) of ``points`` (m, size + 2), whatever is known; given up below
        ``least`` (blocks,), or where one falls ``behind`` the best before it.
        """
        evaluator, least, best = self.evaluator, least.copy(), -np.inf
        by_block = np.empty((points.shape[0], least.size))
        scales = np.exp(points[:, -OF_RECORD:])
        for first in range(0, points.shape[0], LANES):
            part = slice(first, first + LANES)
            best = log_likelihoods(
                *evaluator.laid_out(layout, points[part, :-OF_RECORD]),
                self._record,
                evaluator.problem.block,
                evaluator.slack,
                self._step,
                scales[part],
                self.courses,
                behind,
                best,
                least,
                by_block[part],
            )
        return np.asarray(by_block[:, self._filled])

    def at(
        self, layout: CoordinateLayout, point: Floats, beside: Likeliest | None = None
    ) -> Likeliest:
        """A point, within its limits, and its likelihood, which is of no use where it falls far
        behind the one ``beside`` it."""
        low, high = self.limits(layout)
        point = np.minimum(np.maximum(point, low), high)
        return Likeliest(layout, point, self.of_blocks(layout, point, beside))

    def ranked(self, layout: CoordinateLayout, points: Iterable[Floats]) -> list[Likeliest]:
        """Points (size + 2,) that do not fall far behind, the most likely first."""
        low, high = self.limits(layout)
        within = np.minimum(np.maximum(np.array(list(points)), low), high)
        by_block = self.of_blocks_each(layout, within, BEHIND)
        found = (Likeliest(layout, *both) for both in zip(within, by_block, strict=True))
        followed = (one for one in found if one.total > GIVEN_UP)
        return sorted(followed, key=lambda one: -one.total)

    def maximised(self, layout: CoordinateLayout, points: Iterable[Floats]) -> Likeliest:
        """The most likely point that is found from the best of ``points`` (size + 2,)."""
        begun = self.ranked(layout, points)[:BEGUN_FROM]
        climbed = max((self.climbed(one) for one in begun), key=lambda at: at.total)
        return self._along_each(climbed)

    def again(self, at: Likeliest) -> Likeliest:
        """The most likely point that is found from one within other limits."""
        return self.maximised(at.layout, [at.point])

    def _steps(self, layout: CoordinateLayout, point: Floats) -> Floats:
        """(size + 2,) steps over which slopes are taken, with their signs: into the range."""
        bounds = layout.bounds
        steps = np.append(SLOPE_STEP * (bounds.high - bounds.low), (0.1, 0.15))
        steps[base_coordinate.S_PERCENT] = 0.01 * max(point[base_coordinate.S_PERCENT], 0.3)
        for place, size in (
            (base_coordinate.RATIO, 0.02),
            (base_coordinate.ZERO, 0.02),
            (base_coordinate.GAIN, 0.002),
            (base_coordinate.RESTICK, max(0.02, 0.15 * point[base_coordinate.RESTICK])),
        ):
            steps[place] = min(size, steps[place]) if steps[place] == 0.0 else size
        low, high = self.limits(layout)
        steps = np.where(high > low, np.minimum(steps, high - low), 0.0)
        return np.where(point + steps <= high, steps, -steps)

    def climbed(self, begun: Likeliest, rounds: int = ROUNDS) -> Likeliest:
        """The point that is reached by following the slopes from one that was ``begun``."""
        best, damping = begun, 1e-2
        for _ in range(rounds):
            free, steps, slopes = self._slopes(best)
            before = best.total
            best, damping = self._stepped(best, free, steps, slopes, damping)
            if best.total - before < WORTH_ANOTHER:
                break
        return best

    def _slopes(self, at: Likeliest) -> tuple[Samples, Floats, Floats]:
        """The coordinates that are free, the steps along them, and by how much the logarithm of the
        likelihood of each block grows over these (blocks, free).
        """
        steps = self._steps(at.layout, at.point)
        free = np.flatnonzero(steps)
        beside = np.tile(at.point, (free.size, 1))
        beside[np.arange(free.size), free] += steps[free]
        slopes = (self.of_blocks_each(at.layout, beside) - at.by_block).T
        return free, steps[free], slopes

    def standard_errors(self, at: Likeliest) -> Floats:
        """(size + 2,) of a point that was maximised, from how much the slopes of the blocks vary;
        0 for what is not free.
        """
        free, steps, slopes = self._slopes(at)
        errors = np.zeros(at.point.size)
        information = slopes.T @ slopes
        information[np.diag_indices_from(information)] += 1e-6
        errors[free] = np.sqrt(np.diag(np.linalg.inv(information))) * np.abs(steps)
        return errors

    def _stepped(
        self, best: Likeliest, free: Samples, steps: Floats, slopes: Floats, damping: float
    ) -> tuple[Likeliest, float]:
        """The best of some steps along the slopes (blocks, free) of each block, over ``steps``; and
        the damping with which to go on.
        """
        curved, total = slopes.T @ slopes, slopes.sum(axis=0)
        own = np.diag(np.maximum(np.diag(curved), 1e-6))
        for _ in range(TRIES):
            way = np.zeros(best.point.size)
            way[free] = np.linalg.solve(curved + (damping + 1e-9) * own, total) * steps
            there = self.at(best.layout, best.point + way, best)
            if there.total > best.total:
                further = self.at(best.layout, best.point + 2.0 * way, there)
                return max(there, further, key=lambda at: at.total), max(0.3 * damping, 1e-3)
            damping *= 8.0
        return best, damping

    def _along_each(self, best: Likeliest) -> Likeliest:
        """The best that steps along the single coordinates find."""
        layout = best.layout
        steps = 2.0 * np.abs(self._steps(layout, best.point))
        for _ in range(ALONE_ROUNDS):
            before = best
            for place in np.flatnonzero(steps):
                best, steps[place] = self._along(best, int(place), float(steps[place]))
            again = self.at(layout, 2.0 * best.point - before.point, best)
            best = again if again.total > best.total else best
            if best.total - before.total < WORTH_ANOTHER:
                break
        return best

    def _along(self, best: Likeliest, place: int, step: float) -> tuple[Likeliest, float]:
        """The best on one coordinate, and the step with which to go on."""
        for sign in (1.0, -1.0):
            there = self._moved(best, place, sign * step)
            if there.total <= best.total:
                continue
            while there.total > best.total:
                best, step = there, LONGER * step
                there = self._moved(best, place, sign * step)
            return best, step
        return best, SHORTER * step

    def _moved(self, best: Likeliest, place: int, step: float) -> Likeliest:
        """The point that is a ``step`` further on one coordinate."""
        point = best.point.copy()
        point[place] += step
        return self.at(best.layout, point, best)


def points_at(fitted: Fitted, of_record: Floats) -> list[Floats]:
    """Points (size + 2,) at the fits to both folds and between them."""
    rows = np.vstack((fitted.candidates, fitted.candidates.mean(axis=0)))
    return [np.append(row, of_record) for row in rows]


def likeliest_of(likelihood: RecordLikelihood, fitted: Fitted) -> Likeliest:
    """Where the record is most likely by the hypothesis that is ``fitted``, begun from its fits."""
    return likelihood.maximised(fitted.layout, points_at(fitted, likelihood.first_of_record))
