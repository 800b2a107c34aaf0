"""Hidden effects of body and position transmitter: stops, flow force, play, errors, drift."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from stemwatch.models.studies.simulator.hidden.hidden_effect import (
    HiddenEffect,
    Sizes,
    by_name,
    either_sign,
    with_body,
    with_transmitters,
)
from stemwatch.models.studies.simulator.loop import PlantLoop


def _stop(rng: np.random.Generator, _: PlantLoop) -> Sizes:
    if rng.random() < 0.5:
        return {"high_percent": float(rng.uniform(57.0, 70.0))}
    return {"low_percent": float(rng.uniform(30.0, 43.0))}


def _flow(rng: np.random.Generator, _: PlantLoop) -> Sizes:
    return {
        "flow_percent": either_sign(rng, 2.0, 5.0),
        "flow_peak_percent": float(rng.uniform(45.0, 55.0)),
    }


def _span(rng: np.random.Generator, _: PlantLoop) -> Sizes:
    zero = float(rng.uniform(-1.0, 1.0)) if rng.random() < 0.5 else 0.0
    return {"span": 1.0 + either_sign(rng, 0.03, 0.10), "zero_percent": zero}


def _with_span(loop: PlantLoop, sizes: Mapping[str, float]) -> PlantLoop:
    return with_transmitters(loop, position_span=sizes["span"], position_zero=sizes["zero_percent"])


def _drift(rng: np.random.Generator, _: PlantLoop) -> Sizes:
    if rng.random() < 0.75:
        return {"drift_percent": either_sign(rng, 0.7, 2.5), "walk_percent": 0.0}
    return {"drift_percent": 0.0, "walk_percent": float(rng.uniform(1.0, 2.5))}


SENSING = (
    HiddenEffect(slug="travel_stop", draw=_stop, apply=by_name(with_body)),
    HiddenEffect(slug="flow_force", draw=_flow, apply=by_name(with_body)),
    HiddenEffect(
        slug="lost_motion",
        draw=lambda rng, _: {"play_percent": float(rng.uniform(0.6, 3.0))},
        apply=lambda loop, sizes: with_transmitters(loop, position_play=sizes["play_percent"]),
    ),
    HiddenEffect(
        slug="zero_shift",
        draw=lambda rng, _: {"zero_percent": either_sign(rng, 0.5, 2.0)},
        apply=lambda loop, sizes: with_transmitters(loop, position_zero=sizes["zero_percent"]),
    ),
    HiddenEffect(slug="span_error", draw=_span, apply=_with_span),
    HiddenEffect(
        slug="sensor_drift",
        draw=_drift,
        apply=lambda loop, sizes: with_transmitters(
            loop, position_drift=sizes["drift_percent"], position_walk=sizes["walk_percent"]
        ),
    ),
)
