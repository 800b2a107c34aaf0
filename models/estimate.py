"""An estimated number with its interval, or the reason why there is none."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """A value with a 95 % interval, or ``None`` with a reason.

    Exactly one of ``value`` and ``reason`` is set: a fit that cannot conclude is a result with a
    sentence, never a number that looks like one.
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

    def __str__(self) -> str:
        if self.value is None:
            return f"not known: {self.reason}"
        text = f"{self.value:.3g}"
        if self.low is not None and self.high is not None:
            text += f" ({self.low:.3g} to {self.high:.3g})"
        return f"{text} {self.unit}".rstrip()
