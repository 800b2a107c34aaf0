"""Find the curve from OP to stroke: which part of OP strokes the valve, which way, and how bent.

The curve is estimated from the recording alone, together with the friction, because each biases the
other. The hysteresis is as wide above the curve as below it. So the part of the residual *while the
stem moves* that is the same in both directions belongs to the curve, and the part that differs with
direction does not. A curve is only looked for where command and position differ by more than zero
and span of a transmitter can explain. It is only used where it explains held-out samples better
than the plain reading (OP percent for percent of travel), and only as bent as those samples need.

In a limit cycle between two positions the slope of the curve and J cannot be separated. S in
percent of OP can be found (it is the change of OP between two breakaways), and the plain reading is
kept if it explains the record.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from stemwatch.models.recording import Bools, Floats, Recording
from stemwatch.models.signals.signal_pairing import correlation
from stemwatch.models.stickslip import parameters as coordinate
from stemwatch.models.stickslip.advantage import advantage
from stemwatch.models.stickslip.breakaways import LEAST_J, Breakaways, seen_breakaways
from stemwatch.models.stickslip.curve_signs import (
    MOVING_SAMPLES,
    TOGETHER_ENOUGH,
    at_a_stop,
    curve_suspected,
    off_the_stops,
    slope_of_means,
)
from stemwatch.models.stickslip.evaluator import StickSlipEvaluator
from stemwatch.models.stickslip.first_look import first_look
from stemwatch.models.stickslip.force_balance import moves_as_a_motor
from stemwatch.models.stickslip.hypotheses import search, sticking_grid
from stemwatch.models.stickslip.parameters import S_and_J
from stemwatch.models.stickslip.problem import make_problem
from stemwatch.models.stickslip.search import SearchResult, best_of
from stemwatch.models.stickslip.stroke_curve import (
    LEAST_TRAVEL_PERCENT,
    USED,
    KnownCurve,
    StrokeCurve,
    in_travel,
    shapes_of,
    with_command,
)

# Bends of ``100 (exp(b OP/100) - 1) / (exp(b) - 1)``: 0 is linear, 4 steeper than an equal
# percentage of 1:50, -4 a quick opening.
BENDS = np.arange(-4.0, 4.5, 1.0)
BENT_OVER = (-25.0, 125.0)  # percent of OP
KEPT_BENDS = 3
DEGREES = (3, 5)  # of the polynomial that corrects the curve, the simpler first
ROUNDS = 3
# A bent curve must beat a straight one on held-out blocks. These are few, and one missed slip
# weighs much in them; where they do not decide, all blocks of the record must agree.
LEAST_BEND_GAIN, LEAST_BEND_T, LEAST_T_EVERYWHERE = 0.05, 1.0, 2.5
# Free runs miss slips, and then tell curves badly: behind an equal percentage (seed 2109) S was
# 8.7 % by a straight line and is 3.4, though the bent curve won with a t of 0.9 only. The slips
# tell it with log odds of 13, and of 12 against where OP is linear. They decide with 20 to 1.
LEAST_BY_SLIPS = 3.0
CHANGED_PERCENT = 3.0  # of travel; two windows of one valve agree within 1
EARLIER_USED = (
    "OP moved too little in this window to tell the curve; the one that was found before is used."
)
LOOK = "Ask whether the positioner, the split of the range or the transmitter was set otherwise."
CHANGED = (
    "This is not the curve of the window before: at OP {op:.0f} % the position would have been "
    f"{{was:.0f}} %, and is {{now:.0f}} %. {LOOK}"
)
CHANGED_FROM_PLAIN = (
    f"In the window before, OP was percent for percent of travel; now it is not. {LOOK}"
)
CHANGED_TO_PLAIN = (
    f"OP is percent for percent of travel now; in the window before it was not ({{before}}) {LOOK}"
)
NOT_AS_GIVEN = (
    "The position does not follow the curve from OP to stroke that the plant file gives. "
    "Correct stroke_curve there, or ask whether the positioner was set otherwise."
)
KNOTS = 33
# Median absolute residual of a reading, percent of travel, from which another curve is tried.
# Sticking valves behind a curve that was found (`draw_valves`, seed 6161) have 0.05 to 0.2; a
# healthy one near the foot of a square root, which was called sticky with 4 %, has 0.7. The
# branches are the outer tenths of the position over each of BRANCH_BINS parts of OP.
LEAVES_MUCH, BRANCH_BINS, BRANCHES = 0.4, 48, (10.0, 90.0)


def stroke_curve_of(
    recording: Recording, known_curve: KnownCurve | None = None
) -> tuple[StrokeCurve | None, str]:
    """The curve to read a recording through, and how it changed, one sentence or nothing.

    A curve that a person gave is used unchanged. A curve from an earlier window is the start of the
    search, and is used where OP moves too little to find one.
    """
    if known_curve is None or recording.mv is None or recording.mv.unit != recording.op.unit:
        return find_stroke_curve(recording), ""
    if known_curve.given:
        return _given_curve(recording, known_curve.curve)
    curve = find_stroke_curve(recording, known_curve.curve)
    if known_curve.curve is None:
        if curve is None or not curve.slope_known:
            return curve, ""
        return _changed(curve, CHANGED_FROM_PLAIN)
    return _since(recording, known_curve.curve, curve)


def _given_curve(recording: Recording, curve: StrokeCurve | None) -> tuple[StrokeCurve | None, str]:
    if curve is None:
        return None, ""
    curve_here = replace(_over_range(recording, curve), given=True)
    return _changed(
        curve_here, NOT_AS_GIVEN if curve_suspected(in_travel(recording, curve_here)) else ""
    )


def _since(
    recording: Recording, earlier: StrokeCurve, new_curve: StrokeCurve | None
) -> tuple[StrokeCurve | None, str]:
    """The curve to use, given the ``earlier`` one and the one ``new_curve`` in this recording
    alone."""
    before = _over_range(recording, earlier)
    if not _moves(recording):
        return replace(before, remark=EARLIER_USED), ""
    op = recording.op.values
    new_reading = _Reading.of(recording, op if new_curve is None else new_curve.command(op), 0)
    as_before = _Reading.of(recording, before.command(op), 0)
    # The fit is free to shift the whole curve, which would be a change all the same.
    shifted = abs(as_before.best.candidate[coordinate.ZERO]) > CHANGED_PERCENT
    if not shifted and not _better(new_reading, as_before):
        slope_known = slope_of_means(recording, TOGETHER_ENOUGH) is not None
        return (
            (new_curve or before, "") if slope_known else (replace(before, remark=EARLIER_USED), "")
        )
    if new_curve is None:
        return None, CHANGED_TO_PLAIN.format(before=before.sentence())
    assert new_curve.used is not None
    places = np.linspace(*new_curve.used, KNOTS)
    travel_before, now = before.command(places), new_curve.command(places)
    if float(np.median(np.abs(now - travel_before))) <= CHANGED_PERCENT:
        return new_curve, ""
    largest_change = int(np.argmax(np.abs(now - travel_before)))
    return _changed(
        new_curve,
        CHANGED.format(
            op=places[largest_change], was=travel_before[largest_change], now=now[largest_change]
        ),
    )


def _changed(curve: StrokeCurve, reason: str) -> tuple[StrokeCurve, str]:
    return replace(curve, remark=reason), reason


def _over_range(recording: Recording, curve: StrokeCurve) -> StrokeCurve:
    """A known ``curve`` for another recording: its slope is that over the OP used there, and one
    that was found goes straight on where OP now goes further."""
    op = recording.op.values[recording.op.usable]
    low, high = np.percentile(op, USED).tolist()
    curve_here = replace(curve, used=(low, high), remark="")
    if curve.used is None or curve.given:
        return curve_here
    return replace(curve_here.reaching(float(op.min()), float(op.max())), slope_known=True)


def find_stroke_curve(
    recording: Recording, earlier: StrokeCurve | None = None
) -> StrokeCurve | None:
    """The curve of a recording whose OP is not percent for percent of its position, else ``None``.

    OP and MV in percent; ``earlier`` is the shape to start from. The answer is ``None`` too where
    no curve explains the held-out part of the record better than the plain reading does; the cause
    is then another one.
    """
    if not curve_suspected(recording) or not _moves(recording):
        return None
    if moves_as_a_motor(make_problem(recording)):  # which a load pulls off its command
        return None
    straight = _Reading.of(recording, recording.op.values, 0)
    slope_known = slope_of_means(recording, TOGETHER_ENOUGH) is not None
    start = (
        None if earlier is None else _over_range(recording, earlier).command(recording.op.values)
    )
    chosen = _straight_or_bent(recording, slope_known, start)
    # A valve whose command and position are this far apart has some curve: a straight one, unless
    # the plain reading explains the record better.
    if chosen is None or _better(straight, chosen):
        return None
    return monotone(recording, _on_all_blocks(recording, chosen).command, slope_known)


def _on_all_blocks(recording: Recording, chosen: _Reading) -> _Reading:
    """``chosen`` corrected on the whole record, as long as that lowers the loss: a correction may
    bend the curve away where the stem hardly moves."""
    all_blocks = np.ones(chosen.evaluator.problem.n_blocks, dtype=bool)
    for _ in range(ROUNDS):
        further = chosen.improved(recording, all_blocks)
        if further is None:
            break
        delta = min(chosen.evaluator.delta, further.evaluator.delta)
        if further.losses(delta)[0].sum() >= chosen.losses(delta)[0].sum():
            break
        chosen = further
    return chosen


def _straight_or_bent(
    recording: Recording, slope_known: bool, start: Floats | None
) -> _Reading | None:
    """The reading that is only as bent as the held-out part needs, or as bent as the ``start``
    (n,), percent of travel."""
    if not slope_known:
        # The residual of the fit must not change the slope.
        return _best(_refined(recording, bends=np.zeros(1), degree=0))
    chosen = _best(_refined(recording, bends=np.zeros(1), degree=1))
    if chosen is None:
        return None
    as_before = None if start is None else _best(_rounds(recording, start, 1))
    if as_before is not None and not _better(chosen, as_before):
        chosen = as_before
    richer = _best(_refined(recording, bends=BENDS, degree=DEGREES[0]))
    for degree in DEGREES[1:]:
        if richer is None or not _better(richer, chosen):
            break
        chosen = richer
        richer = _best(_rounds(recording, chosen.command, degree))
    if richer is not None and _better(richer, chosen):
        chosen = richer
    # Near the foot of a square root no polynomial of OP is steep enough.
    if chosen.degree == DEGREES[-1] or not chosen.leaves_much:
        return chosen
    free = _best(_rounds(recording, _between_branches(recording), DEGREES[-1]))
    return free if free is not None and _better(free, chosen) else chosen


def _between_branches(recording: Recording) -> Floats:
    """(n,) percent of travel: the middle between the branches over OP, of any shape that rises or
    falls throughout."""
    from scipy.optimize import isotonic_regression  # slow to import, and rarely used

    assert recording.mv is not None
    usable = off_the_stops(recording)
    op, mv = recording.op.values[usable], recording.mv.values[usable]
    ends = np.unique(np.percentile(op, np.linspace(0.0, 100.0, BRANCH_BINS + 1)))
    bins = np.clip(np.searchsorted(ends, op, side="right") - 1, 0, max(ends.size - 2, 0))
    filled, counts = np.unique(bins, return_counts=True)
    knots = np.array([op[bins == one].mean() for one in filled])
    middle = np.array([np.percentile(mv[bins == one], BRANCHES).mean() for one in filled])
    rising = correlation(recording) >= 0.0
    monotone_middle = isotonic_regression(middle, weights=counts, increasing=rising).x
    return np.asarray(np.interp(recording.op.values, knots, monotone_middle))


def _moves(recording: Recording) -> bool:
    """Whether both move on the samples that a fit is scored on; else the slope cannot be found."""
    problem = make_problem(recording)
    return problem.scored.sum() >= MOVING_SAMPLES and all(
        np.ptp(np.percentile(values[problem.scored], (2.0, 98.0))) > LEAST_TRAVEL_PERCENT
        for values in (problem.op, problem.mv)
    )


@dataclass(frozen=True)
class _Reading:
    """OP read as one command in percent of travel, with the S and J that fit best."""

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
        # Blocks come from OP as it was recorded, so that readings are compared on the same ones.
        train = make_problem(recording).training_blocks()
        loss = evaluator.loss(train)
        starts = best_of(loss, sticking_grid(evaluator, base), keep=2)
        if start is not None:
            starts = [SearchResult(start.candidate, np.inf), *starts[:1]]
        best = search(evaluator, loss, starts, coordinate.STICKING, 0.05, 5)
        return cls(command, evaluator, best, train, degree)

    def improved(self, recording: Recording, blocks: Bools) -> _Reading | None:
        """The reading with its curve corrected by the residual while the stem moves."""
        problem = self.evaluator.problem
        simulated = self.evaluator.simulate(self.best.candidate, resynced=True)
        step = np.diff(simulated, prepend=simulated[0])
        use = (np.abs(step) > 1e-9) & np.append(blocks, False)[problem.block]
        use &= ~at_a_stop(problem.op, problem.mv)
        if use.sum() < MOVING_SAMPLES:
            return None
        op = recording.op.values
        shapes = shapes_of(op, op[np.isfinite(op)], self.degree)
        columns = np.column_stack((shapes[use], np.sign(step[use])))
        weights = robust_weights(columns, (problem.mv - simulated)[use])
        command = self.command + shapes @ weights[:-1]
        return _Reading.of(recording, command, self.degree, self.best)

    def breakaways(self, jump: float) -> Breakaways | None:
        """The breakaways of slips of about ``jump`` percent of travel, as this reading has them."""
        zero = float(self.best.candidate[coordinate.ZERO])
        return seen_breakaways(self.evaluator.problem, 1.0, zero, jump)

    @property
    def leaves_much(self) -> bool:
        """Whether the median residual is large, with runs resynchronised at each block of time."""
        problem = self.evaluator.problem
        simulated = self.evaluator.simulate(self.best.candidate, resynced=True)
        left = (problem.mv - simulated)[problem.scored]
        return float(np.median(np.abs(left))) > LEAVES_MUCH

    def losses(self, delta: float) -> tuple[Floats, Floats]:
        """Losses and counts (n_blocks,) of all blocks, fitted or not."""
        judge = replace(self.evaluator, delta=delta)
        losses, counts = judge.block_losses(self.best.candidate[None, :])
        return losses[0], counts


def _refined(recording: Recording, bends: Floats, degree: int) -> Iterator[_Reading]:
    """The best few bends, each corrected in a few rounds."""
    values = recording.op.values
    readings = [
        _Reading.of(recording, _bent(values, bend), degree, free_gain=True) for bend in bends
    ]
    for reading in _by_loss(readings)[:KEPT_BENDS]:
        gain = 1.0 + reading.best.candidate[coordinate.GAIN]
        zero = reading.best.candidate[coordinate.ZERO]
        yield from _rounds(recording, np.asarray(zero + gain * reading.command), degree)


def _rounds(recording: Recording, command: Floats, degree: int) -> Iterator[_Reading]:
    """A reading, and its curve corrected once, twice, and so on."""
    reading: _Reading | None = _Reading.of(recording, command, degree)
    for _ in range(ROUNDS):
        if reading is None:
            return
        yield reading
        reading = reading.improved(recording, reading.train)
    if reading is not None:
        yield reading


def _best(readings: Iterator[_Reading]) -> _Reading | None:
    """The one with the lowest loss on the part that is fitted."""
    return next(iter(_by_loss(list(readings))), None)


def _by_loss(readings: list[_Reading]) -> list[_Reading]:
    """By the loss on the training part, with one scale for all, the lowest first."""
    delta = min((reading.evaluator.delta for reading in readings), default=0.0)

    def trained(reading: _Reading) -> float:
        losses, counts = reading.losses(delta)
        return float(losses[reading.train].sum() / max(counts[reading.train].sum(), 1.0))

    return sorted(readings, key=trained)


def _better(rich: _Reading, simple: _Reading) -> bool:
    """Whether ``rich`` has a lower loss on held-out blocks, by more than chance; where that is not
    clear, the slips have a say."""
    delta = min(rich.evaluator.delta, simple.evaluator.delta)
    (before, _), (after, counts) = simple.losses(delta), rich.losses(delta)
    judged = ~rich.train
    heldout = advantage(before[judged], after[judged], counts[judged], delta)
    if heldout.mean < LEAST_BEND_GAIN:
        return False
    if heldout.t >= LEAST_T_EVERYWHERE:
        return True
    slips = _odds_by_slips(rich, simple)
    everywhere = advantage(before, after, counts, delta)
    if heldout.t >= LEAST_BEND_T or everywhere.t >= LEAST_T_EVERYWHERE:
        return slips > -LEAST_BY_SLIPS
    return slips > LEAST_BY_SLIPS


def _odds_by_slips(rich: _Reading, simple: _Reading) -> float:
    """Log odds of ``rich`` by how well the breakaways agree with one another in either reading,
    of the slips that both show; 0 where these are too few."""
    jumps = [S_and_J(reading.best.candidate)[1] for reading in (rich, simple)]
    jump = max(min(jumps), LEAST_J)
    in_rich, in_simple = rich.breakaways(jump), simple.breakaways(jump)
    if in_rich is None or in_simple is None:
        return 0.0
    return min(in_rich.count, in_simple.count) * (in_rich.agreement - in_simple.agreement)


def _bent(op: Floats, bend: float) -> Floats:
    if bend == 0.0:
        return op
    op = np.clip(op, *BENT_OVER)
    return np.asarray(100.0 * np.expm1(bend * op / 100.0) / np.expm1(bend))


def robust_weights(columns: Floats, values: Floats) -> Floats:
    """Weights (m,) by iteratively reweighted least squares with Cauchy's weights."""
    weight: Floats = np.ones(values.size)
    coefficients: Floats = np.zeros(columns.shape[1])
    for _ in range(8):
        root = np.sqrt(weight)
        solved = np.linalg.lstsq(columns * root[:, None], values * root, rcond=None)
        coefficients = np.asarray(solved[0], dtype=np.float64)
        residual = values - columns @ coefficients
        scale = max(2.0 * 1.4826 * float(np.median(np.abs(residual))), 1e-3)
        weight = np.asarray(1.0 / (1.0 + (residual / scale) ** 2), dtype=np.float64)
    return coefficients


def monotone(recording: Recording, command: Floats, slope_known: bool) -> StrokeCurve | None:
    """The curve as knots over the part of OP that was used, made monotone."""
    usable = recording.usable & np.isfinite(command)
    op, command = recording.op.values[usable], command[usable]
    order = np.argsort(op, kind="stable")
    low, high = np.percentile(op, USED)
    # The few samples beyond are peaks of OP, at which the stem lets go: they have knots as well.
    knots = np.unique((op.min(), *np.linspace(low, high, KNOTS), op.max()))
    travel = np.interp(knots, op[order], command[order])
    rising = travel[-1] >= travel[0]
    travel = np.maximum.accumulate(travel) if rising else np.minimum.accumulate(travel)
    if abs(travel[-1] - travel[0]) < LEAST_TRAVEL_PERCENT or high <= low:
        return None
    return StrokeCurve(
        op=tuple(map(float, knots)),
        travel=tuple(map(float, travel)),
        slope_known=slope_known,
        used=(float(low), float(high)),
    )
