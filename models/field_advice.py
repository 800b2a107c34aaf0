"""Advice on one kind of finding: steps from the cheapest to the dearest, parts, codes.

Each term of the mismatch catalogue has its own; the other kinds of finding are in a data file of
the service. The advice is general: the plant's own rules come first.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import TypedDict


class IsolationLevel(IntEnum):
    """How far the valve must be taken out of service for a step, from not at all to isolated."""

    DESK = 0  # control room and office
    LOOK = 1  # at the valve, in service
    MANUAL = 2  # loop in manual
    AIR = 3  # supply shut and vented
    LINE = 4  # isolated and depressurised


@dataclass(frozen=True)
class CheckStep:
    """One thing to check or do."""

    level: IsolationLevel
    text: str


class FailureCodes(TypedDict):
    """Failure mode and mechanism by ISO 14224, and the part that is suspected first."""

    damage: str
    cause: str
    part: str


# FTR: fails to regulate, DOP: delayed operation, AIR: abnormal instrument reading.
STICKING_PACKING = FailureCodes(damage="FTR", cause="1.6", part="packing")
FORCE_ON_ACTUATOR = FailureCodes(damage="FTR", cause="1.0", part="actuator")
SLOW_POSITIONER = FailureCodes(damage="DOP", cause="5.1", part="positioner")
WEAK_AIR = FailureCodes(damage="DOP", cause="5.1", part="air supply")
TRANSMITTER_SETTING = FailureCodes(damage="AIR", cause="3.4", part="position transmitter")


@dataclass(frozen=True, kw_only=True)
class FieldAdvice:
    """Advice to maintenance on one kind of finding.

    ``title`` has at most 30 letters; ``damage`` and ``cause`` are codes of ISO 14224 (failure mode,
    failure mechanism); ``part`` is the object part that is suspected first, ``parts`` what to have
    at hand; ``otherwise`` names other causes that look similar, a sentence each.
    """

    title: str
    steps: tuple[CheckStep, ...]
    parts: tuple[str, ...]
    damage: str
    cause: str
    part: str
    otherwise: tuple[str, ...] = ()

    @property
    def check(self) -> str:
        """All steps in their order, as one paragraph."""
        return " ".join(step.text for step in self.steps)


@dataclass(frozen=True, kw_only=True)
class FieldTest:
    """One test by hand: what to ``do``, what it shows where the finding is right (``fails``) and
    where nothing needs repair (``passes``), both clauses with numbers.
    """

    do: str
    fails: str
    passes: str


def check_steps(*texts: str) -> tuple[CheckStep, ...]:
    """Steps written as ``"look: Read the gauge."``: a level of ``IsolationLevel``, then the words.

    Raises ``ValueError`` where a text does not begin with a level.
    """
    return tuple(_step(text) for text in texts)


def _step(text: str) -> CheckStep:
    level, colon, level_text = text.partition(": ")
    if not colon or level.upper() not in IsolationLevel.__members__:
        known_levels = ", ".join(key.lower() for key in IsolationLevel.__members__)
        raise ValueError(
            f"{text!r}: a step begins with how far one must go ({known_levels}) and a colon"
        )
    return CheckStep(IsolationLevel[level.upper()], level_text)
