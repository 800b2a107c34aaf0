"""The effects that can be hidden in a simulated loop, by the slug of the catalogue."""

from __future__ import annotations

from collections.abc import Mapping

from stemwatch.models.studies.simulator.hidden.air import AIR
from stemwatch.models.studies.simulator.hidden.friction import FRICTION
from stemwatch.models.studies.simulator.hidden.hidden_effect import HiddenEffect
from stemwatch.models.studies.simulator.hidden.record_effects import RECORD_EFFECTS
from stemwatch.models.studies.simulator.hidden.sensing import SENSING
from stemwatch.models.studies.simulator.hidden.unknown import RARE
from stemwatch.models.studies.simulator.loop import PlantLoop

PHYSICS = tuple(effect.slug for effect in (*AIR, *FRICTION, *SENSING))
RECORD = tuple(effect.slug for effect in RECORD_EFFECTS)
EFFECTS: Mapping[str, HiddenEffect] = {
    effect.slug: effect for effect in (*AIR, *FRICTION, *SENSING, *RECORD_EFFECTS)
}
# Two effects of one group cannot be separated, or set the same number of the valve.
_GROUPS = (
    {"actuator_lag", "asymmetric_lag", "underdamped_positioner", "viscous_drag"},
    {"rate_limit", "asymmetric_rate_limit", "supply_sag"},
    {"zero_shift", "span_error", "asymmetric_slip", "flow_force"},
)


def effect_named(name: str) -> HiddenEffect:
    """The effect ``name``, of the catalogue or outside it.

    Raises ``KeyError`` with the names there are.
    """
    effect = EFFECTS.get(name) or RARE.get(name)
    if effect is None:
        known_names = ", ".join([*EFFECTS, *RARE])
        raise KeyError(f"no effect {name!r} can be hidden; there are {known_names}")
    return effect


def go_together(first: str, second: str) -> bool:
    """Whether two effects can be separated when both are hidden in one valve."""
    return first != second and not any({first, second} <= group for group in _GROUPS)


def with_effect(loop: PlantLoop, name: str, sizes: Mapping[str, float]) -> PlantLoop:
    """``loop`` with effect ``name``; ``sizes`` holds those of all effects as ``name.size``."""
    sizes_of_effect = {
        key.split(".", 1)[1]: x for key, x in sizes.items() if key.split(".", 1)[0] == name
    }
    return effect_named(name).apply(loop, sizes_of_effect)
