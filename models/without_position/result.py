"""``WithoutPosition``: what OP and PV alone say of a valve. Report and store read this."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from stemwatch.models.estimate import Estimate


class Suspicion(StrEnum):
    """What OP and PV allow to be said."""

    SUSPECTED = "suspected"
    NO_SIGN = "no_sign"
    CANNOT_TELL = "cannot_tell"


@dataclass(frozen=True, kw_only=True)
class WithoutPosition:
    """What OP and PV say of the valve, for a person to act on.

    ``score`` (0 to 1) is the probability of sticking where half of all loops stick; ``apparent_S``
    in percent of OP, or in OP's own unit; ``shows_from`` the S from which on sticking would have
    been seen; ``rivals`` other causes that the data cannot exclude.
    """

    verdict: Suspicion
    reason: str
    advice: str
    score: float | None = None
    apparent_S: Estimate
    shows_from: float | None = None
    rivals: tuple[str, ...] = ()
