"""Whether a loop's PV follows its OP as no linear loop does, beyond the loop's own chance."""

from __future__ import annotations

from stemwatch.models.recording import Floats
from stemwatch.models.without_position.features import evidence


def non_linearity(op: Floats, pv: Floats) -> float:
    """The gain in held-out error of a sticking element between OP and PV (n,) over a linear loop,
    in standard deviations of surrogates that have the phases of both in common; its inverse
    hyperbolic sine. 0 where it cannot be told."""
    try:
        return evidence(op, pv).beyond
    except ValueError:
        return 0.0
