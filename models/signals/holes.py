"""Holes in a signal, for code that needs a value at every sample: bridged, held, or avoided."""

from __future__ import annotations

import numpy as np

from stemwatch.models.recording import Bools, Floats


def bridged(values: Floats, known: Bools) -> Floats:
    """(n,) ``values`` with straight lines across the samples that are not ``known`` (n,); the
    first and the last known value at the ends. Some sample must be known."""
    if known.all():
        return np.array(values, dtype=np.float64)
    samples = np.arange(values.size)
    return np.interp(samples, samples[known], values[known])


def held(values: Floats, known: Bools) -> Floats:
    """(n,) ``values`` with the last known one in place of those that are not ``known`` (n,), before
    the first one the first; zeros where none is known."""
    if not known.any():
        return np.zeros(values.size)
    last_known = np.maximum.accumulate(np.where(known, np.arange(values.size), -1))
    last_known[last_known < 0] = int(np.argmax(known))
    return np.ascontiguousarray(values[last_known])


def longest_stretch(known: Bools, most_bridged: int) -> tuple[int, int]:
    """First and last + 1 of the longest stretch of ``known`` samples (n,) in which no hole has more
    than ``most_bridged``; (0, 0) where none is known."""
    places = np.flatnonzero(known)
    if places.size == 0:
        return 0, 0
    breaks = np.flatnonzero(np.diff(places) > most_bridged + 1)
    begins = np.concatenate((places[:1], places[breaks + 1]))
    ends = np.concatenate((places[breaks], places[-1:])) + 1
    longest = int(np.argmax(ends - begins))
    return int(begins[longest]), int(ends[longest])
