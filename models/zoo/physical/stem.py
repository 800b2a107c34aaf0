"""From a valve and its packing to the constants of the kernel of Coulomb friction."""

from __future__ import annotations

import numpy as np

from stemwatch.models.recording import Floats
from stemwatch.models.zoo.model import Run
from stemwatch.models.zoo.physical import coulomb
from stemwatch.models.zoo.physical.body import Packing, ValveBody
from stemwatch.models.zoo.physical.friction import actuator_force, packing_of
from stemwatch.models.zoo.physical.published import ParameterSet


def coulomb_constants(
    body: ValveBody, packing: Packing, band_m_per_s: float, tolerance_percent: float
) -> Floats:
    """(12,) constants in the order of ``coulomb``; no stops."""
    c = np.empty(coulomb.N_CONSTANTS)
    c[coulomb.MASS], c[coulomb.SPRING] = body.mass_kg, body.spring_n_per_m
    c[coulomb.STATIC], c[coulomb.KINETIC] = packing.static_n, packing.kinetic_n
    c[coulomb.VISCOUS], c[coulomb.STRIBECK] = packing.viscous_ns_per_m, packing.stribeck_m_per_s
    c[coulomb.BAND] = band_m_per_s
    c[coulomb.STOP_LOW], c[coulomb.STOP_HIGH] = -np.inf, np.inf
    c[coulomb.TOLERANCE] = 0.01 * tolerance_percent * body.stroke_m
    c[coulomb.FORCE], c[coulomb.FORCE_PER_PERCENT] = actuator_force(body)
    return c


def coulomb_run(valve: ParameterSet, band_m_per_s: float, tolerance_percent: float) -> Run:
    """The run of a model whose parameters are Fs, Fc and Fv."""

    def run(op: Floats, q: Floats, interval_s: float, y0: float, out: Floats) -> None:
        packing = packing_of(q, valve.packing)
        c = coulomb_constants(valve.body, packing, band_m_per_s, tolerance_percent)
        coulomb.run_coulomb(op, interval_s, valve.body.stroke_m, y0, c, out)

    return run
