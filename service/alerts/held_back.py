"""Which of a run's named effects stand, over all its valves: marked in the store, once.

Among many valves chance alone names something on a few (``presenter.false_discoveries``). What does
not stand is marked in the screening itself, so that rules, pages and reports agree about it.
"""

from __future__ import annotations

from collections.abc import Sequence

from stemwatch.models.false_discovery import significant
from stemwatch.service.presenter.false_discoveries import Discoveries
from stemwatch.service.store.screenings.false_discoveries import TestedScreening
from stemwatch.service.store.store import Store


def hold_back(store: Store, run_id: int) -> list[TestedScreening]:
    """Mark what ``run_id`` named and what does not stand among its valves; all that was tested.

    Doing it again changes nothing. Raises ``StoreError``.
    """
    found = store.tested_of_run(run_id)
    stood = significant([one.p_value for one in found])
    named = sum(one.named and stand for one, stand in zip(found, stood, strict=True))
    held = [
        one.screening for one, stand in zip(found, stood, strict=True) if one.named and not stand
    ]
    remark = Discoveries(standing=(), tested=len(found), named=named, held_back=len(held)).remark
    marks = {
        one.screening: remark if one.screening in set(held) else "" for one in found if one.named
    }
    store.note_held_back(run_id, marks)
    return found


def p_elsewhere(found: Sequence[TestedScreening], shown: Sequence[str]) -> tuple[float | None, ...]:
    """The p values of the valves that a report of ``shown`` leaves out."""
    there = set(shown)
    return tuple(one.p_value for one in found if one.valve not in there)
