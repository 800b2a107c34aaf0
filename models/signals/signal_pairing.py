"""Whether a position belongs to a command. A wrong tag gives a confident but meaningless fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stemwatch.models.recording import Floats, Recording, Role, Signal, kept
from stemwatch.models.signals.excitation import swing, travel
from stemwatch.models.signals.first_order_lag import first_order_lag
from stemwatch.models.signals.forensics import noise_sigma, quantum
from stemwatch.models.signals.kept_of_array import those_of
from stemwatch.models.signals.op_in_steps import op_is_set_in_steps
from stemwatch.models.signals.runs_of_samples import equal_runs
from stemwatch.models.statistics.cross_correlation import lagged_products
from stemwatch.models.statistics.distinct import distinct
from stemwatch.models.statistics.quantiles import percentiles

LONGEST_DELAY_S = 120.0
COPIED_SHARE = 0.99  # of the samples
DELAYS = (0, 1, 2)  # samples by which a copy of OP may have been recorded late
LONGEST_COPY_DELAY = 600  # samples
# Samples that are looked at before all are, and the share of them that even a late copy repeats: a
# stem's reading repeats next to none.
FIRST_LOOK, MAYBE_COPIED = 1000, 0.8
LEAST_COPIED = 50  # samples needed to separate a copy from coincidence
# A stem's reading has noise, two hundredths of a percent and more; a computed one has none.
WITHOUT_NOISE = 1e-4  # of the range
LAGS = np.geomspace(0.3, 300.0, 31)  # samples
TWO_PLACES = 3  # values of a reading that shows open and shut only
# Correlation of OP - MV from one sample to the next. A valve gives at least -0.5, where both are
# white noise.
EXCHANGED = -0.75
MOST = 1e9  # larger values cannot be a reading
LEAST_MOVE_PERCENT = 1.0
WIDEST_STEP_PERCENT = 1.0  # of a recorder of OP; in wider ones a person sets it
STRETCHES, FEWEST_IN_STRETCH = 25, 10  # of a record, and samples in one
SUMMED, TOWARDS_COMMAND = 0.9, (-0.5, 0.1)
SETTLED_S = 30.0  # of the own clock, after which a stem has followed a constant OP
# Rests of OP from which it shows that the stem is at OP's place at their ends, and the correlation.
RESTS_TOLD, COMES_TO_OP = 6, 0.95
AT_ITS_END, AFTER_THE_END = 6, 3  # samples of a rest of OP at its end, and those left out first


@kept
def _pairs(recording: Recording) -> tuple[Floats, Floats]:
    """OP and MV where both are usable; empty where one of them does not move."""
    assert recording.mv is not None
    usable = recording.usable
    op, mv = those_of(recording.op.values, usable), those_of(recording.mv.values, usable)
    if op.size < 10 or swing(op) == 0.0 or swing(mv) == 0.0:
        return op[:0], mv[:0]
    return op, mv


def is_copy(recording: Recording) -> bool:
    """True where the "position" is OP under another name: equal, rounded, or a scan or two late."""
    if _is_switch_on(recording, recording.op):
        return False
    return copied_share(recording) > COPIED_SHARE


def _is_switch_on(recording: Recording, source: Signal) -> bool:
    """Whether the position knows two or three values, and ``source`` more. A switch at the middle
    of OP is OP rounded to whole strokes, and no copy."""
    several = distinct(source.values[source.usable], TWO_PLACES) > TWO_PLACES
    return bool(several and is_limit_switch(recording))


def copied_share(recording: Recording) -> float:
    """Share of the samples of the position that repeat OP, at once or a scan or two late."""
    op, mv = _pairs(recording)
    if not op.size:
        return 0.0
    # A rounded copy is within half its step of OP; a real stem is not, sample for sample.
    tolerance = max(0.51 * quantum(mv), 1e-6 * max(swing(op), 1.0))
    return max(
        float(np.mean(np.abs(mv[late:] - op[: op.size - late]) <= tolerance)) for late in DELAYS
    )


def copied_from(recording: Recording) -> Role | None:
    """Which of OP, PV and SP the "position" repeats: on any scale, late, or through a filter.

    A copy differs by its rounding only; a stem's reading differs by noise and friction.
    """
    mv = recording.mv
    assert mv is not None
    usable = np.zeros(0, dtype=bool)
    for role in (Role.OP, Role.PV, Role.SP):
        source = recording.get(role)
        if source is None or _is_switch_on(recording, source):
            continue
        both = mv.usable & source.usable
        if not np.array_equal(both, usable):
            usable, copy = both, those_of(mv.values, both)
            tolerance = _tolerance(copy) if copy.size else 0.0
        source_values = those_of(source.values, usable)
        if source_values.size < LEAST_COPIED or not (
            _is_reading(source_values) and _is_reading(copy)
        ):
            continue
        if _same_line(source_values, copy, tolerance) or (
            role is Role.OP and _filtered(source_values, copy, tolerance)
        ):
            return role
    return None


def _is_reading(values: Floats) -> bool:
    """Whether the signal moves, and within the range of an instrument."""
    return swing(values) > 0.0 and float(np.abs(values).max()) < MOST


def command_is(recording: Recording) -> Role | None:
    """PV or SP where the "command" repeats it sample for sample."""
    for role in (Role.PV, Role.SP):
        source = recording.get(role)
        if source is None:
            continue
        usable = recording.op.usable & source.usable
        source_values = those_of(source.values, usable)
        copy = those_of(recording.op.values, usable)
        if (
            source_values.size >= LEAST_COPIED
            and swing(source_values) > 0.0
            and np.array_equal(source_values, copy)
        ):
            return role
    return None


def is_limit_switch(recording: Recording) -> bool:
    """True where the position has two or three values only, as a limit switch has."""
    assert recording.mv is not None
    values = recording.mv.values[recording.mv.usable]
    return 1 < distinct(values, TWO_PLACES) <= TWO_PLACES


def samples_exchanged(recording: Recording) -> bool:
    """True where OP and position change places from one sample to the next."""
    return lag_one_correlation(recording) < EXCHANGED


def lag_one_correlation(recording: Recording) -> float:
    """The correlation of OP - MV with itself a sample later, -1 to 1; 0 with too few samples."""
    op, mv = _pairs(recording)
    if op.size < LEAST_COPIED:
        return 0.0
    difference = op - mv
    difference = difference - np.median(difference)
    power = float(difference @ difference)
    return float(difference[1:] @ difference[:-1]) / power if power > 0.0 else 0.0


def moved_without_command(recording: Recording) -> float:
    """Share of the position's travel while OP has been constant for long, 0 to 1.

    A positioner that overshoots brings the stem to OP's place at last. Where the stem is there at
    the end of each rest of OP, it counts at most twice what it does in the second half of them.
    """
    op, mv = _pairs(recording)
    if not op.size:
        return 0.0
    least, settled = _least_move(recording, op, mv), _settled_samples(recording)
    path = travel(mv, least)
    if not path:
        return 0.0
    rests = [run for run in equal_runs(op) if run[1] - run[0] > 2 * settled]
    alone = sum(travel(mv[first + settled : last], least) for first, last in rests)
    if _comes_to_op(op, mv, rests):
        at_last = sum(travel(mv[(first + last) // 2 : last], least) for first, last in rests)
        alone = min(alone, 2.0 * at_last)
    return float(alone / path)


def _settled_samples(recording: Recording) -> int:
    """Samples after which a stem has followed an OP that rests."""
    return max(round(SETTLED_S / recording.interval_s), 2)


def _comes_to_op(op: Floats, mv: Floats, rests: Sequence[tuple[int, int]]) -> bool:
    """Whether the position's mean over the last quarter of the ``rests`` of OP goes with OP."""
    if len(rests) < RESTS_TOLD:
        return False
    at_last = np.array(
        [np.mean(mv[last - max((last - first) // 4, 1) : last]) for first, last in rests]
    )
    levels = op[[first for first, _ in rests]]
    if np.ptp(levels) == 0.0 or np.ptp(at_last) == 0.0:
        return False
    return bool(np.corrcoef(levels, at_last)[0, 1] >= COMES_TO_OP)


def _least_move(recording: Recording, op: Floats, mv: Floats) -> float:
    """What a position must move, percent, while a stored OP stands still, so that it moves alone:
    more than its noise, and more than the command may have moved within a recorder's step.
    """
    hidden = 0.0 if op_is_set_in_steps(recording) else min(quantum(op), WIDEST_STEP_PERCENT)
    return max(6.0 * noise_sigma(mv), LEAST_MOVE_PERCENT) + hidden


def to_and_fro_at_the_end(recording: Recording) -> float:
    """Share of the position's travel, 0 to 1, that it makes to and fro while OP rests at the lowest
    or highest value it has. A stem may still arrive then, but it does not turn round. Of a long
    rest of OP the second half counts twice where the stem has come to OP's place by then.
    """
    op, mv = _pairs(recording)
    if not op.size:
        return 0.0
    least, settled = _least_move(recording, op, mv), _settled_samples(recording)
    path, ends = travel(mv, least), (op.min(), op.max())
    rests = [
        mv[first + AFTER_THE_END : last]
        for first, last in equal_runs(op)
        if last - first >= AT_ITS_END and op[first] in ends
    ]
    long = [run for run in equal_runs(op) if run[1] - run[0] > 2 * settled]
    settles = _comes_to_op(op, mv, long)
    turned = sum(
        2.0 * _to_and_fro(rest[rest.size // 2 :], least)
        if settles and rest.size > 2 * settled
        else _to_and_fro(rest, least)
        for rest in rests
    )
    return turned / path if path else 0.0


def _to_and_fro(positions: Floats, least: float) -> float:
    """How much further a stem went, percent, than from the first of ``positions`` (n,) to the
    last; moves below ``least`` do not count.
    """
    return max(float(travel(positions, least) - abs(positions[-1] - positions[0])), 0.0)


@dataclass(frozen=True)
class SummedCommand:
    """How much of MV's speed OP and MV explain (0 to 1), and how much of that is
    ``towards_command``: 1 where MV comes to rest at its command, 0 where its speed depends on OP
    alone.
    """

    explained: float = 0.0
    towards_command: float = np.nan

    @property
    def sums(self) -> bool:
        """Whether OP determines the speed of the position, wherever it is."""
        least, most = TOWARDS_COMMAND
        return self.explained >= SUMMED and least < self.towards_command < most


def sums_its_command(recording: Recording) -> bool:
    """True where OP determines the speed of the position: OP is then a speed, a force, or the
    pulses of an electric actuator, and not a position command.
    """
    return summed_command(recording).sums


def summed_command(recording: Recording) -> SummedCommand:
    """How the position's speed depends on OP and on the position.

    Over stretches of a twenty-fifth of the record, with means of OP and MV,

        change of MV = a OP + b MV + c,        a valve: b = -a / (MV per OP)

    because a stem comes to rest at its command, however late; ``towards_command`` is ``-b std(MV) /
    (a std(OP))``. It is -1 for an OP that is stored late, because OP and MV then differ by MV's
    move in that time, and -0.26 for the position of a slide whose OP is its force.
    """
    op, mv = _pairs(recording)
    width = op.size // STRETCHES
    if width < FEWEST_IN_STRETCH:
        return SummedCommand()
    ends = np.arange(STRETCHES + 1) * width
    command, position = (
        values[: ends[-1]].reshape(STRETCHES, width).mean(axis=1) for values in (op, mv)
    )
    change = np.diff(mv[np.minimum(ends, mv.size - 1)])
    spread = float(np.ptp(command)), float(np.ptp(position)), float(np.ptp(change))
    if min(spread) <= 0.0:
        return SummedCommand()
    columns = np.column_stack([command, position, np.ones(STRETCHES)])
    a, b, c = np.linalg.lstsq(columns, change, rcond=None)[0]
    left = change - columns @ np.array([a, b, c])
    return SummedCommand(
        explained=1.0 - float(np.var(left) / np.var(change)),
        towards_command=-b * float(np.std(position)) / (abs(a) * float(np.std(command)) + 1e-300),
    )


def _tolerance(copy: Floats) -> float:
    return max(0.51 * quantum(copy), 1e-6 * swing(copy))


def _same_line(source: Floats, copy: Floats, tolerance: float) -> bool:
    """Whether ``copy`` is ``source`` times a number plus a number, at once or some samples late."""
    delays = {*DELAYS, _agreed_delay(source, copy)}
    return any(
        _on_a_line(source[: source.size - late], copy[late:], tolerance)
        for late in delays
        if source.size - late >= LEAST_COPIED
    )


def _agreed_delay(source: Floats, copy: Floats) -> int:
    longest = min(LONGEST_COPY_DELAY, source.size // 3)
    return int(np.argmax(np.abs(lagged_products(np.diff(source), np.diff(copy), longest))))


def _on_a_line(source: Floats, copy: Floats, tolerance: float) -> bool:
    """Whether all but a few samples lie on one line, within the rounding ``tolerance``."""
    few = slice(None, None, max(source.size // FIRST_LOOK, 1))
    return (
        _share_on_a_line(source[few], copy[few], tolerance) > MAYBE_COPIED
        and _share_on_a_line(source, copy, tolerance) > COPIED_SHARE
    )


def _share_on_a_line(source: Floats, copy: Floats, tolerance: float) -> float:
    """Share of the samples on the line through most of them, within ``tolerance``."""
    near_x, near_y = source, copy
    for _ in range(2):
        if near_x.size < LEAST_COPIED or np.ptp(near_x) == 0.0:
            return 0.0
        gain, zero = _line_through(near_x, near_y)
        deviation = np.abs(copy - gain * source - zero)
        on_line = deviation <= max(percentiles(deviation, (90.0,))[0], tolerance)
        near_x, near_y = source[on_line], copy[on_line]
    return float(np.mean(deviation <= tolerance)) if gain != 0.0 else 0.0


def _line_through(x: Floats, y: Floats) -> tuple[float, float]:
    """Gain and zero of the line of least squares over ``x`` (n,), which is not constant."""
    middle_x, middle_y = float(x.mean()), float(y.mean())
    across = x - middle_x
    gain = float(across @ (y - middle_y)) / float(across @ across)
    return gain, middle_y - gain * middle_x


def _filtered(source: Floats, copy: Floats, tolerance: float) -> bool:
    """Whether ``copy`` is ``source`` through a lag of the first order and nothing else."""
    if not _without_noise(source, copy, tolerance):
        return False
    if quantum(copy) == 0.0:
        return True
    from scipy.optimize import minimize_scalar  # slow to import, and rarely used

    deviations = [_off_a_line(source, copy, lag) for lag in LAGS]
    best = float(LAGS[int(np.argmin(deviations))])
    best_lag = minimize_scalar(
        lambda lag: _off_a_line(source, copy, lag),
        bounds=(0.7 * best, 1.4 * best),
        method="bounded",
    )
    settled = copy.size // 10
    lagged = first_order_lag(source, float(best_lag.x))
    return _on_a_line(lagged[settled:], copy[settled:], tolerance)


def _off_a_line(source: Floats, copy: Floats, lag: float) -> float:
    """How far ``copy`` lies off a line over the lagged ``source``, as a sum of squares."""
    lagged = first_order_lag(source, lag)
    columns = np.column_stack((lagged, np.ones(lagged.size)))
    residual = copy - columns @ np.linalg.lstsq(columns, copy, rcond=None)[0]
    return float(residual @ residual)


def _without_noise(source: Floats, copy: Floats, tolerance: float) -> bool:
    """Whether each sample follows from the one before and the command, by one rule."""
    columns = np.stack((copy[:-1], source[1:], source[:-1], np.ones(copy.size - 1)))
    tolerance = max(2.0 * tolerance, WITHOUT_NOISE * swing(copy))
    few = slice(None, None, max(copy.size // FIRST_LOOK, 1))
    return (
        _share_by_a_rule(columns[:, few], copy[1:][few], tolerance) > MAYBE_COPIED
        and _share_by_a_rule(columns, copy[1:], tolerance) > COPIED_SHARE
    )


def _share_by_a_rule(columns: Floats, values: Floats, tolerance: float) -> float:
    """Share of ``values`` (n,) that a sum of ``columns`` (4, n) gives, within ``tolerance``."""
    weights = np.linalg.lstsq(columns.T, values, rcond=None)[0]
    return float(np.mean(np.abs(values - weights @ columns) <= tolerance))


def correlation(recording: Recording) -> float:
    """The correlation of OP and position at the same instants, -1 to 1; 0 where one of them does
    not move.
    """
    op, mv = _pairs(recording)
    return float(np.corrcoef(op, mv)[0, 1]) if op.size else 0.0


def delayed_correlation(recording: Recording) -> float:
    """The highest correlation of the position with OP up to two minutes before it; holes are 0."""
    op, mv = _pairs(recording)
    if not op.size:
        return 0.0
    assert recording.mv is not None
    usable = recording.usable
    a = np.where(usable, recording.op.values - op.mean(), 0.0)
    b = np.where(usable, recording.mv.values - mv.mean(), 0.0)
    longest = max(2, min(round(LONGEST_DELAY_S / recording.interval_s), a.size // 4))
    return float(lagged_products(a, b, longest).max() / np.sqrt((a @ a) * (b @ b)))
