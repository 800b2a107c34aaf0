"""``OpenQuestion``: the models that a recording cannot separate, and what is needed to plan a test
that would.

It holds the models that explain the recording about equally well, with their fitted numbers, and
noise, scatter and sampling interval of the reading. It is small and is stored with the mismatch, so
that a test can be planned (``models/field_test``) without the samples.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from stemwatch.models.closed_loop.process_response import ProcessResponse
from stemwatch.models.stickslip.stroke_curve import StrokeCurve

# Effects that grow over a whole record: a test of minutes sees one moment of them.
SLOW = frozenset({"growing_stiction", "sensor_drift"})


@dataclass(frozen=True, kw_only=True)
class RivalModel:
    """One model that explains the recording about as well as its rivals.

    ``slug`` is the effect that separates it from the others, empty for S and J alone. ``base`` (6,)
    and ``terms`` are its coordinates on the own clock, of the fits to either half of the record
    (see ``crossfit``); the distance between the two fits is their uncertainty.
    """

    slug: str
    base: tuple[tuple[float, ...], ...]  # (2, 6)
    terms: Mapping[str, tuple[tuple[float, ...], ...]]  # (2, k) of each


@dataclass(frozen=True, kw_only=True)
class OpenQuestion:
    """Rival models of one valve; none or one where nothing is left to separate.

    Times in units of the own clock, ``unit_s`` seconds; ``sigma`` (noise of MV) and ``scatter`` (of
    the breakaway level) in percent. ``op`` is where OP was at the end of the recording, and
    ``op_low`` to ``op_high`` where it had been. ``duration`` is the record's length. ``published``
    is the model with the effects that were named, where any were: the expected result of a step
    test is simulated with it.
    """

    models: tuple[RivalModel, ...] = ()
    published: RivalModel | None = None
    unit_s: float = 1.0
    interval: float = 1.0
    duration: float = 0.0
    sigma: float = 0.1
    scatter: float = 0.1
    restick: float = 0.0
    op: float | None = None
    op_low: float | None = None
    op_high: float | None = None
    process: ProcessResponse | None = None
    curve: StrokeCurve | None = None  # where OP is not percent for percent of travel

    @property
    def rivals(self) -> tuple[str, ...]:
        """The effects that are left to be separated; empty for S and J alone."""
        return tuple(model.slug for model in self.models)

    @property
    def quick(self) -> tuple[RivalModel, ...]:
        """The rivals that a test of minutes may separate."""
        return tuple(model for model in self.models if model.slug not in SLOW)

    @property
    def slow(self) -> tuple[str, ...]:
        """The effects that only a longer time shows."""
        return tuple(slug for slug in self.rivals if slug in SLOW)
