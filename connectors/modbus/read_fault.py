"""``ReadFault``: why a request gave no words, with the reason that its samples carry."""

from __future__ import annotations

from enum import StrEnum


class FaultKind(StrEnum):
    """Kinds of fault, by what is to be done next."""

    NO_CONNECTION = "no connection"
    SILENT = "no answer"
    REFUSED = "refused"  # an exception reply
    NONSENSE = "nonsense"  # an invalid answer
    NOT_ASKED = "not asked"  # a late answer to an earlier request could be taken for this one's


EXCEPTIONS = {
    1: "illegal function",
    2: "illegal data address",
    3: "illegal data value",
    4: "device failure",
    5: "acknowledged, not yet done",
    6: "device busy",
    8: "memory parity error",
    10: "gateway path unavailable",
    11: "gateway target does not answer",
}
# The block may include an address that does not exist, or more than the device sends at once.
_SPLITTING = (2, 3)
# The gateway has already waited for this unit.
_SILENT_BEHIND_GATEWAY = (10, 11)


class ReadFault(Exception):
    """A request gave no words. ``reason`` is always the same for the same cause."""

    def __init__(self, kind: FaultKind, reason: str, code: int | None = None) -> None:
        self.kind, self.reason, self.code = kind, reason, code
        super().__init__(reason)

    @property
    def splits(self) -> bool:
        """Whether a smaller block might be answered."""
        return self.code in _SPLITTING

    @property
    def answer_may_come(self) -> bool:
        """Whether the answer may still be on its way."""
        return self.kind in (FaultKind.SILENT, FaultKind.NONSENSE)

    @property
    def unit_is_silent(self) -> bool:
        """Whether every further request to this unit would cost another wait."""
        return self.kind is FaultKind.SILENT or self.code in _SILENT_BEHIND_GATEWAY


def refused(code: int) -> ReadFault:
    """The fault of an exception reply with ``code``."""
    meaning = EXCEPTIONS.get(code, "an exception the protocol does not name")
    return ReadFault(FaultKind.REFUSED, f"exception {code} ({meaning})", code)


def silent(timeout_s: float) -> ReadFault:
    """The fault of no answer within ``timeout_s`` seconds."""
    return ReadFault(FaultKind.SILENT, f"no answer within {timeout_s:g} s")


def invalid_answer(description: str) -> ReadFault:
    """The fault of an invalid answer; ``description`` describes it."""
    return ReadFault(FaultKind.NONSENSE, f"nonsense: {description}")


def no_connection(reason: str) -> ReadFault:
    """The fault of no connection; ``reason`` is empty where the cause is not known."""
    return ReadFault(
        FaultKind.NO_CONNECTION, f"no connection: {reason}" if reason else "no connection"
    )


def not_asked(timeout_s: float) -> ReadFault:
    """The fault of a request that is not sent, because an earlier one timed out after ``timeout_s``
    seconds and its late answer would look like the answer to this one."""
    return ReadFault(
        FaultKind.NOT_ASKED,
        f"not asked: an answer that did not come within {timeout_s:g} s may still come, and could "
        "not be told from the answer to this request",
    )
