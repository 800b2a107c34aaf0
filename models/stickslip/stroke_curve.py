"""The curve from OP to stroke: which part of OP strokes the valve, which way round, and how bent.

::

    OP --curve f--> command, percent of travel --actuator--> --stick-slip--> MV

S and J are read from the distance between command and position, so both must be in the same
percent. On many valves they are not: a split range strokes the whole valve with half of OP, an
air-to-close valve counts the other way, a positioner's characteristic or a cam bends the way in
between. Fitted as if 50 % of OP were 50 % of travel, a healthy valve then seems to stick.

The curve is estimated from the recording alone and together with the sticking, for each hides the
other: the hysteresis lies as wide above the curve as below it, so that whatever the fitted element
leaves *while it moves*, up and down alike, belongs to the curve, and what differs with direction
does not. A curve is only looked for where command and position lie apart as no zero and span of a
transmitter explains, and only taken where the plain reading, OP percent for percent of travel, does
not explain the record better on a part that neither was fitted to; it is only as bent as that part
asks for.

In a limit cycle between two positions the slope of the curve cannot be told from J; S in percent of
OP can (it is what OP covers between two breakaways), and the plain reading is kept if it explains
the record.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from stemwatch.models.estimate import Estimate
from stemwatch.models.recording import Bools, Floats, Recording, Role, Signal
from stemwatch.models.signal_pairing import correlation
from stemwatch.models.stickslip import parameters as coordinate
from stemwatch.models.stickslip.fit import (
    StickSlipEvaluator,
    advantage,
    first_look,
    search,
    sticking_grid,
)
from stemwatch.models.stickslip.problem import make_problem
from stemwatch.models.stickslip.search import SearchResult, best_of

# Healthy and sticking valves of two simulators keep the middle between their branches within 1 %
# of OP; a zero shift of 2 % and a span error of 10 % of travel together move it by 6 %.
OFF_THE_COMMAND_PERCENT = 8.0
# The same valves, sampled at 1 to 10 s, give 0.88 to 1.05 for the slope of the position's means
# over OP's, and a tight shut-off 0.79; an OP half of which strokes the valve gives 1.6 and more.
PLAIN_SLOPE = (0.75, 1.25)
MEANS, LEAST_SPREAD_PERCENT, LEAST_TOGETHER = 24, 2.0, 0.97
# A position that falls while OP rises: 256 simulated valves that stick gave 0.1 and above.
AGAINST = -0.3
# Bends of ``100 (exp(b OP/100) - 1) / (exp(b) - 1)``: 0 is linear, 4 steeper than an equal
# percentage of 1:50, -4 a quick opening.
BENDS = np.arange(-4.0, 4.5, 1.0)
BENT_OVER = (-25.0, 125.0)  # percent of OP
KEPT_BENDS = 3
DEGREE = 3  # of the polynomial that puts the curve right
ROUNDS = 3
# A bent curve must beat a straight one on what was not fitted.
LEAST_BEND_GAIN, LEAST_BEND_T = 0.05, 1.0
# By how much J may be wrong either way where the slope is not known.
SLOPE_UNKNOWN = 2.0
MOVING_SAMPLES = 40  # fewer moving samples say nothing of a curve
KNOTS = 33
LEAST_TRAVEL_PERCENT = 0.5  # less is no curve
NEARLY_LINEAR_PERCENT = 1.5  # of travel, off the chord
STOP_SHARE = 0.02  # of the samples at the lowest or highest position: a stop, or a tight shut-off


@dataclass(frozen=True)
class StrokeCurve:
    """``travel`` (k,) percent of travel at ``op`` (k,) percent of OP, rising in ``op``.

    Between the knots straight lines, beyond them the ends of what was seen. ``slope_known`` is
    False where the valve went to and fro between two places only: S in percent of OP is then known,
    how it is shared between the jump and the slope is not.
    """

    op: tuple[float, ...]
    travel: tuple[float, ...]
    slope_known: bool = True

    def command(self, op: Floats) -> Floats:
        """(n,) OP as percent of travel; NaN stays NaN."""
        return np.asarray(np.interp(op, self.op, self.travel), dtype=np.float64)

    def in_op(self, estimate: Estimate, *, is_jump: bool = False) -> Estimate:
        """An estimate in percent of travel as one in percent of OP."""
        if estimate.value is None and estimate.at_least is None:
            return estimate
        scale = 1.0 / abs(self.slope)
        wider = SLOPE_UNKNOWN if is_jump and not self.slope_known else 1.0
        low, high = estimate.low, estimate.high
        return replace(
            estimate,
            value=None if estimate.value is None else scale * estimate.value,
            low=None if low is None else scale * low / wider,
            high=None if high is None else scale * high * wider,
        )

    @property
    def slope(self) -> float:
        """Percent of travel for a percent of OP, over the part of OP that was used; signed."""
        return float((self.travel[-1] - self.travel[0]) / (self.op[-1] - self.op[0]))

    @property
    def zero(self) -> float:
        """Where the chord meets OP 0 %, percent of travel."""
        return self.travel[0] - self.slope * self.op[0]

    @property
    def bend_percent(self) -> float:
        """How far the curve lies off its chord at most, percent of travel."""
        op, travel = np.array(self.op), np.array(self.travel)
        return float(np.max(np.abs(travel - travel[0] - self.slope * (op - op[0]))))

    def sentence(self) -> str:
        """What an engineer should know of it."""
        seen = (
            f"OP {self.op[0]:.0f} to {self.op[-1]:.0f} % brings the position from "
            f"{self.travel[0]:.0f} to {self.travel[-1]:.0f} %"
        )
        if self.bend_percent > NEARLY_LINEAR_PERCENT:
            return f"{seen}, bent by up to {self.bend_percent:.1f} % of travel."
        if not self.slope_known:
            return f"{seen}; it moved between so few places that the curve's slope is not known."
        begin = self.op[0] - self.travel[0] / self.slope
        end = begin + 100.0 / self.slope
        return f"{seen}, nearly linear: as if OP {begin:.0f} to {end:.0f} % stroked 0 to 100 %."


def with_command(recording: Recording, command: Floats, mv_unit: str | None = None) -> Recording:
    """``recording`` with ``command`` (n,) in place of OP's values."""
    signals = dict(recording.signals)
    op = signals[Role.OP]
    signals[Role.OP] = Signal(command, op.quality, op.tag, op.unit, op.interval_s)
    if mv_unit is not None:
        signals[Role.MV] = replace(signals[Role.MV], unit=mv_unit)
    return replace(recording, signals=signals)


def in_travel(recording: Recording, curve: StrokeCurve | None) -> Recording:
    """``recording`` with the command that its OP stands for; itself where there is no curve."""
    if curve is None:
        return recording
    return with_command(recording, curve.command(recording.op.values))


def suspected(recording: Recording) -> bool:
    """Whether the position lies off the command as no zero and span of a transmitter explains."""
    if recording.mv is None or recording.mv.unit != recording.op.unit:
        return False
    both = recording.usable
    if both.sum() < MOVING_SAMPLES:
        return False
    off = (recording.mv.values - recording.op.values)[both]
    low, high = np.percentile(off, (2.0, 98.0))
    if abs(low + high) / 2.0 > OFF_THE_COMMAND_PERCENT or correlation(recording) < AGAINST:
        return True
    slope = slope_of_means(recording)
    return slope is not None and not PLAIN_SLOPE[0] <= slope <= PLAIN_SLOPE[1]


def slope_of_means(recording: Recording) -> float | None:
    """Percent of travel for a percent of OP, from the means of both over a 24th of the record.

    Sticking moves a mean by less than S, and lags hardly at all. ``None`` where OP did not stay
    in several places for long, or the means do not lie on a line.
    """
    both, mv = recording.usable, recording.mv
    length = int(both.sum()) // MEANS
    if mv is None or length == 0:
        return None
    op, position = (
        signal.values[both][: MEANS * length].reshape(MEANS, length).mean(axis=1)
        for signal in (recording.op, mv)
    )
    if op.std() < LEAST_SPREAD_PERCENT or position.std() == 0.0:
        return None
    if abs(np.corrcoef(op, position)[0, 1]) < LEAST_TOGETHER:
        return None
    return float(np.cov(op, position)[0, 1] / op.var(ddof=1))


def find_stroke_curve(recording: Recording) -> StrokeCurve | None:
    """The curve of a recording whose OP is not percent for percent of its position, else ``None``.

    OP and MV in percent. The answer is ``None`` too where no curve explains the held-out part of
    the record better than the plain reading does: what is wrong is then something else.
    """
    if not suspected(recording) or not _moves(recording):
        return None
    plain = _Reading.of(recording, recording.op.values, 0)
    slope_known = slope_of_means(recording) is not None
    # Where the slope is not known, what is left of the fit must not be put into it.
    chosen = _best(_refined(recording, bends=np.zeros(1), degree=1 if slope_known else 0))
    if chosen is None:
        return None
    if slope_known:
        bent = _best(_refined(recording, bends=BENDS, degree=DEGREE))
        if bent is not None and _better(bent, chosen, LEAST_BEND_GAIN, LEAST_BEND_T):
            chosen = bent
    # A valve whose command and position lie this far apart has some curve: the straight one, unless
    # the plain reading explains the record better.
    if _better(plain, chosen, LEAST_BEND_GAIN, LEAST_BEND_T):
        return None
    everything = np.ones(chosen.evaluator.problem.n_blocks, dtype=bool)
    final = chosen.improved(recording, everything)
    return _monotone(recording, (final or chosen).command, slope_known)


def _moves(recording: Recording) -> bool:
    """Whether both move on the samples that a fit is scored on; else nothing tells a slope."""
    problem = make_problem(recording)
    return problem.scored.sum() >= MOVING_SAMPLES and all(
        np.ptp(np.percentile(values[problem.scored], (2.0, 98.0))) > LEAST_TRAVEL_PERCENT
        for values in (problem.op, problem.mv)
    )


@dataclass(frozen=True)
class _Reading:
    """A command that OP may stand for, with the S and J that go best with it."""

    command: Floats
    evaluator: StickSlipEvaluator
    best: SearchResult
    train: Bools
    degree: int

    @classmethod
    def of(
        cls,
        recording: Recording,
        command: Floats,
        degree: int,
        start: SearchResult | None = None,
        free_gain: bool = False,
    ) -> _Reading:
        unit = "travel" if free_gain else None
        problem = make_problem(with_command(recording, command, unit))
        evaluator, base = first_look(problem)
        # By OP as it was recorded: readings are compared on the same blocks.
        train = make_problem(recording).training_blocks()
        loss = evaluator.loss(train)
        starts = best_of(loss, sticking_grid(evaluator, base), keep=2)
        if start is not None:
            starts = [SearchResult(start.candidate, np.inf), *starts[:1]]
        best = search(evaluator, loss, starts, coordinate.STICKING, 0.05, 5)
        return cls(command, evaluator, best, train, degree)

    def improved(self, recording: Recording, blocks: Bools) -> _Reading | None:
        """The reading with its curve put right by what is left while the stem moves."""
        problem = self.evaluator.problem
        simulated = self.evaluator.simulate(self.best.candidate, resynced=True)
        step = np.diff(simulated, prepend=simulated[0])
        use = (np.abs(step) > 1e-9) & np.append(blocks, False)[problem.block]
        use &= ~_at_a_stop(problem.mv)
        if use.sum() < MOVING_SAMPLES:
            return None
        op = recording.op.values
        shapes = _shapes(op, op[np.isfinite(op)], self.degree)
        columns = np.column_stack((shapes[use], np.sign(step[use])))
        weights = _robust(columns, (problem.mv - simulated)[use])
        command = self.command + shapes @ weights[:-1]
        return _Reading.of(recording, command, self.degree, self.best)

    def heldout(self, delta: float) -> tuple[Floats, Floats]:
        """Losses and counts of the blocks that were not fitted."""
        judge = replace(self.evaluator, delta=delta)
        losses, counts = judge.block_losses(self.best.candidate[None, :])
        return losses[0, ~self.train], counts[~self.train]


def _refined(recording: Recording, bends: Floats, degree: int) -> Iterator[_Reading]:
    """The best few bends, each put right in a few rounds."""
    begun: list[tuple[float, Floats]] = []
    for bend in bends:
        look = _Reading.of(recording, _bent(recording.op.values, bend), degree, free_gain=True)
        gain = 1.0 + look.best.candidate[coordinate.GAIN]
        zero = look.best.candidate[coordinate.ZERO]
        begun.append((look.best.loss, np.asarray(zero + gain * look.command)))
    begun.sort(key=lambda start: start[0])
    for _, command in begun[:KEPT_BENDS]:
        reading: _Reading | None = _Reading.of(recording, command, degree)
        for _ in range(ROUNDS):
            if reading is None:
                break
            yield reading
            reading = reading.improved(recording, reading.train)
        if reading is not None:
            yield reading


def _best(readings: Iterator[_Reading]) -> _Reading | None:
    """The one with the lowest loss on the part that is fitted, all measured alike."""
    every = list(readings)
    if not every:
        return None
    delta = min(reading.evaluator.delta for reading in every)

    def trained(reading: _Reading) -> float:
        judge = replace(reading.evaluator, delta=delta)
        losses, counts = judge.block_losses(reading.best.candidate[None, :])
        return float(losses[0, reading.train].sum() / max(counts[reading.train].sum(), 1.0))

    return min(every, key=trained)


def _better(rich: _Reading, simple: _Reading, gain: float, t: float) -> bool:
    delta = min(rich.evaluator.delta, simple.evaluator.delta)
    (a, _), (b, counts) = simple.heldout(delta), rich.heldout(delta)
    gained = advantage(a, b, counts, delta)
    return gained.mean >= gain and gained.t >= t


def _bent(op: Floats, bend: float) -> Floats:
    if bend == 0.0:
        return op
    op = np.clip(op, *BENT_OVER)
    return np.asarray(100.0 * np.expm1(bend * op / 100.0) / np.expm1(bend))


def _shapes(op: Floats, known: Floats, degree: int) -> Floats:
    """(n, degree + 1) Legendre polynomials over the part of OP that was used."""
    low, high = np.percentile(known, (0.5, 99.5))
    place = np.clip(2.0 * (op - low) / max(high - low, 1e-9) - 1.0, -1.0, 1.0)
    return np.asarray(np.polynomial.legendre.legvander(place, degree))


def _robust(columns: Floats, values: Floats, rounds: int = 8) -> Floats:
    """Weights (m,) by iterated least squares; what lies far off counts little (Cauchy)."""
    weight: Floats = np.ones(values.size)
    coefficients: Floats = np.zeros(columns.shape[1])
    for _ in range(rounds):
        root = np.sqrt(weight)
        solved = np.linalg.lstsq(columns * root[:, None], values * root, rcond=None)
        coefficients = np.asarray(solved[0], dtype=np.float64)
        off = values - columns @ coefficients
        scale = max(2.0 * 1.4826 * float(np.median(np.abs(off))), 1e-3)
        weight = np.asarray(1.0 / (1.0 + (off / scale) ** 2), dtype=np.float64)
    return coefficients


def _at_a_stop(mv: Floats) -> Bools:
    """(n,) True where the position is at its lowest or highest value and often there."""
    stopped = np.zeros(mv.size, dtype=bool)
    for extreme in (mv.min(), mv.max()):
        there = np.abs(mv - extreme) < 1e-6
        if there.mean() > STOP_SHARE:
            stopped |= there
    return stopped


def _monotone(recording: Recording, command: Floats, slope_known: bool) -> StrokeCurve | None:
    """The curve as knots over the part of OP that was used; it never turns round."""
    usable = recording.usable & np.isfinite(command)
    op, command = recording.op.values[usable], command[usable]
    order = np.argsort(op, kind="stable")
    low, high = np.percentile(op, (0.5, 99.5))
    knots = np.linspace(low, high, KNOTS)
    travel = np.interp(knots, op[order], command[order])
    rising = travel[-1] >= travel[0]
    travel = np.maximum.accumulate(travel) if rising else np.minimum.accumulate(travel)
    if abs(travel[-1] - travel[0]) < LEAST_TRAVEL_PERCENT or high <= low:
        return None
    return StrokeCurve(
        op=tuple(map(float, knots)), travel=tuple(map(float, travel)), slope_known=slope_known
    )
