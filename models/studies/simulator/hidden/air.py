"""Hidden effects of the air: lags, delay, restrictions, a relay that rings, a weak supply.

Sizes follow the earlier study of the catalogue and reach a little below it.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from stemwatch.models.studies.simulator.hidden.hidden_effect import (
    HiddenEffect,
    Sizes,
    log_uniform,
    with_actuator,
    with_air_line,
)
from stemwatch.models.studies.simulator.loop import PlantLoop


def _lag(rng: np.random.Generator, _: PlantLoop) -> Sizes:
    return {"lag_s": log_uniform(rng, 1.2, 6.0)}


def _asymmetric_lag(rng: np.random.Generator, _: PlantLoop) -> Sizes:
    slow = float(rng.uniform(2.0, 6.0))
    quick = slow / float(rng.uniform(2.5, 5.0))
    fill, vent = (slow, quick) if rng.random() < 0.5 else (quick, slow)
    return {"fill_lag_s": fill, "vent_lag_s": vent}


def _with_lags(loop: PlantLoop, sizes: Mapping[str, float]) -> PlantLoop:
    slower = with_actuator(loop, air_lag_s=sizes["fill_lag_s"])
    return with_air_line(slower, vent_lag_s=sizes["vent_lag_s"])


def _rate(rng: np.random.Generator, _: PlantLoop) -> Sizes:
    return {"rate_percent_per_s": log_uniform(rng, 0.3, 2.0)}


def _asymmetric_rate(rng: np.random.Generator, _: PlantLoop) -> Sizes:
    slow = log_uniform(rng, 0.3, 3.0)
    quick = slow * log_uniform(rng, 2.5, 10.0)
    fill, vent = (slow, quick) if rng.random() < 0.5 else (quick, slow)
    return {"fill_percent_per_s": fill, "vent_percent_per_s": vent}


def _with_rates(loop: PlantLoop, sizes: Mapping[str, float]) -> PlantLoop:
    return with_air_line(
        loop,
        fill_percent_per_s=sizes.get("fill_percent_per_s", sizes.get("rate_percent_per_s")),
        vent_percent_per_s=sizes.get("vent_percent_per_s", sizes.get("rate_percent_per_s")),
    )


def _ringing(rng: np.random.Generator, _: PlantLoop) -> Sizes:
    return {
        "ring_rad_per_s": float(rng.uniform(0.3, 1.0)),
        "damping": float(rng.uniform(0.15, 0.45)),
    }


def _sag(rng: np.random.Generator, _: PlantLoop) -> Sizes:
    return {"share": float(rng.uniform(0.05, 0.25)), "recovery_s": float(rng.uniform(15.0, 60.0))}


AIR = (
    HiddenEffect(
        slug="actuator_lag",
        draw=_lag,
        apply=lambda loop, sizes: with_actuator(loop, air_lag_s=sizes["lag_s"]),
        delay_s=lambda sizes: sizes["lag_s"],
    ),
    HiddenEffect(
        slug="asymmetric_lag",
        draw=_asymmetric_lag,
        apply=_with_lags,
        delay_s=lambda sizes: max(sizes.values()),
    ),
    HiddenEffect(
        slug="dead_time",
        draw=lambda rng, _: {"delay_s": log_uniform(rng, 0.8, 6.0)},
        apply=lambda loop, sizes: with_actuator(loop, dead_time_s=sizes["delay_s"]),
        delay_s=lambda sizes: sizes["delay_s"],
    ),
    HiddenEffect(slug="rate_limit", draw=_rate, apply=_with_rates, delay_s=lambda _: 3.0),
    HiddenEffect(
        slug="asymmetric_rate_limit",
        draw=_asymmetric_rate,
        apply=_with_rates,
        delay_s=lambda _: 2.0,
    ),
    HiddenEffect(
        slug="underdamped_positioner",
        draw=_ringing,
        apply=lambda loop, sizes: with_air_line(
            loop, ring_rad_per_s=sizes["ring_rad_per_s"], ring_damping=sizes["damping"]
        ),
        # Tuned with this delay, the loop gain at the resonance, raised by 1/(2 zeta), stays below
        # 1.
        delay_s=lambda sizes: 1.0 / (sizes["ring_rad_per_s"] * sizes["damping"]),
    ),
    HiddenEffect(
        slug="supply_sag",
        draw=_sag,
        apply=lambda loop, sizes: with_air_line(
            loop, sag_share=sizes["share"], sag_s=sizes["recovery_s"]
        ),
    ),
)
