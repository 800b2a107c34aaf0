"""The arguments of a call beside the data: signals, ranges, window, clock, reading options."""

from __future__ import annotations

import os
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any, TypedDict
from zoneinfo import ZoneInfo

import numpy as np
import numpy.typing as npt
import pandas as pd

from stemwatch.connectors.connector import TagMapping, Window
from stemwatch.connectors.historian import ReadOptions
from stemwatch.connectors.settings import nearest
from stemwatch.models.recording import PERCENT, Recording, Role
from stemwatch.models.words import listed

SignalInput = str | npt.ArrayLike
FilePath = str | os.PathLike[str]
OneValve = pd.DataFrame | Recording
EXPECTED = (
    "expected a pandas DataFrame, a Recording, the path of a file or folder, arrays as op= and mv= "
    "with interval_s=, or a list or dict of several"
)
_FRACTION = 1.0 + 1e-9  # the largest value that may be a fraction of 1, but for rounding
_MOST_NAMED = 12  # valves or tags of a message


class FileOptions(TypedDict, total=False):
    """Options for reading a file, where it should not be decided from its contents: see
    ``ReadOptions``."""

    ambiguous_hour: str
    missing_hour: str
    encoding: str
    separator: str
    decimal: str
    day_first: bool
    time_format: str
    time_column: str
    tag_column: str
    value_column: str
    quality_column: str
    good_quality: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class InputOptions:
    """The arguments of a call beside the data: signals, ranges, window, clock, reading options."""

    signals: Mapping[Role, SignalInput] = field(default_factory=dict)
    valve: str = ""
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    interval_s: float | None = None
    zone: str | None = None
    start: datetime | str | None = None
    stop: datetime | str | None = None
    options: Mapping[str, Any] = field(default_factory=dict)

    @property
    def tags(self) -> dict[Role, str]:
        """The signals given as names of columns or tags, by role."""
        return {role: signal for role, signal in self.signals.items() if isinstance(signal, str)}

    @property
    def arrays(self) -> dict[Role, npt.ArrayLike]:
        """The signals given as arrays, by role."""
        return {
            role: signal for role, signal in self.signals.items() if not isinstance(signal, str)
        }

    @property
    def window(self) -> Window:
        """The window; times without a zone are local times of ``zone``."""
        return Window(start=self._aware("start", self.start), stop=self._aware("stop", self.stop))

    def mapping(self, role: Role, tag: str, unit: str = "") -> TagMapping:
        """The tag of ``role`` with the engineering values at 0 % and 100 %."""
        low, high = self.ranges.get(role.value, (None, None))
        return TagMapping(tag=tag, unit=unit, low=low, high=high)

    def _aware(self, name: str, given: datetime | str | None) -> datetime | None:
        moment = _instant(name, given) if isinstance(given, str) else given
        if moment is None or moment.tzinfo is not None:
            return moment
        if self.zone is None:
            raise ValueError(
                f"{name}={moment} has no zone; hand over an aware time, such as "
                "datetime(2026, 3, 2, 6, tzinfo=UTC), or say zone='Europe/Berlin'"
            )
        return moment.replace(tzinfo=ZoneInfo(self.zone))


def _instant(name: str, text: str) -> datetime:
    try:
        return datetime.fromisoformat(text)
    except ValueError:
        raise ValueError(
            f"{name}={text!r} is no time; expected ISO text such as '2026-03-02 06:00', or a "
            "datetime"
        ) from None


def checked_options(
    signals: Mapping[str, SignalInput | None],
    valve: str,
    interval_s: float | None,
    zone: str | None,
    ranges: Mapping[str, tuple[float, float]] | None,
    start: datetime | str | None,
    stop: datetime | str | None,
    options: Mapping[str, Any],
) -> InputOptions:
    """The arguments after a check. Raises ``ValueError`` where they contradict one another."""
    signal_of_role = {Role(name): signal for name, signal in signals.items() if signal is not None}
    if signal_of_role and Role.OP not in signal_of_role:
        raise ValueError(
            f"{', '.join(role.value for role in signal_of_role)} given without op; say op=, the "
            "column or the samples of the controller output"
        )
    for name, pair in (ranges or {}).items():
        if name not in signals:
            raise ValueError(f"ranges: {name!r} is no signal; expected some of {list(signals)}")
        if len(tuple(pair)) != 2:
            raise ValueError(
                f"ranges[{name!r}] is {pair!r}; expected the values at 0 % and at 100 %, such as "
                "(4, 20) for mA or (0, 1) for a fraction"
            )
    return InputOptions(
        signals=signal_of_role,
        valve=valve,
        ranges=dict(ranges or {}),
        interval_s=interval_s,
        zone=zone,
        start=start,
        stop=stop,
        options=options,
    )


def read_options(inputs: InputOptions) -> ReadOptions:
    """The reading options. Raises ``TypeError`` for one that does not exist."""
    option_names = set(FileOptions.__annotations__)
    for name in inputs.options:
        if name not in option_names:
            suggestion = nearest(name, option_names)
            raise TypeError(
                f"{name!r} is no option of reading{suggestion}; expected {sorted(option_names)}"
            )
    return ReadOptions(zone=inputs.zone, interval_s=inputs.interval_s, **inputs.options)


def warned_of_fraction(recording: Recording, inputs: InputOptions) -> Recording:
    """Warn where OP or MV looks like a fraction of 1; without ``ranges`` nothing is converted."""
    for role in (Role.OP, Role.MV):
        signal = recording.get(role)
        if signal is None or signal.unit != PERCENT or role.value in inputs.ranges:
            continue
        values = signal.values[np.isfinite(signal.values)]
        if values.size and 0.0 <= values.min() and values.max() <= _FRACTION and np.ptp(values):
            warnings.warn(
                f"{recording.valve}: {signal.tag} runs from {values.min():.3g} to "
                f"{values.max():.3g} and was taken as percent of span; if it is a fraction, say "
                f"ranges={{{role.value!r}: (0, 1)}}, if it is percent, (0, 100)",
                UserWarning,
                stacklevel=5,  # the caller of ``read``, or of ``screen`` for one valve
            )
    return recording


def name_list(names: Sequence[str]) -> str:
    """The first of ``names``, and how many more there are; "none" where there are none."""
    return listed([repr(name) for name in names], _MOST_NAMED) or "none"


def described(value: object) -> str:
    """What somebody handed over: its type, and its shape where it has one."""
    kind = type(value)
    name = kind.__name__ if kind.__module__ == "builtins" else f"{kind.__module__}.{kind.__name__}"
    shape = getattr(value, "shape", None)
    article = "an" if name[0] in "aeiou" else "a"
    return f"{article} {name}" + (f" of shape {shape}" if isinstance(shape, tuple) else "")
