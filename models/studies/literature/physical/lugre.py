"""LuGre friction: elastic bristles with a Stribeck curve."""

from __future__ import annotations

from stemwatch.models.studies.literature.model import KernelModel
from stemwatch.models.studies.literature.physical.bristle import bristle_run
from stemwatch.models.studies.literature.physical.classical import PHYSICAL_LIMITS
from stemwatch.models.studies.literature.physical.published import ParameterSet
from stemwatch.models.studies.literature.physical.shared_parameters import (
    BALANCE,
    SECTION,
    TOLERANCE_PERCENT,
    USUAL,
    friction_parameters,
    kinetic_not_above_static,
    packing_of,
)
from stemwatch.models.studies.literature.shared_parameters import UNREAD


def lugre(valve: ParameterSet = USUAL, tolerance_percent: float = TOLERANCE_PERCENT) -> KernelModel:
    """The LuGre model of ``valve``; parameters Fs, Fc (N) and Fv (N s/m), s0 and s1 the packing's.

    s0 = 2.6e7 N/m and s1 = 2.04e4 N s/m were published with set b; for the other sets they are
    assumed.
    """
    return KernelModel(
        name="lugre",
        source=(
            "Canudas de Wit, Olsson, Astrom and Lischinsky, A new model for control of systems "
            "with friction, IEEE Trans. Automatic Control 40 (1995), doi:10.1109/9.376053; "
            f"{SECTION} {UNREAD}."
        ),
        parameters=friction_parameters(valve),
        text=(
            BALANCE + "g(v) = [Fc + (Fs - Fc) exp(-(v/vs)^2)]/s0, z' = v - |v| z/g, "
            "Ff = s0 z + s1 z' + Fv v."
        ),
        limits=(
            "It drifts in presliding: under a command that dithers a resting stem creeps, which "
            "is an artefact.",
            "An explicit solver needs steps below about 1e-5 s; here the bristles are implicit.",
            "A threshold on position is a poor way to read S from it: presliding trips it early.",
            *PHYSICAL_LIMITS,
        ),
        run=bristle_run(valve, lambda q: packing_of(q, valve.packing), tolerance_percent),
        relation=kinetic_not_above_static,
        slow=True,
    )


LUGRE = lugre()
