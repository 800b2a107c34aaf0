"""``ReadOptions``: what a user may say about a file; everything left out is decided from it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any, Literal, get_args

from stemwatch.connectors.settings import LONGEST_S, SHORTEST_S, known_encoding, known_zone

AmbiguousHour = Literal["infer", "first", "second"]
MissingHour = Literal["shift", "leave_out"]


@dataclass(frozen=True, kw_only=True)
class ReadOptions:
    """Every field is optional; ``None`` means "decide from the whole file and say so".

    Raises ``ValueError`` for an unknown zone, encoding or policy and a non-positive interval.
    """

    zone: str | None = None
    """IANA name of the zone of times without offset; without it dates stay unknown."""
    ambiguous_hour: AmbiguousHour = "infer"
    """The hour that autumn repeats: ``infer`` from the rows' order, or always ``first`` (summer
    time) or ``second`` (standard time)."""
    missing_hour: MissingHour = "shift"
    """The hour that spring skips: ``shift`` it forward by an hour, or ``leave_out`` its rows."""
    encoding: str | None = None
    """Python name of the file's encoding, such as ``cp1251``."""
    separator: str | None = None
    """The one character between cells."""
    decimal: Literal[".", ","] | None = None
    """The decimal mark of the numbers."""
    day_first: bool | None = None
    """True where ``01/02/2026`` is the first of February, False where it is the second of
    January."""
    time_format: str | None = None
    """``strptime`` format of the time column, such as ``%d.%m.%Y %H:%M:%S``."""
    time_column: str | None = None
    """Header of the time column."""
    tag_column: str | None = None
    """Narrow files: header of the column that names the tag."""
    value_column: str | None = None
    """Narrow files: header of the column that holds the value."""
    quality_column: str | None = None
    """Narrow files: header of the column that holds the quality code."""
    interval_s: float | None = None
    """Seconds between rows, for a file that has no time column, or one that only counts rows."""
    good_quality: tuple[str, ...] = ()
    """The quality codes that mean good, as they are written in the file."""

    def __post_init__(self) -> None:
        _check_policy("ambiguous_hour", self.ambiguous_hour, get_args(AmbiguousHour))
        _check_policy("missing_hour", self.missing_hour, get_args(MissingHour))
        _check_policy("decimal", self.decimal, (".", ",", None))
        if self.separator is not None and len(self.separator) != 1:
            raise ValueError(f"separator must be one character, received {self.separator!r}")
        if self.interval_s is not None and not SHORTEST_S <= self.interval_s <= LONGEST_S:
            raise ValueError(
                f"interval_s must be positive, {SHORTEST_S:g} to {LONGEST_S:g}, received "
                f"{self.interval_s}"
            )
        _check_known("zone", self.zone, known_zone)
        _check_known("encoding", self.encoding, known_encoding)


def given_options(options: ReadOptions) -> dict[str, Any]:
    """The options that the user gave, by name: those that differ from the defaults."""
    default = ReadOptions()
    named = {field.name: getattr(options, field.name) for field in fields(options)}
    return {name: value for name, value in named.items() if value != getattr(default, name)}


def _check_policy(name: str, value: object, allowed: tuple[object, ...]) -> None:
    if value not in allowed:
        raise ValueError(f"{name} must be one of {allowed}, received {value!r}")


def _check_known(name: str, value: str | None, known: Callable[[str], str]) -> None:
    if value is None:
        return
    try:
        known(value)
    except ValueError as error:
        raise ValueError(f"{name} {value!r} is not known; expected {error}") from None
