"""Settings of a source in the plant file: its ``[[sources]]`` table as a pydantic model, the
messages for mistakes in it, and how a value is written there.

Each field's description is what an error says was expected.
"""

from __future__ import annotations

import difflib
import json
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Annotated
from zoneinfo import ZoneInfo, available_timezones

from pydantic import AfterValidator, BaseModel, ConfigDict, Field
from pydantic_core import PydanticCustomError

CONTRADICTION = "contradiction"  # the type of such an error

KeyPath = tuple[str | int, ...]  # from the top of a file, or of a table, to a key


@dataclass(frozen=True, kw_only=True)
class Problem:
    """One mistake: where it stands, what was found there and what was expected."""

    file: str
    line: int | None  # None where no line can be named: the file itself is not there
    key: str  # valves[FIC-101].tags.op.low, or the column of a valve list
    found: str
    expected: str

    def __str__(self) -> str:
        line = "" if self.line is None else f", line {self.line}"
        return f"{self.file}{line}: {self.key}: found {self.found}; expected {self.expected}"


def contradiction(key: tuple[str, ...], found: str, expected: str) -> PydanticCustomError:
    """To be raised by a validator; ``key`` is where to look, from the table that is checked."""
    context = {"key": key, "found": found, "expected": expected}
    return PydanticCustomError(CONTRADICTION, "found {found}; expected {expected}", context)


def nearest(word: str, known_names: Iterable[str]) -> str:
    """``" (did you mean 'zone'?)"``, or nothing where no known word comes close."""
    by_lower = {name.lower(): name for name in sorted(known_names)}
    close = difflib.get_close_matches(word.lower(), by_lower, n=1, cutoff=0.6)
    return f" (did you mean {by_lower[close[0]]!r}?)" if close else ""


def either_of(known_names: Iterable[str]) -> str:
    """``"one of area, id, source"``."""
    return "one of " + ", ".join(sorted(known_names))


def toml_value(value: object) -> str:
    """A text, number, truth value or list as TOML, which is written as in JSON but for U+007F."""
    json_value = list(value) if isinstance(value, tuple) else value
    return json.dumps(json_value, ensure_ascii=False).replace("\x7f", "\\u007f")


class TomlTable(BaseModel):
    """A TOML table: no unknown keys, no silent conversion of one type into another."""

    model_config = ConfigDict(
        extra="forbid",
        strict=True,
        frozen=True,
        allow_inf_nan=False,
        str_strip_whitespace=True,
        validate_default=False,
    )


def known_zone(zone: str) -> str:
    """``zone`` as it is. Raises ``ValueError``, which says what is expected, for an unknown one."""
    try:
        ZoneInfo(zone)
    except (KeyError, ValueError, OSError):
        # EST comes close to CEST and is six hours away: places alone are proposed.
        places = (name for name in available_timezones() if "/" in name)
        raise ValueError(
            "an IANA time zone such as Europe/Berlin" + nearest(zone, places)
        ) from None
    return zone


def known_encoding(encoding: str) -> str:
    """``encoding`` as it is. Raises ``ValueError``, which says what is expected, for an unknown one
    and for a codec that is not one of text, such as ``hex``."""
    try:
        "a".encode(encoding)
    except (LookupError, ValueError):
        raise ValueError("an encoding that Python knows, such as utf-8 or cp1252") from None
    return encoding


def _one_line(text: str) -> str:
    if not text.isprintable():
        raise ValueError("text without line breaks and control characters")
    return text


Text = Annotated[str, AfterValidator(_one_line)]
Name = Annotated[Text, Field(min_length=1, max_length=200)]
Zone = Annotated[str, AfterValidator(known_zone)]
Encoding = Annotated[str, AfterValidator(known_encoding)]
Positive = Annotated[float, Field(gt=0)]
# Ten years at most: what is subtracted from a time must not lead out of the calendar.
LONGEST_S = 10 * 366 * 86_400.0
SHORTEST_S = 1e-9  # in which times are counted
Duration = Annotated[float, Field(gt=0, le=LONGEST_S)]
Interval = Annotated[float, Field(ge=SHORTEST_S, le=LONGEST_S)]
NotEmpty = Annotated[str, Field(min_length=1)]


class SourceSettings(TomlTable):
    """Keys that the ``[[sources]]`` tables of every kind have."""

    name: Name = Field(description="a name of its own for the source, as text of 1 to 200 letters")
