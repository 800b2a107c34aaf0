"""What shows an effect directly: one quantity against the one that drives it, sample by sample.

For a speed limit that is the speed of the stem against its distance from the command; for a dead
time, the correlation of the moves of both against the delay applied to OP. The same plot is made of
the recording and of the free runs of both models, so that a reader sees which model reproduces it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from stemwatch.models.estimate import Estimate
from stemwatch.models.mismatch.findings import NO_TOP_SPEED
from stemwatch.models.mismatch.terms.bowed_linkage import shape as bowed
from stemwatch.models.recording import Bools, Floats
from stemwatch.models.signals.excitation import jumps_from_rest, reversals, swing

LEAST_TURN = 0.5  # percent of travel; noise turns by less
MOST_SHIFT = 4.0  # times the dead time, up to which the correlation is tried
SHIFTS = 61  # delays tried
# The time over which a speed is taken: shares of a lag, and of the time that OP's swing takes.
STEP_OF_LAG, STEP_OF_SWING = 0.3, 0.1
SAMPLES_OF_SPEED = 10  # over which the speeds of OP and stem are compared
FEWEST = 12  # points that show something
SPEED = "speed of the stem, %/s"


@dataclass(frozen=True)
class FittedLine:
    """A fitted number drawn as a line: its ``label`` with the number, and points (k,)."""

    label: str
    x: Floats
    y: Floats


@dataclass(frozen=True)
class EffectSignature:
    """Points (m,) that show an effect. ``rising`` (m,) marks those of a rising stem.

    ``joined`` where they are a curve and no cloud.
    """

    x_label: str
    y_label: str
    x: Floats
    y: Floats
    rising: Bools
    caption: str
    laws: tuple[FittedLine, ...] = ()
    joined: bool = False


@dataclass(frozen=True)
class Moves:
    """A command and a position (n,), percent, and what is known of the effect that is looked at.

    ``late_s`` is the dead time that was named, by which OP is taken later.
    """

    op: Floats
    mv: Floats
    interval_s: float
    late_s: float
    parameters: Mapping[str, Estimate]

    def value(self, name: str) -> float:
        """A parameter of the effect; 0 where it is not known."""
        estimate = self.parameters.get(name)
        return 0.0 if estimate is None or estimate.value is None else float(estimate.value)


def later(values: Floats, delay_s: float, interval_s: float) -> Floats:
    """(n,) ``values`` taken ``delay_s`` later, between samples by a straight line; NaN before the
    first, and next to a gap."""
    positions = np.arange(values.size) - delay_s / interval_s
    lower = np.floor(positions).astype(np.int64)
    part = positions - lower
    first = np.where(lower >= 0, values[np.clip(lower, 0, values.size - 1)], np.nan)
    upper_values = np.where(lower + 1 >= 0, values[np.clip(lower + 1, 0, values.size - 1)], np.nan)
    return np.asarray(np.where(part > 0.0, (1.0 - part) * first + part * upper_values, first))


def effect_signature(slug: str, moves: Moves) -> EffectSignature | None:
    """The plot that shows the effect ``slug`` in these moves; ``None`` where too few samples show
    it.
    """
    make_signature = _SIGNATURES.get(slug)
    signature = None if make_signature is None else make_signature(moves)
    if signature is None:
        return None
    finite = np.isfinite(signature.x) & np.isfinite(signature.y)
    if np.count_nonzero(finite) < FEWEST:
        return None
    return replace(
        signature,
        x=signature.x[finite],
        y=signature.y[finite],
        rising=signature.rising[finite],
    )


def _speed_by_error(moves: Moves, time_s: float) -> tuple[Floats, Floats, float]:
    """How far the stem is from its command, its speed over about ``time_s`` from there on, and
    that time."""
    step = max(1, round(time_s / moves.interval_s))
    took = step * moves.interval_s
    op = later(moves.op, moves.late_s, moves.interval_s)
    error = np.full(op.size, np.nan)
    speed = np.full(op.size, np.nan)
    error[:-step] = op[step:] - moves.mv[:-step]
    speed[:-step] = (moves.mv[step:] - moves.mv[:-step]) / took
    return error, speed, took


def _of_speed(error: Floats, speed: Floats, caption: str, law: FittedLine) -> EffectSignature:
    """The speed of the stem against its distance from the command, with what bounds it."""
    return EffectSignature(
        x_label="OP less position, %",
        y_label=SPEED,
        x=error,
        y=speed,
        rising=error > 0.0,
        caption=caption,
        laws=(law,),
    )


def _limited(moves: Moves) -> EffectSignature:
    """A speed limit: the speed of the stem against its distance from the command."""
    both_rates = moves.value("rate")
    up, down = moves.value("rate_rising") or both_rates, moves.value("rate_falling") or both_rates
    slower = min((rate for rate in (up, down) if rate > 0.0), default=1.0)
    error, speed, took = _speed_by_error(moves, STEP_OF_SWING * swing(moves.op) / slower)
    low, high = _ends(error)
    speeds = np.unique(np.clip([low, -down * took, up * took, high], low, high))
    ways = f"{_top_speed(up)} rising, {_top_speed(down)} falling"
    label = f"limit: {_top_speed(up)}" if both_rates else f"limits: {ways}"
    caption = (
        "However far the stem is from its command, its speed stays near the limit; "
        "without one the points would go on along the slope."
    )
    return _of_speed(
        error, speed, caption, FittedLine(label, speeds, np.clip(speeds / took, -down, up))
    )


def _top_speed(rate: float) -> str:
    return f"{rate:.3g} %/s" if 0.0 < rate < NO_TOP_SPEED else "none"


def _lagging(moves: Moves) -> EffectSignature:
    """A lag: the speed of the stem against its distance from the command."""
    both_lags = moves.value("tau") or moves.value("tau_v") or moves.value("recovery")
    up, down = moves.value("tau_rising") or both_lags, moves.value("tau_falling") or both_lags
    error, speed, took = _speed_by_error(moves, STEP_OF_LAG * max(up, down))
    low, high = _ends(error)
    speeds = np.unique(np.clip([low, 0.0, high], low, high))

    def slope(tau_s: float) -> float:
        return (1.0 - np.exp(-took / tau_s)) / took if tau_s > 0.0 else 1.0 / took

    law = np.where(speeds > 0.0, slope(up), slope(down)) * speeds
    lag_text = (
        f"{up:.3g} s" if abs(up - down) < 1e-9 else f"{up:.3g} s rising, {down:.3g} s falling"
    )
    caption = (
        "The farther the stem is from its command, the faster it moves, by the slope of the "
        "time constant; a speed limit would be flat instead."
    )
    return _of_speed(error, speed, caption, FittedLine(f"time constant {lag_text}", speeds, law))


def _late(moves: Moves) -> EffectSignature:
    """A dead time: the likeness of the moves of OP and stem against the delay applied to OP."""
    theta = max(moves.value("theta"), moves.interval_s)
    shifts = np.linspace(0.0, MOST_SHIFT * theta, SHIFTS)
    step = np.diff(moves.mv)
    likeness = np.array([_likeness(moves, step, float(shift)) for shift in shifts])
    return EffectSignature(
        x_label="OP taken later by, s",
        y_label="likeness of the moves of OP and stem",
        x=shifts,
        y=likeness,
        rising=np.ones(SHIFTS, dtype=bool),
        caption=(
            "The correlation of the stem's moves from sample to sample with those of OP, the "
            "longer ago the farther to the right; what else slows the stem moves the peak as well."
        ),
        laws=(
            FittedLine(
                f"dead time {moves.value('theta'):.3g} s",
                np.full(2, moves.value("theta")),
                np.array([float(np.nanmin(likeness)), float(np.nanmax(likeness))]),
            ),
        ),
        joined=True,
    )


def _likeness(moves: Moves, step: Floats, shift_s: float) -> float:
    """The correlation of the stem's steps (n - 1,) with those of OP taken ``shift_s`` later; NaN
    where few samples have both.
    """
    of_op = np.diff(later(moves.op, shift_s, moves.interval_s))
    both_finite = np.isfinite(of_op) & np.isfinite(step)
    if np.count_nonzero(both_finite) < FEWEST or not (
        np.std(of_op[both_finite]) and np.std(step[both_finite])
    ):
        return float("nan")
    return float(np.corrcoef(of_op[both_finite], step[both_finite])[0, 1])


def _difference(moves: Moves) -> Floats:
    """(n,) position less OP, percent, OP taken later by the dead time that was named."""
    return np.asarray(moves.mv - later(moves.op, moves.late_s, moves.interval_s))


def _is_rising(moves: Moves) -> Bools:
    """(n,) where the command last went upwards."""
    step = np.diff(moves.op, prepend=moves.op[:1])
    last = np.maximum.accumulate(np.where(np.abs(step) > 0.0, np.arange(step.size), 0))
    return np.asarray(step[last] > 0.0)


def _by_place(moves: Moves, caption: str, *laws: FittedLine) -> EffectSignature:
    return EffectSignature(
        x_label="position, %",
        y_label="position less OP, %",
        x=moves.mv,
        y=_difference(moves),
        rising=_is_rising(moves),
        caption=caption,
        laws=laws,
    )


def _friction_by_place(moves: Moves) -> EffectSignature:
    return _by_place(
        moves,
        "Where friction is higher, the stem lags more behind OP, below it when rising and above it "
        "when falling.",
    )


def _force_by_place(moves: Moves) -> EffectSignature:
    signature = _by_place(
        moves,
        "A force that depends on the place moves both directions alike, up or down. Shown is the "
        "half of the samples in which OP moves least, because a moving stem lags as well.",
    )
    speed = np.abs(np.gradient(later(moves.op, moves.late_s, moves.interval_s)))
    moving = ~(speed <= np.nanmedian(speed)) if np.isfinite(speed).any() else speed > 0.0
    return replace(signature, y=np.where(moving, np.nan, signature.y))


def _zero(moves: Moves) -> EffectSignature:
    zero, ends = moves.value("zero"), np.array(_ends(moves.mv))
    law = FittedLine(f"zero off by {zero:.2g} %", ends, np.full(2, zero))
    return _by_place(moves, "The reading is off by the same everywhere, both ways.", law)


def _span(moves: Moves) -> EffectSignature:
    gain, ends = moves.value("gain") or 1.0, np.array(_ends(moves.mv))
    law = FittedLine(f"{gain:.3g} % for each percent", ends, (gain - 1.0) * (ends - 50.0))
    return _by_place(moves, "The reading is off by more, the farther from mid-travel.", law)


def _bow(moves: Moves) -> EffectSignature:
    bow, places = moves.value("bow"), np.linspace(*_ends(moves.mv), 50)
    law = FittedLine(f"bow of {bow:.2g} %", places, bow * bowed(places))
    return _by_place(moves, "The reading is off along a bow over the stroke, both ways.", law)


def _friction_after_a_turn(moves: Moves) -> EffectSignature:
    since, way = _since_turn(moves.mv)
    return EffectSignature(
        x_label="travel since the turn, %",
        y_label="behind OP, %",
        x=since,
        y=-way * _difference(moves),
        rising=way > 0.0,
        caption="The farther the stem has gone since it turned, the more it lags behind OP, until "
        "the spring has turned as well.",
    )


def _since_turn(mv: Floats) -> tuple[Floats, Floats]:
    """(n,) how far the stem is from where it last turned, percent, and 1 where it has risen since,
    -1 where it has fallen; turns within ``LEAST_TURN`` are none. NaN before the first."""
    since, way = np.full(mv.size, np.nan), np.full(mv.size, np.nan)
    finite = np.flatnonzero(np.isfinite(mv))
    turns = reversals(mv[finite], LEAST_TURN)
    if turns.size:
        after = finite[turns[0] :]
        last = np.searchsorted(turns, np.arange(turns[0], finite.size), side="right") - 1
        moved = mv[after] - mv[finite][turns[last]]
        since[after], way[after] = np.abs(moved), np.sign(moved)
    return since, way


def _stopped(moves: Moves) -> EffectSignature:
    op = later(moves.op, moves.late_s, moves.interval_s)
    ends = np.array(_ends(op))
    stops = (("lower", moves.value("stop_low"), 0.1), ("upper", moves.value("stop_high"), 99.9))
    laws = tuple(
        FittedLine(f"{name} stop at {place:.3g} %", ends, np.full(2, place))
        for name, place, end in stops
        if (place > end if name == "lower" else 0.0 < place < end)
    )
    return EffectSignature(
        x_label="OP, %",
        y_label="position, %",
        x=op,
        y=moves.mv,
        rising=_is_rising(moves),
        caption="At a stop the position is flat while OP goes on.",
        laws=laws,
    )


def _by_time(moves: Moves) -> EffectSignature:
    return EffectSignature(
        x_label="time, min",
        y_label="position less OP, %",
        x=np.arange(moves.op.size, dtype=np.float64) * (moves.interval_s / 60.0),
        y=_difference(moves),
        rising=_is_rising(moves),
        caption="What changes with time moves or widens the band between rising and falling.",
    )


def _by_speed(moves: Moves) -> EffectSignature:
    step = SAMPLES_OF_SPEED
    x, y = np.full(moves.op.size, np.nan), np.full(moves.op.size, np.nan)
    x[step:] = (moves.op[step:] - moves.op[:-step]) / (step * moves.interval_s)
    y[step:] = (moves.mv[step:] - moves.mv[:-step]) / (step * moves.interval_s)
    return EffectSignature(
        x_label="speed of OP, %/s",
        y_label=SPEED,
        x=x,
        y=y,
        rising=x > 0.0,
        caption=(
            "A stem that slides has the speed of its command; one that sticks again and again "
            "stands, or jumps at a higher speed."
        ),
    )


def _slips(moves: Moves) -> EffectSignature | None:
    both_finite = np.isfinite(moves.op) & np.isfinite(moves.mv)
    if not both_finite.all():
        return None
    noise = 1.4826 * float(np.median(np.abs(np.diff(moves.mv)))) / np.sqrt(2.0)
    jumps = jumps_from_rest(moves.mv, moves.op, max(noise, 0.01))
    rest_s = np.diff(jumps.begins, prepend=jumps.begins[:1]) * moves.interval_s
    return EffectSignature(
        x_label="time since the slip before, s",
        y_label="size of the slip, %",
        x=rest_s.astype(np.float64),
        y=np.abs(jumps.sizes),
        rising=jumps.sizes > 0.0,
        caption="Each point is one slip of the stem from rest.",
    )


def _ends(values: Floats) -> tuple[float, float]:
    """The range of ``values`` without the outermost half percent on either side."""
    finite = values[np.isfinite(values)]
    if not finite.size:
        return 0.0, 1.0
    low, high = np.percentile(finite, [0.5, 99.5])
    return float(low), float(high)


_SIGNATURES: Mapping[str, Callable[[Moves], EffectSignature | None]] = MappingProxyType(
    {
        **dict.fromkeys(("rate_limit", "asymmetric_rate_limit"), _limited),
        **dict.fromkeys(
            (
                "actuator_lag",
                "asymmetric_lag",
                "viscous_drag",
                "motor_drive",
                "supply_sag",
                "underdamped_positioner",
            ),
            _lagging,
        ),
        "dead_time": _late,
        "position_dependent_friction": _friction_by_place,
        "flow_force": _force_by_place,
        "load_by_position": _force_by_place,
        "bowed_linkage": _bow,
        "spring_hysteresis": _friction_after_a_turn,
        "zero_shift": _zero,
        "span_error": _span,
        "travel_stop": _stopped,
        **dict.fromkeys(("sensor_drift", "growing_stiction", "stem_creep", "presliding"), _by_time),
        **dict.fromkeys(("low_speed_restick", "slip_overshoot"), _by_speed),
        **dict.fromkeys(("asymmetric_slip", "lost_motion", "dwell_dependent_breakaway"), _slips),
    }
)
