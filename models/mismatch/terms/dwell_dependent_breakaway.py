"""Breakaway that depends on dwell: ``fs += b ln(1 + rest/t0)``, t0 = 5 s. Neutral: ``b = 0``.

``b`` in percent of span per e-fold of the rest.

Signature: slips after long holds come late, the later the longer the rest.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from math import log

import numpy as np

from stemwatch.models.compiled import compiled
from stemwatch.models.estimate import Estimate
from stemwatch.models.field_advice import STICKING_PACKING, FieldAdvice, FieldTest, check_steps
from stemwatch.models.mismatch.stem_model import stem as stem_number
from stemwatch.models.mismatch.stem_model.stem import Stem
from stemwatch.models.mismatch.term import Coordinate, RecordingSummary, Term, Words
from stemwatch.models.mismatch.terms._common import StemTerm, about_value
from stemwatch.models.recording import Floats

T0_S = 5.0  # seconds; a convention of the formula, which b is stated with
# After ten minutes at rest the breakaway is higher by 4.8 b: by half a percent of span.
MATERIAL_PERCENT = 0.1


@compiled()
def add_scaled(shape: Floats, factor: float, table: Floats) -> None:
    """Add ``factor`` times ``shape`` (n,) to ``table`` (n,) without a temporary."""
    for i in range(table.size):
        table[i] += factor * shape[i]


@lru_cache(maxsize=8)
def _growth(samples: int, interval_s: float) -> Floats:
    """(samples,) ``ln(1 + rest/t0)`` over the samples rested; read only."""
    rest_s = np.arange(samples, dtype=np.float64) * interval_s
    table: Floats = np.log1p(rest_s / T0_S)
    table.flags.writeable = False
    return table


class DwellDependentBreakaway(StemTerm):
    """A breakaway that rises with rest: one coordinate, ``b`` in percent per e-fold."""

    slug = "dwell_dependent_breakaway"
    order = 20
    words = Words(
        plain="the longer the stem has rested, the harder it is to start",
        decide=(
            "Hold OP for 10 s, 1 min and 10 min, three times each, then ramp it slowly: a "
            "breakaway that rises with the hold is dwell, one that varies as much within each "
            "hold is scatter."
        ),
        advice=FieldAdvice(
            title="sticks after a long rest",
            steps=check_steps(
                (
                    "desk: Ask whether product sets or crystallises on the stem, and whether "
                    "tracing or purge is on."
                ),
                (
                    "manual: Hold OP for 10 s, 1 min and 10 min, then ramp it slowly; note "
                    "where the stem lets go."
                ),
                (
                    "manual: Lubricate where there is a fitting. A small regular movement keeps "
                    "it free meanwhile."
                ),
                (
                    "line: Renew packing and soft parts; clean the stem; consider another "
                    "packing material."
                ),
            ),
            parts=(
                "packing set of another material",
                "lubricant that suits the packing",
                "soft seals and seat",
            ),
            **STICKING_PACKING,
        ),
    )

    def coordinates(self, summary: RecordingSummary) -> tuple[Coordinate, ...]:
        """Rise of the breakaway per e-fold of rest."""
        return (Coordinate(name="b_percent", low=0.0, high=2.0),)

    def starts(self, summary: RecordingSummary) -> Floats:
        """From what scatter hides upwards."""
        return np.array([[0.1], [0.2], [0.35], [0.6], [1.0]])

    def fill(self, stem: Stem, values: Floats) -> None:
        """The rise onto the table of breakaway."""
        if values[0] != 0.0:
            table = stem.breakaway
            add_scaled(_growth(table.size, stem.interval_s), float(values[0]), table)
            stem.numbers[stem_number.BY_REST] = 1.0

    def material(self, values: Floats, summary: RecordingSummary) -> bool:
        """Half a percent of span after ten minutes of rest."""
        return bool(values[0] >= MATERIAL_PERCENT)

    def parameters(self, values: Floats) -> Mapping[str, tuple[float, str]]:
        """Percent of span per e-fold of rest (each 2.7 times longer)."""
        return {"b": (float(values[0]), "%")}

    def sentence(self, parameters: Mapping[str, Estimate], rising: str, falling: str) -> str:
        return (
            "The longer the stem has rested, the harder it is to start: the breakaway rises by "
            f"{parameters['b']} of span each time the rest is 2.7 times longer."
        )

    def field_test(self, parameters: Mapping[str, Estimate]) -> FieldTest:
        tenfold = log(10.0)
        return FieldTest(
            do=(
                "Loop in manual: let the stem rest 1 minute, step OP by 0.1 % one way and count "
                "the "
                "steps until it moves; the same after 10 minutes."
            ),
            fails=f"about {about_value(parameters['b'], tenfold)} more after the long rest",
            passes=f"no more than {tenfold * MATERIAL_PERCENT:.1f} % more",
        )


TERM: Term = DwellDependentBreakaway()
