"""Rare effects, most of them outside the catalogue: systematic, but no term explains them.

A mixed draw takes them all in turn, those that a term was written for since (``NAMED_SINCE``) too,
so that a seed draws the same valves as before.
"""

from __future__ import annotations

import numpy as np

from stemwatch.models.studies.simulator.hidden.hidden_effect import (
    HiddenEffect,
    Sizes,
    by_name,
    either_sign,
    log_uniform,
    with_body,
    with_transmitters,
    with_upsets,
)
from stemwatch.models.studies.simulator.loop import PlantLoop


def _vibration(rng: np.random.Generator, _: PlantLoop) -> Sizes:
    return {
        "vibration_percent": float(rng.uniform(0.5, 1.5)),
        "vibration_hz": log_uniform(rng, 0.03, 0.3),
    }


def _roughness(rng: np.random.Generator, _: PlantLoop) -> Sizes:
    return {"rough_percent": float(rng.uniform(1.0, 4.0)), "rough_s": log_uniform(rng, 5.0, 60.0)}


def _wave(rng: np.random.Generator, _: PlantLoop) -> Sizes:
    return {"wave": float(rng.uniform(0.3, 0.6)), "wave_s": float(rng.uniform(500.0, 1200.0))}


def _binding(rng: np.random.Generator, _: PlantLoop) -> Sizes:
    return {
        "binding": float(rng.uniform(1.8, 3.0)),
        "binding_every_s": float(rng.uniform(300.0, 600.0)),
        "binding_lasts_s": float(rng.uniform(60.0, 200.0)),
    }


def _pushes(rng: np.random.Generator, loop: PlantLoop) -> Sizes:
    return {
        "push_percent": float(rng.uniform(1.0, 3.0)) * max(loop.valve.S, 3.0),
        "push_every_s": float(rng.uniform(200.0, 500.0)),
        "push_lasts_s": float(rng.uniform(10.0, 60.0)),
    }


def _hysteresis(rng: np.random.Generator, _: PlantLoop) -> Sizes:
    return {
        "hysteresis_percent": float(rng.uniform(1.0, 2.5)),
        "hysteresis_way_percent": float(rng.uniform(4.0, 12.0)),
    }


RARE = {
    effect.slug: effect
    for effect in (
        HiddenEffect(slug="vibration", draw=_vibration, apply=by_name(with_upsets)),
        HiddenEffect(slug="rough_force", draw=_roughness, apply=by_name(with_upsets)),
        HiddenEffect(slug="friction_wave", draw=_wave, apply=by_name(with_upsets)),
        HiddenEffect(slug="binding", draw=_binding, apply=by_name(with_upsets)),
        HiddenEffect(slug="handwheel", draw=_pushes, apply=by_name(with_upsets)),
        HiddenEffect(
            slug="bowed_linkage",
            draw=lambda rng, _: {"bow_percent": either_sign(rng, 0.8, 2.0)},
            apply=lambda loop, sizes: with_transmitters(loop, position_bow=sizes["bow_percent"]),
        ),
        HiddenEffect(slug="spring_hysteresis", draw=_hysteresis, apply=by_name(with_body)),
    )
}
NAMED_SINCE = ("bowed_linkage", "spring_hysteresis")
UNKNOWN = {slug: effect for slug, effect in RARE.items() if slug not in NAMED_SINCE}
