"""``Truth``: the true S, J, shape and effects of a simulated recording."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from enum import StrEnum

import numpy as np

from stemwatch.models.recording import Floats, Role
from stemwatch.models.studies.simulator.defects import Upsets
from stemwatch.models.studies.simulator.loop import LoadKind, PlantLoop
from stemwatch.models.verdict import Shape

Plain = float | int | str | bool | None

# With this many air lags between two scans of the controller, the stem comes to rest between them.
_RESTING_SCAN_LAGS = 3.0
# A slip that takes a second or more shows at 1 s; every ordinarily drawn valve is far below this.
_DRAGGING_S = 0.5
_RESTICKING_PERCENT_PER_S = 0.1
# A loop oscillates where the intervals between crossings differ by less than this share.
_REGULAR = 0.35
_FEWEST_CROSSINGS = 8


@dataclass(frozen=True, kw_only=True)
class Truth:
    """``S`` and ``J`` in percent of span, as a person reads them off the noise-free OP-MV loop.

    ``shape`` is ``None`` on a healthy valve. ``effects`` are the identifiers of what else is in
    valve and record. ``period_s`` is the period of the loop's oscillation, ``None`` where it has
    none. ``parameters`` is everything drawn, with dotted names.
    """

    tag: str
    S: float
    J: float
    healthy: bool
    shape: Shape | None
    kind: str
    story: str
    effects: tuple[str, ...]
    period_s: float | None
    seed: int
    parameters: dict[str, Plain]

    def as_json(self) -> dict[str, object]:
        """The truth in types that ``json.dumps`` takes."""
        return asdict(self) | {"effects": list(self.effects)}


def truth_of(loop: PlantLoop, seed: int, pv: Floats, set_point: Floats) -> Truth:
    """The truth of ``loop``; ``pv`` (n,) without noise and ``set_point`` (n,) give the period."""
    valve = loop.valve
    return Truth(
        tag=loop.tag,
        S=valve.S_read,
        J=valve.J_read,
        healthy=valve.healthy,
        shape=None if valve.healthy else valve.shape,
        kind=loop.process.kind.value,
        story=loop.story,
        effects=effects_of(loop),
        period_s=_period_s(loop, pv - set_point),
        seed=seed,
        parameters=dict(_flat(asdict(loop))),
    )


def _period_s(loop: PlantLoop, error: Floats) -> float | None:
    """The disturbance's period where one is drawn; none where set-point moves drive the loop."""
    waves = [load.time_s for load in loop.loads if load.kind is LoadKind.OSCILLATING]
    if waves:
        return waves[0]
    if len(loop.setpoints) > 1:
        return None
    return oscillation_period_s(error, loop.archive.interval_s)


def effects_of(loop: PlantLoop) -> tuple[str, ...]:
    """Identifiers of the effects in valve and record beyond S and J, in the order of the chain."""
    actuator, transmitters, archive = loop.valve.actuator, loop.transmitters, loop.archive
    line, packing, body, upsets = (
        loop.valve.air_line,
        loop.valve.packing,
        loop.valve.body,
        loop.upsets,
    )
    limits = (line.fill_percent_per_s, line.vent_percent_per_s)
    steps = (transmitters.position_step, transmitters.op_step, transmitters.pv_step)
    standard = Upsets(growth=upsets.growth)
    positioned = loop.valve.positioner_gain > 0.0
    resting = loop.controller.scan_s > _RESTING_SCAN_LAGS * actuator.air_lag_s
    resticks = positioned or resting or actuator.stribeck_percent_per_s >= _RESTICKING_PERCENT_PER_S
    restick = loop.valve.J > 0.0 and resticks
    present = {
        "positioner": positioned,
        "actuator_lag": actuator.air_lag_s > 0.0,
        "asymmetric_lag": line.vent_lag_s not in (None, actuator.air_lag_s),
        "dead_time": actuator.dead_time_s > 0.0,
        "underdamped_positioner": line.ring_rad_per_s > 0.0,
        "rate_limit": limits[0] is not None and limits[0] == limits[1],
        "asymmetric_rate_limit": limits[0] != limits[1],
        "supply_sag": line.sag_share > 0.0,
        "flow_force": body.flow_percent != 0.0,
        "asymmetric_slip": packing.J_skew != 0.0 or packing.S_skew != 0.0,
        "position_dependent_friction": packing.bump_percent > 0.0,
        "growing_stiction": upsets.growth != 0.0,
        "dwell_dependent_breakaway": packing.dwell_percent > 0.0,
        "stem_creep": packing.creep_percent_per_s != 0.0,
        "viscous_drag": actuator.viscous_s >= _DRAGGING_S,
        "low_speed_restick": restick,
        "breakaway_scatter": loop.valve.scatter > 0.0,
        "travel_stop": body.low_percent > 0.0 or body.high_percent < 100.0,
        "lost_motion": transmitters.position_play > 0.0,
        "zero_shift": transmitters.has_position and transmitters.position_zero != 0.0,
        "span_error": transmitters.has_position and transmitters.position_span != 1.0,
        "sensor_drift": transmitters.position_drift != 0.0 or transmitters.position_walk > 0.0,
        "bowed_linkage": transmitters.has_position and transmitters.position_bow != 0.0,
        "spring_hysteresis": body.hysteresis_percent > 0.0,
        "unknown": upsets != standard,
        "quantisation": max(steps) > 0.0,
        "oscillating_disturbance": any(x.kind is LoadKind.OSCILLATING for x in loop.loads),
        "manual": bool(loop.manual),
        "no_position": not transmitters.has_position,
        "historian_compression": bool(archive.compression),
        "sampling_jitter": archive.uneven,
        "frozen_signal": bool(archive.frozen),
        "frozen_position": any(span.role is Role.MV for span in archive.frozen),
        "gaps": bool(archive.gaps),
        "bad_status": bool(archive.bad),
    }
    return tuple(name for name, is_present in present.items() if is_present)


def oscillation_period_s(error: Floats, interval_s: float) -> float | None:
    """Mean interval between upward crossings of zero, seconds, or ``None``.

    A crossing counts once the error has left a band of half its standard deviation on the other
    side, so that noise does not count; there must be at least seven intervals with a coefficient of
    variation below 0.35.
    """
    centred = error - np.mean(error)
    band = 0.5 * np.std(centred)
    sides = np.where(centred > band, 1, np.where(centred < -band, -1, 0))
    outside = np.flatnonzero(sides)
    if outside.size < 2 or band < 1e-9:
        return None
    rising = outside[1:][(sides[outside[1:]] == 1) & (sides[outside[:-1]] == -1)]
    if rising.size < _FEWEST_CROSSINGS:
        return None
    lengths = np.diff(rising) * interval_s
    if np.std(lengths) > _REGULAR * np.mean(lengths):
        return None
    return float(np.mean(lengths))


def _flat(value: object, name: str = "") -> list[tuple[str, Plain]]:
    if isinstance(value, dict):
        items = [(str(key), inner) for key, inner in value.items()]
    elif isinstance(value, tuple | list):
        items = [(str(index), inner) for index, inner in enumerate(value)]
    else:
        raw_value = value.value if isinstance(value, StrEnum) else value
        assert raw_value is None or isinstance(raw_value, float | int | str | bool)
        return [(name, raw_value)]
    return [leaf for key, inner in items for leaf in _flat(inner, f"{name}.{key}" if name else key)]
