"""An estimated number with its interval, or the reason why there is none."""

from __future__ import annotations

from dataclasses import dataclass, replace

NORMAL_95 = 1.959964  # standard deviations either way that hold 95 % of a normal distribution


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """A value with a 95 % interval, or ``None`` with a reason.

    Exactly one of ``value`` and ``reason`` is set: a fit that cannot conclude is a result with a
    sentence, never a number that looks like one. Where only a bound is known there is no value,
    ``low`` is the bound, and the reason says why no value is known.
    """

    value: float | None = None
    low: float | None = None
    high: float | None = None
    unit: str = ""
    reason: str | None = None

    def __post_init__(self) -> None:
        if (self.value is None) == (self.reason is None):
            raise ValueError(
                f"an Estimate has either a value or a reason; received value={self.value!r}, "
                f"reason={self.reason!r}"
            )
        if self.low is not None and self.high is not None and self.low > self.high:
            raise ValueError(f"expected low <= high, received {self.low} > {self.high}")

    @classmethod
    def unknown(cls, reason: str, unit: str = "") -> Estimate:
        """No number, because ``reason``."""
        return cls(reason=reason, unit=unit)

    @property
    def with_interval(self) -> tuple[float, float, float] | None:
        """Value, low and high, where all three are known."""
        if self.value is None or self.low is None or self.high is None:
            return None
        return self.value, self.low, self.high

    @property
    def at_least(self) -> float | None:
        """The lower bound, where only that is known; else ``None``."""
        return self.low if self.value is None else None

    def holding(self, *others: Estimate) -> Estimate:
        """The same value, with an interval that holds those of ``others`` too."""
        lows = [estimate.low for estimate in (self, *others) if estimate.low is not None]
        highs = [estimate.high for estimate in (self, *others) if estimate.high is not None]
        return replace(self, low=min(lows, default=None), high=max(highs, default=None))

    def contradicts(self, other: Estimate) -> bool:
        """Whether the intervals of two estimates of one number do not overlap."""
        if self.low is None or self.high is None or other.low is None or other.high is None:
            return False
        return max(self.low, other.low) > min(self.high, other.high)

    def __str__(self) -> str:
        if self.value is None and self.low is not None:
            return f"at least {self.low:{_digits(self.low)}} {self.unit}: {self.reason}"
        if self.value is None:
            return f"not known: {self.reason}"
        if self.low is None or self.high is None:
            return f"{self.value:.3g} {self.unit}".rstrip()
        digits = _digits(max(self.value, self.low, self.high, key=abs))
        ends = f"{self.low:{digits}} to {self.high:{digits}}"
        return f"{self.value:{digits}} ({ends}) {self.unit}".rstrip()


def _digits(value: float) -> str:
    """Three significant digits of ``value``, the largest of a number and its ends, and as many
    decimals of all three: 5.23 (4.70 to 5.95), 0.008 (0.000 to 0.201). Where all are very large or
    very small, three digits each."""
    size = abs(value)
    if not 0.1 <= size < 1e5:
        return ".3g"
    return f".{3 if size < 1.0 else 2 if size < 10.0 else 1 if size < 100.0 else 0}f"
