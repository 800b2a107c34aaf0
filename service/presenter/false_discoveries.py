"""False-discovery control over the valves of a run: which effects stand, and the sentences about
it.

Among many valves, chance alone names effects on a few. Of the effects that stand, at most a share
of ``LEVEL`` is expected to be due to chance (``models.statistics.false_discovery``); the others are
held back.

Where a valve has a history, all its windows decide and not the newest alone: the p value of what
they confirm enters the run, whether or not the newest window names it, and an effect that only the
newest window names is held back.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeGuard

from stemwatch.models.mismatch.findings import Finding, Mismatch
from stemwatch.models.statistics.false_discovery import LEVEL, significant
from stemwatch.models.words import counted
from stemwatch.service.presenter.evidence_of_weeks import EvidenceOfWeeks

LEVEL_PERCENT = f"{100.0 * LEVEL:g} %"


@dataclass(frozen=True, kw_only=True)
class Discoveries:
    """What stands among all valves of a run.

    ``standing`` has one entry for each mismatch that was passed in: true where its effects stand,
    false where they are held back, ``None`` where nothing was named or is confirmed. ``confirmed``
    has beside each the slugs that stand because windows of weeks confirm them, ``None`` where the
    valve has no history that decides. ``tested``, ``named`` and ``held_back`` count valves of the
    whole run.
    """

    standing: tuple[bool | None, ...]
    tested: int
    named: int
    held_back: int
    confirmed: tuple[tuple[str, ...] | None, ...] = ()

    @property
    def sentence(self) -> str:
        """The whole run in one or two sentences; empty where no valve could be tested."""
        if not self.tested:
            return ""
        sentence = f"Hidden physics named on {self.named} of {counted(self.tested, 'valve')} tested"
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
            f"held back: across {counted(self.tested, 'valve')} chance alone may have named "
            f"{'them' if several else 'it'}."
        )

    def remark(self, by_window: EvidenceOfWeeks | None = None) -> str:
        """What stands beside a finding that is held back; ``by_window`` is the valve's history."""
        if by_window is not None and by_window.decides and not by_window.confirmed:
            return (
                "Held back: the windows of the last weeks do not confirm this. Plan no work on it "
                "alone; see whether the next recording names it again."
            )
        return (
            f"Held back: across {counted(self.tested, 'valve')} chance alone may have named this. "
            "Plan no work on it alone; see whether the next recording names it again."
        )


def discoveries(
    mismatches: Sequence[Mismatch | None],
    elsewhere: Sequence[float | None] = (),
    by_window: Sequence[EvidenceOfWeeks | None] | None = None,
) -> Discoveries:
    """Which effects of ``mismatches`` stand; one mismatch for each valve of a run.

    ``elsewhere`` has the p values of the run's other valves that were tested, ``by_window`` the
    history of each of these. A valve that was not fitted or not testable (``tested``) could not
    name anything and does not count. An effect without a p value, as an older version stored it, is
    held back.
    """
    histories = [None] * len(mismatches) if by_window is None else by_window
    p_values = [
        p_in_run(mismatch.p_value, defects=bool(mismatch.defects), by_window=history)
        for mismatch, history in zip(mismatches, histories, strict=True)
        if tested(mismatch)
    ]
    verdicts = iter(significant([*p_values, *elsewhere]))
    stands_of_each = tuple(
        _standing(mismatch, history, next(verdicts)) if tested(mismatch) else None
        for mismatch, history in zip(mismatches, histories, strict=True)
    )
    # The verdicts that are left are those of ``elsewhere``.
    others = [stood for stood, p in zip(verdicts, elsewhere, strict=True) if p is not None]
    outcomes = [outcome for outcome in stands_of_each if outcome is not None] + others
    return Discoveries(
        standing=stands_of_each,
        tested=len(p_values) + len(elsewhere),
        named=sum(outcomes),
        held_back=len(outcomes) - sum(outcomes),
        confirmed=tuple(
            confirmed_slugs(history, stands=stands is True)
            for history, stands in zip(histories, stands_of_each, strict=True)
        ),
    )


def p_in_run(
    newest: float | None, *, defects: bool, by_window: EvidenceOfWeeks | None
) -> float | None:
    """The p value with which a valve enters its run: that of the effects its windows confirm or,
    without a history that decides, of those that the ``newest`` window names. ``defects``: whether
    that window names any defect."""
    if by_window is None or not by_window.decides:
        return newest
    if by_window.confirmed:
        return by_window.p_value
    return None if defects else newest


def confirmed_slugs(by_window: EvidenceOfWeeks | None, *, stands: bool) -> tuple[str, ...] | None:
    """The slugs that a valve's windows confirm, where they stand in its run (``stands``); ``None``
    without a history that decides."""
    if by_window is None or not by_window.decides:
        return None
    return tuple(finding.slug for finding in by_window.confirmed) if stands else ()


def tested(mismatch: Mismatch | None) -> TypeGuard[Mismatch]:
    """True where the recording could have shown an effect, named or not."""
    return mismatch is not None and mismatch.finding is not Finding.NOT_TESTABLE


def _standing(mismatch: Mismatch, history: EvidenceOfWeeks | None, stood: bool) -> bool | None:
    confirmed = confirmed_slugs(history, stands=True)
    return stood if mismatch.effects or confirmed else None
