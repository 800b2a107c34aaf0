"""Base classes for terms by what they act on, and words for their numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import floor, log10, nan

import numpy as np

from stemwatch.models.estimate import Estimate
from stemwatch.models.mismatch.stem_model.stem import Stem
from stemwatch.models.mismatch.term import ActsOn, RecordingSummary
from stemwatch.models.recording import Floats
from stemwatch.models.stickslip.kernel import Marks

SAID_IN_SECONDS = 0.1  # shorter times are said in ms
# From this error of the reading on, percent of travel, a calibration is worth a work order of its
# own. Positioners are set to within 0.5 to 1 % and a stroke check in five points passes at 2 %
# (*memory*); makers set their alarms at 2 to 5 %, as Samson 3730 its zero limit (EB 8389-1S: 5 %).
CALIBRATE_FROM_PERCENT = 2.0
CALIBRATE_LATER = (
    f"less than {CALIBRATE_FROM_PERCENT:g} % of travel, which a stroke check lets pass: no work of "
    "its own, correct it when the positioner is next calibrated"
)

MATERIAL_LAG_S = 0.7  # a slip that takes less is how good valves are
# Seconds from the first movement to 63 % of a step that specifications allow the largest valves,
# above DN 500 (EnTech 3.0, *memory*: T63 of 2.4 s less a dead time of 0.8 s; 0.4 s up to DN 150).
# No recording says how large its valve is.
LAG_AS_BUILT_S = 1.6
SLOW_AS_BUILT = (
    f"no longer than {LAG_AS_BUILT_S:g} s, which specifications allow a large valve: no work of "
    "its own, unless the valve is small or was quicker before"
)


LONGEST_LAG_S = 15.0  # that is tried
SAMPLES = 10.0  # of a slow record, over which a delay or lag is looked for at least
# Clocks on which the longest is counted in true seconds: a valve that takes some seconds takes many
# samples there. On quicker ones no search reaches that far.
QUICK_S = (0.5, 1.0)


def longest(summary: RecordingSummary, usual_s: float) -> float:
    """The longest delay or lag that is tried, in units of the own clock: ``usual_s`` of them, or as
    many true seconds where there are one or two samples a second.
    """
    in_units = usual_s / summary.unit_s if _is_quick(summary) else usual_s
    return max(in_units, SAMPLES * summary.interval_s)


def lags_from(summary: RecordingSummary, usual: Floats) -> Floats:
    """The ``usual`` starts (k, ...) of a lag, and longer ones where the clock is quick, each half
    as long again as the one before.
    """
    high, starts = longest(summary, LONGEST_LAG_S), usual
    while _is_quick(summary) and 1.5 * starts[-1].max() < high:
        starts = np.concatenate((starts, 1.5 * starts[-1:]))
    return starts


def _is_quick(summary: RecordingSummary) -> bool:
    return QUICK_S[0] <= summary.unit_s < QUICK_S[1]


class _Defect:
    """Most terms: an effect of a material size is something to mend, may make the position swing,
    and is none of the base's own numbers."""

    may_swing = True
    in_base = False

    def inherent(self, values: Floats, summary: RecordingSummary) -> bool:
        """Never how a machine is made."""
        return False

    def only_at_least(self, values: Floats) -> Mapping[str, str]:
        """None: each parameter has a value."""
        return {}


class CommandTerm(_Defect):
    """A term that shapes the command and leaves the stem alone."""

    acts_on = ActsOn.COMMAND
    contains: tuple[str, ...] = ()
    alike: tuple[str, ...] = ()

    def fill(self, stem: Stem, values: Floats) -> None:
        """Does nothing: the term acts on the command."""


class StemTerm(_Defect):
    """A term that changes the stem and leaves the command as it is."""

    acts_on = ActsOn.STEM
    contains: tuple[str, ...] = ()
    alike: tuple[str, ...] = ()

    def shape(
        self, command: Floats, marks: Marks, interval_s: float, values: Floats, out: Floats
    ) -> None:
        """Copies the command unchanged: the term acts on the stem."""
        out[:] = command


class OneNumberTerm(StemTerm):
    """A term whose one coordinate is the number ``fills`` of the stem."""

    fills: int

    def fill(self, stem: Stem, values: Floats) -> None:
        """The coordinate, as it is."""
        stem.numbers[self.fills] = values[0]


class ReadingTerm(StemTerm):
    """A term that is one of the reading's own numbers, which no position swings by."""

    acts_on = ActsOn.READING
    in_base = True
    may_swing = False


def either_sign(*sizes: float) -> Floats:
    """(2 m, 1) starts: every size rising and falling."""
    column = np.array(sizes)[:, None]
    return np.concatenate([-column, column])


def grid(*axes: tuple[float, ...] | Floats) -> Floats:
    """(m, k) starts: every combination of the values on k axes."""
    mesh = np.meshgrid(*axes, indexing="ij")
    return np.stack([axis.ravel() for axis in mesh], axis=1).astype(np.float64)


def number(estimate: Estimate) -> float:
    """The value, or NaN where there is none, so that no comparison holds."""
    return nan if estimate.value is None else estimate.value


def size(estimate: Estimate) -> Estimate:
    """The estimate without its sign; the direction is said in words.

    An interval that reaches across 0 begins at 0 then: the direction itself is in doubt.
    """
    if estimate.value is None or estimate.value >= 0.0:
        low = None if estimate.low is None else max(estimate.low, 0.0)
        return replace(estimate, low=low)
    low = None if estimate.high is None else max(-estimate.high, 0.0)
    high = None if estimate.low is None else -estimate.low
    return replace(estimate, value=-estimate.value, low=low, high=high)


def inverse(estimate: Estimate, numerator: float) -> Estimate:
    """The time to cover a distance, in seconds: ``numerator`` (percent) over a speed (%/s)."""

    def took(value: float | None) -> float | None:
        return None if value is None or value <= 0.0 else numerator / value

    return replace(
        estimate,
        value=took(estimate.value),
        low=took(estimate.high),
        high=took(estimate.low),
        unit="s",
    )


def about_value(estimate: Estimate, times: float = 1.0) -> str:
    """``times`` an estimate with two figures and its interval, for a test by hand:
    "7.0 s (6.6 to 7.5)"."""
    if estimate.value is None:
        return "an unknown size"
    factor, unit = times, estimate.unit
    if unit == "s" and estimate.value == 0.0:
        return "at once"
    if unit == "s" and abs(times * estimate.value) < SAID_IN_SECONDS:
        factor, unit = 1000.0 * times, "ms"
    value_text = f"{_figure(factor * estimate.value)} {unit}".rstrip()
    if estimate.low is None or estimate.high is None:
        return value_text
    return f"{value_text} ({_figure(factor * estimate.low)} to {_figure(factor * estimate.high)})"


def _figure(value: float) -> str:
    """Two figures without an exponent."""
    if value == 0.0:
        return "0"
    digits = max(0, 1 - floor(log10(abs(value))))
    return f"{value:.{digits}f}"
