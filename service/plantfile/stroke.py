"""``Stroke``: the full travel of a valve in its own units, such as 40 mm or 90°."""

from __future__ import annotations

import re
from dataclasses import dataclass

EXPECTED = 'the full stroke with its unit, such as "40 mm", "1.5 in" or "90 deg"'
_FORM = re.compile(r"(\d+(?:[.,]\d+)?)\s*(mm|cm|in|inch|deg|degrees|°)", re.IGNORECASE)
_UNITS = {
    "mm": ("mm", 1.0),
    "cm": ("mm", 10.0),
    "in": ("in", 1.0),
    "inch": ("in", 1.0),
    "deg": ("°", 1.0),
    "degrees": ("°", 1.0),
    "°": ("°", 1.0),
}


@dataclass(frozen=True)
class Stroke:
    """``full`` travel from stop to stop in ``unit``: mm, in or ° (of a rotary valve)."""

    full: float
    unit: str

    def __str__(self) -> str:
        return f"{self.full:g}{self._gap}{self.unit}"

    def of_percent(self, percent: float) -> str:
        """``percent`` of the stroke in its own unit: 5 % of 40 mm is "2.0 mm"."""
        value = percent * self.full / 100.0
        digits = 3 if self.unit == "in" else 2 if abs(value) < 1.0 else 1
        return f"{value:.{digits}f}{self._gap}{self.unit}"

    @property
    def _gap(self) -> str:
        return "" if self.unit == "°" else " "


def parse_stroke(text: str) -> Stroke:
    """The stroke that ``text`` names. Raises ``ValueError`` with what was expected."""
    found = _FORM.fullmatch(text.strip())
    if found is None:
        raise ValueError(EXPECTED)
    unit, factor = _UNITS[found[2].lower()]
    full = float(found[1].replace(",", ".")) * factor
    if full <= 0.0:
        raise ValueError(f"{EXPECTED}, above 0")
    return Stroke(full, unit)
