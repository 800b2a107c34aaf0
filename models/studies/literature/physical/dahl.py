"""Dahl's friction: bristles without a Stribeck drop and without stiction."""

from __future__ import annotations

from dataclasses import replace

from stemwatch.models.recording import Floats
from stemwatch.models.studies.literature.model import KernelModel
from stemwatch.models.studies.literature.physical.body import Packing
from stemwatch.models.studies.literature.physical.bristle import bristle_run
from stemwatch.models.studies.literature.physical.classical import PHYSICAL_LIMITS
from stemwatch.models.studies.literature.physical.published import ParameterSet
from stemwatch.models.studies.literature.physical.shared_parameters import (
    BALANCE,
    SECTION,
    TOLERANCE_PERCENT,
    USUAL,
    coulomb_level,
    viscous,
)
from stemwatch.models.studies.literature.shared_parameters import UNREAD


def dahl(valve: ParameterSet = USUAL, tolerance_percent: float = TOLERANCE_PERCENT) -> KernelModel:
    """Dahl's model of ``valve``; parameters Fc (N) and Fv (N s/m), s0 the packing's."""

    def packing(q: Floats) -> Packing:
        levels = {"static_n": q[0], "kinetic_n": q[0], "viscous_ns_per_m": q[1]}
        return replace(valve.packing, bristle_ns_per_m=0.0, **levels)

    return KernelModel(
        name="dahl",
        source=f"Dahl, A solid friction model (1968); {SECTION} {UNREAD}.",
        parameters=(coulomb_level(valve), viscous(valve)),
        text=BALANCE + "z' = v - s0 |v| z/Fc, Ff = s0 z + Fv v.",
        limits=(
            "There is no Stribeck drop and no stiction: J is always 0.",
            "It drifts in presliding, like LuGre.",
            *PHYSICAL_LIMITS,
        ),
        run=bristle_run(valve, packing, tolerance_percent),
        slow=True,
    )


DAHL = dahl()
