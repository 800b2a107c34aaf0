"""Hidden effects of the packing: drag, re-sticking, skew, tight spots, growth, dwell, creep."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from stemwatch.models.studies.simulator.hidden.hidden_effect import (
    HiddenEffect,
    Sizes,
    by_name,
    either_sign,
    log_uniform,
    with_actuator,
    with_packing,
    with_upsets,
)
from stemwatch.models.studies.simulator.loop import PlantLoop

# The jump of the heavier side is at most this share of S, or its kinetic level would be negative.
_MOST_J_OF_S = 0.95


def _skew(rng: np.random.Generator, loop: PlantLoop) -> Sizes:
    valve = loop.valve
    most_skew = min(_MOST_J_OF_S * valve.S / valve.J - 1.0, 0.8) if valve.J > 0.0 else 0.8
    J_skew = either_sign(rng, min(0.35, most_skew), most_skew)
    # Half of the skewed packings have a skewed S too, which a recording cannot separate from a zero
    # shift.
    S_skew = float(rng.uniform(-0.2, 0.2)) if rng.random() < 0.5 else 0.0
    return {"J_skew": J_skew, "S_skew": S_skew}


def _bump(rng: np.random.Generator, _: PlantLoop) -> Sizes:
    return {
        "height_percent": float(rng.uniform(1.0, 3.0)),
        "at_percent": float(rng.uniform(35.0, 65.0)),
        "width_percent": float(rng.uniform(3.0, 8.0)),
    }


def _with_bump(loop: PlantLoop, sizes: Mapping[str, float]) -> PlantLoop:
    return with_packing(
        loop,
        bump_percent=sizes["height_percent"],
        bump_at_percent=sizes["at_percent"],
        bump_width_percent=sizes["width_percent"],
    )


def _dwell(rng: np.random.Generator, _: PlantLoop) -> Sizes:
    rise = log_uniform(rng, 0.15, 0.6)
    if rng.random() < 0.75:
        return {"percent": rise, "time_s": 5.0, "settles": 0.0}
    # A level that saturates reaches about the value of the logarithm after three minutes.
    return {"percent": 3.5 * rise, "time_s": float(rng.uniform(20.0, 80.0)), "settles": 1.0}


def _with_dwell(loop: PlantLoop, sizes: Mapping[str, float]) -> PlantLoop:
    return with_packing(
        loop,
        dwell_percent=sizes["percent"],
        dwell_s=sizes["time_s"],
        dwell_settles=bool(sizes["settles"]),
    )


FRICTION = (
    HiddenEffect(
        slug="viscous_drag",
        draw=lambda rng, _: {"drag_s": log_uniform(rng, 1.2, 6.0)},
        apply=lambda loop, sizes: with_actuator(loop, viscous_s=sizes["drag_s"]),
        delay_s=lambda sizes: sizes["drag_s"],
    ),
    HiddenEffect(
        slug="low_speed_restick",
        draw=lambda rng, _: {"stribeck_percent_per_s": log_uniform(rng, 0.15, 2.0)},
        apply=by_name(with_actuator),
    ),
    HiddenEffect(slug="asymmetric_slip", draw=_skew, apply=by_name(with_packing)),
    HiddenEffect(slug="position_dependent_friction", draw=_bump, apply=_with_bump),
    HiddenEffect(
        slug="growing_stiction",
        draw=lambda rng, _: {"growth": float(rng.uniform(0.4, 1.2))},
        apply=by_name(with_upsets),
    ),
    HiddenEffect(slug="dwell_dependent_breakaway", draw=_dwell, apply=_with_dwell),
    HiddenEffect(
        slug="stem_creep",
        draw=lambda rng, _: {"creep_percent_per_s": either_sign(rng, 0.01, 0.05)},
        apply=by_name(with_packing),
    ),
)
