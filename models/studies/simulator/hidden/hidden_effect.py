"""``HiddenEffect``: how one hidden effect is drawn and put into a loop."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from stemwatch.models.studies.simulator.loop import PlantLoop

Sizes = dict[str, float]


@dataclass(frozen=True, kw_only=True)
class HiddenEffect:
    """``draw`` gives the sizes for a loop, ``apply`` the loop with them; ``delay_s`` is the dead
    time that they add to the loop, for which the controller is tuned."""

    slug: str
    draw: Callable[[np.random.Generator, PlantLoop], Sizes]
    apply: Callable[[PlantLoop, Mapping[str, float]], PlantLoop]
    delay_s: Callable[[Mapping[str, float]], float] = lambda sizes: 0.0


def by_name(
    change: Callable[..., PlantLoop],
) -> Callable[[PlantLoop, Mapping[str, float]], PlantLoop]:
    """The ``apply`` of an effect whose sizes have the names that ``change`` takes."""
    return lambda loop, sizes: change(loop, **sizes)


def either_sign(rng: np.random.Generator, low: float, high: float) -> float:
    """Drawn between ``low`` and ``high`` in size, with either sign."""
    return float(rng.uniform(low, high) * rng.choice([-1.0, 1.0]))


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """Drawn between ``low`` and ``high``, evenly in the logarithm."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def with_actuator(loop: PlantLoop, **changes: Any) -> PlantLoop:
    """``loop`` with changes of the actuator."""
    actuator = replace(loop.valve.actuator, **changes)
    return replace(loop, valve=replace(loop.valve, actuator=actuator))


def with_air_line(loop: PlantLoop, **changes: Any) -> PlantLoop:
    """``loop`` with changes of the air line."""
    line = replace(loop.valve.air_line, **changes)
    return replace(loop, valve=replace(loop.valve, air_line=line))


def with_packing(loop: PlantLoop, **changes: Any) -> PlantLoop:
    """``loop`` with changes of the packing."""
    packing = replace(loop.valve.packing, **changes)
    return replace(loop, valve=replace(loop.valve, packing=packing))


def with_body(loop: PlantLoop, **changes: Any) -> PlantLoop:
    """``loop`` with changes of the body."""
    return replace(loop, valve=replace(loop.valve, body=replace(loop.valve.body, **changes)))


def with_upsets(loop: PlantLoop, **changes: Any) -> PlantLoop:
    """``loop`` with changes of its upsets."""
    return replace(loop, upsets=replace(loop.upsets, **changes))


def with_transmitters(loop: PlantLoop, **changes: Any) -> PlantLoop:
    """``loop`` with changes of its transmitters."""
    return replace(loop, transmitters=replace(loop.transmitters, **changes))


def with_archive(loop: PlantLoop, **changes: Any) -> PlantLoop:
    """``loop`` with changes of its archive."""
    return replace(loop, archive=replace(loop.archive, **changes))
