"""The interface of the catalogue: one effect that the stiction model leaves out, one file in
``terms/``.

A term is neutral where all its coordinates are 0, so that every hypothesis contains S and J alone.
It acts on one of three things (``ActsOn``):

- ``ActsOn.COMMAND``: it shapes the command on its way to the force on the stem (``shape``),
- ``ActsOn.STEM``: it sets the kernel's numbers and tables of friction, force, stops and play
  (``fill``),
- ``ActsOn.READING``: it sets the kernel's numbers of the reading, zero and gain (``fill``).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol

from stemwatch.models.estimate import Estimate
from stemwatch.models.field_advice import FieldAdvice, FieldTest
from stemwatch.models.mismatch.stem_model.stem import Stem
from stemwatch.models.recording import Floats
from stemwatch.models.stickslip.kernel import Marks


class ActsOn(StrEnum):
    """Where in the chain a term acts."""

    COMMAND = "command"
    STEM = "stem"
    READING = "reading"


@dataclass(frozen=True, kw_only=True)
class Coordinate:
    """One search coordinate of a term, neutral at 0, with its plausible range."""

    name: str
    low: float
    high: float


@dataclass(frozen=True, kw_only=True)
class RecordingSummary:
    """The numbers of a recording by which a term chooses its ranges and decides whether its size is
    material.
    """

    interval_s: float
    duration_s: float
    unit_s: float  # seconds in the unit of all times here, see ``own_clock``
    op_low: float  # percent, 1st percentile
    op_high: float
    mv_low: float
    mv_high: float
    sigma: float  # noise of MV, percent
    S: float  # of the base fit, percent
    J: float

    @property
    def swing(self) -> float:
        """The range of OP, 1st to 99th percentile, percent."""
        return self.op_high - self.op_low


@dataclass(frozen=True, kw_only=True)
class Words:
    """What a maintenance engineer reads about a term, without jargon and slugs. This is their only
    place.
    """

    plain: str  # "The actuator or the I/P converter takes time to fill or vent"
    decide: str  # the test that separates it from similar terms
    advice: FieldAdvice  # what to check in which order, with which parts; codes for work orders
    # Why an ``inherent`` size needs no work, a clause after "is"; empty: the machine is made so.
    no_work: str = ""
    # Whether clocks, scan or calibration can make it without anything being wrong at the valve.
    of_record: bool = False

    @property
    def check(self) -> str:
        """What to look at in the field, in one paragraph."""
        return self.advice.check


class Term(Protocol):
    """One effect of the catalogue; a module-level ``TERM`` in ``terms/SLUG.py``."""

    slug: str
    acts_on: ActsOn
    order: int  # the order in the chain among the terms that act on the same thing
    contains: tuple[str, ...]  # slugs of simpler terms that are special cases of this one
    # Slugs of terms that do the same to every recording, but for the shape that is usual for each.
    alike: tuple[str, ...]
    # Whether it is one of the base's own numbers (zero, gain, sticking again), free in every
    # hypothesis: a finding where the base without it fits worse, and not looked for by adding it.
    in_base: bool
    # Whether the position may swing by it; a reading that is off, or wanders slowly, is no cause.
    may_swing: bool
    words: Words

    def coordinates(self, summary: RecordingSummary) -> tuple[Coordinate, ...]:
        """The coordinates (k,) with ranges that suit the recording."""
        ...

    def starts(self, summary: RecordingSummary) -> Floats:
        """(m, k) values from which a search begins; a grid over the plausible sizes."""
        ...

    def shape(
        self, command: Floats, marks: Marks, interval_s: float, values: Floats, out: Floats
    ) -> None:
        """COMMAND: write the shaped ``command`` (n,) to ``out`` (n,); restarts at START."""
        ...

    def fill(self, stem: Stem, values: Floats) -> None:
        """STEM: write the term into the stem's numbers and tables."""
        ...

    def material(self, values: Floats, summary: RecordingSummary) -> bool:
        """True where an effect of this size is worth a name."""
        ...

    def inherent(self, values: Floats, summary: RecordingSummary) -> bool:
        """True where an effect of this size is no defect: the machine is made so, or it lies within
        tolerance. It is named, and S and J are restated with it, but it needs no work.
        """
        ...

    def parameters(self, values: Floats) -> Mapping[str, tuple[float, str]]:
        """The coordinates in the terms of the field: name to (value, unit)."""
        ...

    def only_at_least(self, values: Floats) -> Mapping[str, str]:
        """The parameters of which ``values`` give a lower bound and no value, each with why."""
        ...

    def sentence(self, parameters: Mapping[str, Estimate], rising: str, falling: str) -> str:
        """One sentence with numbers; ``rising`` and ``falling`` are words for the directions
        ("opening" and "closing" where the flow tells them)."""
        ...

    def field_test(self, parameters: Mapping[str, Estimate]) -> FieldTest:
        """A test by hand that shows the effect, with what to expect from its ``parameters``, times
        in seconds, and from which result on there is nothing to mend."""
        ...
