"""From a valve and its packing to the constants of the kernel of bristle friction."""

from __future__ import annotations

import numpy as np

from stemwatch.models.recording import Floats
from stemwatch.models.zoo.physical import bristle
from stemwatch.models.zoo.physical.body import Packing, ValveBody
from stemwatch.models.zoo.physical.friction import actuator_force


def bristle_constants(body: ValveBody, packing: Packing, tolerance_percent: float) -> Floats:
    """(11,) constants in the order of ``bristle``."""
    c = np.empty(bristle.N_CONSTANTS)
    c[bristle.MASS], c[bristle.SPRING] = body.mass_kg, body.spring_n_per_m
    c[bristle.STATIC], c[bristle.KINETIC] = packing.static_n, packing.kinetic_n
    c[bristle.VISCOUS], c[bristle.STRIBECK] = packing.viscous_ns_per_m, packing.stribeck_m_per_s
    c[bristle.STIFFNESS], c[bristle.DAMPING] = packing.bristle_n_per_m, packing.bristle_ns_per_m
    c[bristle.TOLERANCE] = 0.01 * tolerance_percent * body.stroke_m
    c[bristle.FORCE], c[bristle.FORCE_PER_PERCENT] = actuator_force(body)
    return c
