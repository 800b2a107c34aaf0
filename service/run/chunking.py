"""How work is dealt to workers: many pieces at a time at first, few at the end."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

PER_WORKER = 3  # shares of what is left for each worker

T = TypeVar("T")


def make_chunks(
    items: Sequence[T],
    workers: int,
    most: int,
    parsed: Callable[[T], str | None] = lambda _: None,
) -> list[tuple[T, ...]]:
    """``items`` in order, dealt so that ``workers`` end at nearly the same time.

    Each share is a part of what is left, one in ``PER_WORKER`` times ``workers``, and ``most`` at
    most: guided self-scheduling (Polychronopoulos and Kuck, 1987). Equal shares would leave all but
    one worker idle while the last one is done. ``parsed`` names what has to be parsed as a whole
    for an item, if anything: neighbours of one name go to one worker where ``most`` allows it.
    """
    names = [parsed(item) for item in items]
    dealt: list[tuple[T, ...]] = []
    begin = 0
    while begin < len(items):
        end = begin + min(most, -(-(len(items) - begin) // (PER_WORKER * workers)))
        end = _where_parting_is_cheap(names, begin, end, most)
        dealt.append(tuple(items[begin:end]))
        begin = end
    return dealt


def _where_parting_is_cheap(names: Sequence[str | None], begin: int, end: int, most: int) -> int:
    """``end``, or the nearest end of what is parsed as a whole: after it within ``most``, else
    before it; ``end`` itself where all of it is one."""

    def parts(place: int) -> bool:
        inside = 0 < place < len(names) and names[place] is not None
        return inside and names[place - 1] == names[place]

    after = next((p for p in range(end, begin + most + 1) if not parts(p)), None)
    if after is not None:
        return min(after, len(names))
    return next((p for p in range(end - 1, begin, -1) if not parts(p)), end)
