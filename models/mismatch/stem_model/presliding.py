"""How far a stem gives way to a change of the force on it before it lets go.

Packing holds a stem by contacts that bend, and of which the most strained ones slip before the
whole does. In LuGre's model (Canudas de Wit, Olsson, Astrom and Lischinsky 1995,
doi:10.1109/9.376053) they are bristles of stiffness ``s0``, and below the breakaway level ``fs`` a
stem under the force ``f`` moves with ``v (1 - d f/fs) = |df/dt| / s0``, ``d`` the direction of the
change. So a change of the force from ``f0`` to ``f1`` moves it by

    (fs/s0) ln((1 - q0)/(1 - q1)),    q = d f/fs,

the more the nearer the force is to the level. A change back moves it back by less: under a force
that swings, as that of an OP with noise, a stem creeps towards it.
"""

from __future__ import annotations

import numpy as np

from stemwatch.models.mismatch.stem_model.lanes import never_raises

# Share of the level from which the way goes on as there: the logarithm has no end.
_NEAR = 0.98
_LEAST_LEVEL = 1e-3  # percent


@never_raises
def _way(q: float) -> float:
    """The way, in deflections at the level, to a share ``q`` of the level."""
    if q < _NEAR:
        way: float = -np.log(1.0 - q)
        return way
    beyond: float = -np.log(1.0 - _NEAR) + (q - _NEAR) / (1.0 - _NEAR)
    return beyond


@never_raises
def way_of_bristles(before: float, force: float, level: float, gives: float) -> float:
    """How far the bristles would let a stem move while the force goes from ``before`` to ``force``,
    percent, its sign apart, if its motion took nothing off the force.
    """
    side, level = 1.0 if force > before else -1.0, max(level, _LEAST_LEVEL)
    way: float = gives * level * (_way(side * force / level) - _way(side * before / level))
    return way


@never_raises
def given_way(before: float, force: float, level: float, gives: float) -> float:
    """How far a resting stem moves while the force on it goes from ``before`` to ``force``, percent
    of travel: never further than the force itself, which its motion takes off.

    ``gives`` is 1/s0, percent of travel for a percent of force.
    """
    if gives <= 0.0 or force == before:
        return 0.0
    side = 1.0 if force > before else -1.0
    last = side * force / max(level, _LEAST_LEVEL)
    way = way_of_bristles(before, force, level, gives)
    return side * way / (1.0 + gives / (1.0 - min(last, _NEAR)))
