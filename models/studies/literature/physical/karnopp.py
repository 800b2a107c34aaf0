"""Karnopp's friction: velocities within a narrow band count as rest."""

from __future__ import annotations

from stemwatch.models.studies.literature.model import KernelModel
from stemwatch.models.studies.literature.physical.classical import PHYSICAL_LIMITS
from stemwatch.models.studies.literature.physical.coulomb import coulomb_run
from stemwatch.models.studies.literature.physical.published import ParameterSet
from stemwatch.models.studies.literature.physical.shared_parameters import (
    BALANCE,
    SECTION,
    STRIBECK,
    TOLERANCE_PERCENT,
    USUAL,
    friction_parameters,
    kinetic_not_above_static,
)
from stemwatch.models.studies.literature.shared_parameters import UNREAD

BAND_M_PER_S = 1e-6  # far below every Stribeck speed that was published for a valve


def karnopp(
    valve: ParameterSet = USUAL, tolerance_percent: float = TOLERANCE_PERCENT
) -> KernelModel:
    """Karnopp's model of ``valve`` with the band DV; parameters Fs, Fc (N) and Fv (N s/m)."""
    return KernelModel(
        name="karnopp",
        source=(
            "Karnopp, Computer simulation of stick-slip friction in mechanical dynamic systems "
            f"(1985), doi:10.1115/1.3140698; {SECTION} {UNREAD}."
        ),
        parameters=friction_parameters(valve),
        text=(
            BALANCE + f"|v| > DV: Ff = {STRIBECK}. |v| <= DV: the stem rests while |Fe| <= Fs, "
            "with Fe = Sa P - k x - Finit."
        ),
        limits=(
            "DV is numerical, not physical: far below the Stribeck speed, and above what the "
            "integration can tell from rest.",
            "The band must be entered again where the velocity changes its sign within a step; "
            "otherwise the stem never sticks again.",
            *PHYSICAL_LIMITS,
        ),
        run=coulomb_run(valve, BAND_M_PER_S, tolerance_percent),
        relation=kinetic_not_above_static,
        slow=True,
    )


KARNOPP = karnopp()
