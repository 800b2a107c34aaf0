"""``UnexplainedFall``: S of a valve fell and stays there, and nobody recorded work on it."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import date


@dataclass(frozen=True, kw_only=True)
class UnexplainedFall:
    """S fell from ``before`` to ``after``, percent of OP span, medians of the days on either side;
    ``on`` is the first day with the smaller one."""

    before: float
    after: float
    on: date

    @property
    def sentence(self) -> str:
        """What it means and asks for."""
        return (
            f"S fell from {self.before:.1f} to {self.after:.1f} % of OP span around "
            f"{self.on:%Y-%m-%d}, and no work is recorded: was this valve repaired? Record it as "
            "maintenance."
        )
