"""``kept_of_array``: a figure of a signal's samples that many checks ask for, computed once."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import TypeVar
from weakref import ref

from stemwatch.models.recording import Bools, Floats

T = TypeVar("T")


def kept_of_array(function: Callable[[Floats], T]) -> Callable[[Floats], T]:
    """``function`` of an array (n,), computed once while the array lives.

    Only for arrays that cannot change, as those of a ``Signal``: read-only, with samples of their
    own. Of any other it is computed at each call.
    """
    known: dict[int, tuple[ref[Floats], T]] = {}

    @wraps(function)
    def once(values: Floats) -> T:
        if values.flags.writeable or not values.flags.owndata:
            return function(values)
        key = id(values)  # of another array as soon as this one is gone, and then it is not known
        if key not in known:
            known[key] = ref(values, lambda _: known.pop(key, None)), function(values)
        return known[key][1]

    return once


def those_of(values: Floats, which: Bools) -> Floats:
    """``values[which]``; where that is all of them, ``values`` (n,) itself, not to be written to,
    of which the figures that were kept are found again."""
    return values if which.all() else values[which]
