"""How work is dealt to workers: many pieces at a time at first, few at the end."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate, pairwise
from typing import TypeVar

PER_WORKER = 3  # shares of what is left for each worker

T = TypeVar("T")


def shares(items: Sequence[T], workers: int, most: int) -> list[tuple[T, ...]]:
    """``items`` in order, dealt so that ``workers`` end at nearly the same time.

    Each share is a part of what is left, one in ``PER_WORKER`` times ``workers``, and ``most`` at
    most: guided self-scheduling (Polychronopoulos and Kuck, 1987). Equal shares would leave all but
    one worker idle while the last one is done.
    """
    sizes, left = list[int](), len(items)
    while left > 0:
        sizes.append(min(most, -(-left // (PER_WORKER * workers))))
        left -= sizes[-1]
    ends = accumulate(sizes, initial=0)
    return [tuple(items[begin:end]) for begin, end in pairwise(ends)]
