"""Which of a run's effects stand when all its valves are looked at together, and how that is said.

Among many valves chance alone names something on a few. Of the effects that stand, at most
``LEVEL`` are expected to be due to chance (``models.false_discovery``); the others are held back.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeGuard

from stemwatch.models.false_discovery import LEVEL, significant
from stemwatch.models.mismatch.findings import Finding, Mismatch
from stemwatch.service.presenter.wording import valves_counted

LEVEL_PERCENT = f"{100.0 * LEVEL:g} %"


@dataclass(frozen=True, kw_only=True)
class Discoveries:
    """What stands among all valves of a run.

    ``standing`` has one entry for each mismatch that was asked about: true where its effects
    stand, false where they are held back, ``None`` where nothing was named. ``tested``, ``named``
    and ``held_back`` count valves of the whole run.
    """

    standing: tuple[bool | None, ...]
    tested: int
    named: int
    held_back: int

    @property
    def sentence(self) -> str:
        """The whole run in one or two sentences; empty where no valve could be tested."""
        if not self.tested:
            return ""
        sentence = f"Hidden physics named on {self.named} of {valves_counted(self.tested)} tested"
        if self.named:
            sentence += (
                f"; at most {LEVEL_PERCENT} of such findings are expected to be due to chance "
                "(Benjamini-Hochberg)"
            )
        if not self.held_back:
            return f"{sentence}."
        several = self.held_back > 1
        return (
            f"{sentence}. {self.held_back} "
            f"{'more ' if self.named else ''}{'are' if several else 'is'} "
            f"held back: across {valves_counted(self.tested)} chance alone may have named "
            f"{'them' if several else 'it'}."
        )

    @property
    def remark(self) -> str:
        """What stands beside a finding that is held back."""
        return (
            f"Held back: across {valves_counted(self.tested)} chance alone may have named this. "
            "Plan no work on it alone; see whether the next recording names it again."
        )


def discoveries(
    mismatches: Sequence[Mismatch | None], elsewhere: Sequence[float | None] = ()
) -> Discoveries:
    """What stands of ``mismatches``, one entry for each valve of a run.

    ``elsewhere`` has ``Mismatch.p_value`` of the run's other valves that were tested. A valve that
    was not fitted or not testable (``tested``) had no chance to name anything and does not count.
    An effect without a p value, as an older version stored it, is held back.
    """
    p_values = [mismatch.p_value for mismatch in mismatches if tested(mismatch)]
    verdicts = iter(significant([*p_values, *elsewhere]))
    stands_of_each = tuple(
        _named(mismatch, next(verdicts)) if tested(mismatch) else None for mismatch in mismatches
    )
    # The verdicts that are left are those of ``elsewhere``.
    others = [stood for stood, p in zip(verdicts, elsewhere, strict=True) if p is not None]
    outcomes = [outcome for outcome in stands_of_each if outcome is not None] + others
    return Discoveries(
        standing=stands_of_each,
        tested=len(p_values) + len(elsewhere),
        named=sum(outcomes),
        held_back=len(outcomes) - sum(outcomes),
    )


def tested(mismatch: Mismatch | None) -> TypeGuard[Mismatch]:
    """True where the recording could have shown an effect, named or not."""
    return mismatch is not None and mismatch.finding is not Finding.NOT_TESTABLE


def _named(mismatch: Mismatch, stood: bool) -> bool | None:
    return stood if mismatch.effects else None
