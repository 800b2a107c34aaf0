"""Engineering units: found in headers, and one spelling for each."""

from __future__ import annotations

import re

SHARE_OF_SPAN = "0-1"
# Spelling in a file (lower case, no blanks) -> the spelling used everywhere after it.
_SPELLINGS = {
    "%": ("%", "pct", "percent", "prozent", "perc", "%open", "%span", "0-100%"),
    "gal/min": ("gpm", "gal/min", "usgpm"),
    "lb/min": ("lb/min", "lbs/min"),
    "lb/h": ("lb/h", "lb/hr", "lbs/hr", "pph"),
    "t/h": ("t/h", "tph", "t/hr"),
    "kg/h": ("kg/h", "kgph", "kg/hr"),
    "kg/s": ("kg/s",),
    "m³/h": ("m3/h", "m³/h", "m3/hr", "m^3/h", "cmh"),
    "Nm³/h": ("nm3/h", "nm³/h", "nm3/hr"),
    "l/min": ("l/min", "lpm"),
    "l/h": ("l/h", "lph"),
    "°C": ("°c", "degc", "deg.c", "celsius", "℃"),
    "°F": ("°f", "degf", "deg.f", "fahrenheit"),
    "K": ("k", "kelvin"),
    "Pa": ("pa",),
    "kPa": ("kpa",),
    "MPa": ("mpa",),
    "bar": ("bar", "barg", "bara", "bar(g)", "bar(a)"),
    "mbar": ("mbar",),
    "psi": ("psi", "psig", "psia"),
    "inH₂O": ("inh2o", "inwc", "in.h2o"),
    "mmH₂O": ("mmh2o",),
    "kg/cm²": ("kg/cm2", "kg/cm²", "kgf/cm2"),
    "m": ("m",),
    "mm": ("mm",),
    "cm": ("cm",),
    "rpm": ("rpm", "1/min"),
    "Hz": ("hz",),
    "V": ("v", "volt"),
    "mV": ("mv",),
    "A": ("a", "amp"),
    "mA": ("ma",),
    "W": ("w",),
    "kW": ("kw",),
    "MW": ("mw",),
    "s": ("s", "sec"),
    "ppm": ("ppm",),
    "pH": ("ph",),
    SHARE_OF_SPAN: ("0-1", "0..1", "0...1", "fraction", "frac"),
    "": ("noengunits", "none", "-", "unitless"),
}
_LONGEST = 300  # characters of a header; longer ones are damage
_CANONICAL = {s: unit for unit, spellings in _SPELLINGS.items() for s in spellings}
_BRACKETED = re.compile(r"^(?P<name>.*\S)\s*[\[(](?P<unit>[^\[\]()]{1,16})[\])]$")
_AFTER_FIELD = re.compile(r"^(?P<name>\S+\.(?:CV|ST|ACTUAL|TARGET))\s+(?P<unit>\S.*)$", re.I)
_SUFFIXED = re.compile(r"^(?P<name>.+)_(?P<unit>[A-Za-z%³²°]\S*)$")
# One or two letters after an underscore are more often part of the tag than a unit.
_SHORT_SUFFIXES = frozenset({"%"})


def canonical(unit: str) -> str:
    """One spelling of ``unit``: GPM and gal/min are the same; unknown units stay as they are."""
    text = unit.strip().strip("[]()").strip()
    return _CANONICAL.get(text.replace(" ", "").lower(), text)


def is_unit(text: str) -> bool:
    """Whether ``text`` is the spelling of a known unit, with or without brackets."""
    folded = text.strip().strip("[]()").replace(" ", "").lower()
    return folded in _CANONICAL


def split_unit(header: str) -> tuple[str, str]:
    """Tag without unit, and the unit (canonical, empty where the header has none).

    Three forms: ``FIC101.OP [%]``, ``FIC-400B/PID1/PV.CV gal/min``, ``LC74_20X_pct``.
    """
    header = header.strip()
    if len(header) > _LONGEST:
        return header, ""
    after_field = _AFTER_FIELD.match(header)
    if after_field:
        return after_field["name"], canonical(after_field["unit"])
    bracketed = _BRACKETED.match(header)
    if bracketed and (is_unit(bracketed["unit"]) or header.endswith("]")):
        return bracketed["name"], canonical(bracketed["unit"])
    suffixed = _SUFFIXED.match(header)
    if suffixed and is_unit(suffixed["unit"]):
        unit = suffixed["unit"]
        if len(unit) > 2 or unit in _SHORT_SUFFIXES:
            return suffixed["name"], canonical(unit)
    return header, ""


def bare_tag(header: str) -> str:
    """The part of a header that names the tag: a unit glued on with ``_`` belongs to the tag."""
    name = split_unit(header)[0]
    header = header.strip()
    return header if header.startswith(name + "_") else name
