"""Classical friction: static at rest, kinetic with a Stribeck drop in motion."""

from __future__ import annotations

from stemwatch.models.studies.literature.model import KernelModel
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

PHYSICAL_LIMITS = (
    "OP is taken as a straight line between samples: a controller that steps is smoothed by up to "
    "one interval.",
    "There are no end stops: parts of a record against a stop have to be left out.",
    "On a ramp slower than the Stribeck speed a light valve makes repeated slips, and the S that "
    "is read from them depends on where in that cycle the reversal falls.",
)


def classical(
    valve: ParameterSet = USUAL, tolerance_percent: float = TOLERANCE_PERCENT
) -> KernelModel:
    """The classical friction model of ``valve``; parameters Fs, Fc (N) and Fv (N s/m)."""
    return KernelModel(
        name="classical",
        source=f"Textbook Coulomb friction with a Stribeck drop; {SECTION} {UNREAD}.",
        parameters=friction_parameters(valve),
        text=(
            BALANCE + f"v != 0: Ff = {STRIBECK}. v == 0: Ff = clip(Fe, -Fs, Fs) with the force "
            "Fe = Sa P - k x - Finit."
        ),
        limits=(
            "The instant at which the stem comes to rest is searched for; a solver of fixed step "
            "would never meet v == 0.",
            "With Fs = Fc a stem whose command stands still creeps towards its place without ever "
            "coming to rest.",
            *PHYSICAL_LIMITS,
        ),
        run=coulomb_run(valve, 0.0, tolerance_percent),
        relation=kinetic_not_above_static,
        slow=True,
    )


CLASSICAL = classical()
