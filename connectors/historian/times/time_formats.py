"""One grammar for the times that historians write: which part of the text is which field."""

from __future__ import annotations

import re

_MONTHS = (
    ("jan", "january", "januar", "jän", "jänner", "janv", "janvier", "ene", "enero", "gen",
     "gennaio"),
    ("feb", "february", "februar", "fév", "févr", "février", "fev", "fevr", "fevrier", "febrero",
     "febbraio"),
    ("mar", "march", "mär", "märz", "mrz", "mars", "marzo", "maerz"),
    ("apr", "april", "avr", "avril", "abr", "abril", "aprile"),
    ("may", "mai", "mayo", "mag", "maggio"),
    ("jun", "june", "juni", "juin", "junio", "giu", "giugno"),
    ("jul", "july", "juli", "juil", "juillet", "julio", "lug", "luglio"),
    ("aug", "august", "août", "aout", "aoû", "ago", "agosto"),
    ("sep", "sept", "september", "septembre", "septiembre", "set", "settembre"),
    ("oct", "october", "okt", "oktober", "octobre", "octubre", "ott", "ottobre"),
    ("nov", "november", "novembre", "noviembre"),
    ("dec", "december", "dez", "dezember", "déc", "décembre", "decembre", "dic", "diciembre",
     "dicembre"),
)  # fmt: skip
MONTH_NUMBER = {name: i for i, names in enumerate(_MONTHS, 1) for name in names}
AFTERNOON = frozenset(("pm", "p.m.", "오후", "下午", "午後"))
MORNING = frozenset(("am", "a.m.", "오전", "上午", "午前"))
ZONE_MINUTES = {"z": 0, "utc": 0, "gmt": 0, "cet": 60, "mez": 60, "cest": 120, "mesz": 120}

_LONGEST = 60  # characters; no time is written with more

_AMPM = r"(?:[AaPp]\.?[Mm]\.?|오전|오후|上午|下午|午前|午後)"
_DATE = r"""
(?: (?P<Y>[0-9]{4})(?P<sep>[-/.]|\.\ )(?P<m>[0-9]{1,2})(?P=sep)(?P<d>[0-9]{1,2})\.?
  | (?P<Yj>[0-9]{4})年(?P<mj>[0-9]{1,2})月(?P<dj>[0-9]{1,2})日
  | (?P<Yc>[0-9]{4})(?P<mc>[0-9]{2})(?P<dc>[0-9]{2})
  | (?P<a>[0-9]{1,2})(?P<nsep>[-/.])(?P<b>[0-9]{1,2})(?P=nsep)(?P<y>[0-9]{4}|[0-9]{2})
  | (?P<dn>[0-9]{1,2})\.?[-/\ .]\ ?(?P<mon>[^\W\d_]{3,10})\.?[-/\ .,]\ ?(?P<yn>[0-9]{4}|[0-9]{2})
  | (?P<mon2>[^\W\d_]{3,10})\.?[\ -](?P<dn2>[0-9]{1,2}),?[\ -](?P<yn2>[0-9]{4})
)"""
_CLOCK = rf"""
(?P<ap1>{_AMPM})?\s?
(?P<H>[0-9]{{1,2}}):(?P<M>[0-9]{{2}})(?::(?P<S>[0-9]{{2}})(?:[.,](?P<f>[0-9]{{1,9}}))?)?
(?:\s?(?P<ap2>{_AMPM}))?
(?:\s?(?P<zone>Z|z|[+-][0-9]{{2}}(?::?[0-9]{{2}})?|(?:UTC|GMT|CEST|CET|MESZ|MEZ)))?
"""
_COMPACT_CLOCK = r"(?P<Hc>[0-9]{2})(?P<Mc>[0-9]{2})(?P<Sc>[0-9]{2})(?P<zonec>Z)?"
_GLUED_CLOCK = _COMPACT_CLOCK.replace("c>", "d>")
_WHOLE = re.compile(
    rf"{_DATE}(?:(?:[Tt]|,?\s{{1,3}}|:)(?:{_CLOCK}|{_COMPACT_CLOCK})|{_GLUED_CLOCK})?",
    re.VERBOSE,
)
_CLOCK_ONLY = re.compile(_CLOCK, re.VERBOSE)


def match_time(text: str) -> re.Match[str] | None:
    """The parts of a date with or without a time of day, or ``None``."""
    text = text.strip().removeprefix("'")  # a spreadsheet's mark of a text
    match = _WHOLE.fullmatch(text) if len(text) <= _LONGEST else None
    if match is not None:
        name = match["mon"] or match["mon2"]
        if name and name.lower() not in MONTH_NUMBER:
            return None
    return match


def is_time(text: str) -> bool:
    """Whether ``text`` is a date, with or without a time of day; ``20240609`` alone is a number."""
    match = match_time(text)
    return match is not None and not text.strip().isdigit()


def is_date_only(text: str) -> bool:
    """A date without its time of day."""
    match = match_time(text)
    return match is not None and match["H"] is None and match["Hc"] is None and match["Hd"] is None


def is_clock_only(text: str) -> bool:
    """A time of day without its date."""
    return len(text) <= _LONGEST and _CLOCK_ONLY.fullmatch(text.strip()) is not None
