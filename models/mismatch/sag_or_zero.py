"""Whether a zero error of the reading could be a supply that sags.

A supply that falls short on moves one way leaves the stem short of its command that way, for a
while; in a record of few moves that is as good as a zero error. A sag that takes the place of the
zero is fitted with everything else. Where it predicts unseen blocks of time as well, both are
named.
"""

from __future__ import annotations

from stemwatch.models.mismatch import evaluator as base_coordinate
from stemwatch.models.mismatch.bend_or_slope import fitted_instead
from stemwatch.models.mismatch.crossfit import Fitted, gain
from stemwatch.models.mismatch.evaluator import Evaluator
from stemwatch.models.mismatch.term import Term
from stemwatch.models.mismatch.term_selection import AS_GOOD

ZERO, SAG = "zero_shift", "supply_sag"


def sags_instead(evaluator: Evaluator, shifted: Fitted, sag: Term) -> bool:
    """True where a material sag does as well as the zero error of ``shifted``."""
    if SAG in shifted.layout.places:
        return False
    sagging = fitted_instead(evaluator, shifted, base_coordinate.ZERO, sag)
    if not sag.material(sagging.values(SAG).mean(axis=0), evaluator.summary):
        return False
    return gain(evaluator, sagging, shifted).t < AS_GOOD
