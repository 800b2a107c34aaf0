"""The detailed force balance, after Mueller (1994), with air lag, flow force and end stops."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stemwatch.models.recording import Floats
from stemwatch.models.studies.literature.model import KernelModel, Parameter
from stemwatch.models.studies.literature.physical import coulomb
from stemwatch.models.studies.literature.physical.coulomb import coulomb_constants
from stemwatch.models.studies.literature.physical.karnopp import BAND_M_PER_S
from stemwatch.models.studies.literature.physical.published import ParameterSet
from stemwatch.models.studies.literature.physical.shared_parameters import (
    STRIBECK,
    TOLERANCE_PERCENT,
    USUAL,
    friction_parameters,
    kinetic_not_above_static,
    packing_of,
)

_SOURCE = (
    "After Mueller, Simulation of an air operated sticky flow control valve, Summer Computer "
    "Simulation Conference (1994) 742-745, of which only title and existence are known (reference "
    "5 of Zabiri, Samyudia and Zainudin). Equations and numbers are not from there: the force "
    "balance is the general one of spring-and-diaphragm valves (from memory); first-order air, a "
    "flow force linear in the stem and hard end stops are this product's choice."
)


def mueller(
    valve: ParameterSet = USUAL, tolerance_percent: float = TOLERANCE_PERCENT
) -> KernelModel:
    """The detailed force balance of ``valve``: Fs, Fc (N), Fv (N s/m), air lag (s), flow force (N).

    The pressure at the samples is exact for an OP that is straight between them; between samples
    it is taken as straight too, an error of second order in interval over lag.
    """

    def run(op: Floats, q: Floats, interval_s: float, y0: float, out: Floats) -> None:
        body = valve.body
        stiffer = replace(body, spring_n_per_m=body.spring_n_per_m + q[4] / body.stroke_m)
        packing = packing_of(q, valve.packing)
        c = coulomb_constants(stiffer, packing, BAND_M_PER_S, tolerance_percent)
        c[coulomb.STOP_LOW], c[coulomb.STOP_HIGH] = 0.0, body.stroke_m
        pressure = np.empty(op.size)
        coulomb.air_lag(op, interval_s, q[3], pressure)
        coulomb.run_coulomb(pressure, interval_s, body.stroke_m, y0, c, out)

    return KernelModel(
        name="mueller",
        source=_SOURCE,
        parameters=(*friction_parameters(valve), *_further(valve)),
        text=(
            "m x'' = Sa P - k x - Finit - Ff - Fflow, 0 <= x <= stroke. T P' = P(OP) - P. "
            f"Ff = {STRIBECK}, with Karnopp's band. Fflow = Fo x/stroke."
        ),
        limits=(
            "This is not the cited paper's model.",
            "The flow force cannot be told from an error of the position's span, "
            "nor a dead time in the air from a skew of clocks.",
            "OP is taken as a straight line between samples.",
            "At a stop the stem loses its speed; there is no seat that gives.",
        ),
        run=run,
        relation=kinetic_not_above_static,
        slow=True,
    )


def _further(valve: ParameterSet) -> tuple[Parameter, Parameter]:
    return (
        Parameter(
            name="air_lag_s",
            unit="s",
            lower=0.0,
            upper=15.0,
            default=0.5,
            meaning="T: time constant of filling the diaphragm chamber",
        ),
        Parameter(
            name="flow_force_n",
            unit="N",
            lower=-0.2 * valve.body.spring_span_n,
            upper=0.2 * valve.body.spring_span_n,
            default=0.0,
            meaning="Fo: force of the flow on the open stem, positive where it closes",
        ),
    )


MUELLER = mueller()
