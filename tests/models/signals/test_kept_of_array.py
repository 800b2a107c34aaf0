"""A figure of a signal's samples is computed once, and never one of other samples."""

from __future__ import annotations

import gc

import numpy as np

from stemwatch.models.signals.kept_of_array import kept_of_array, those_of


def counted():
    """The sum of an array, and the arrays that it was really computed of."""
    calls = []

    @kept_of_array
    def total(values):
        calls.append(values.size)
        return float(values.sum())

    return total, calls


def read_only(values) -> np.ndarray:
    array = np.array(values, dtype=np.float64)
    array.flags.writeable = False
    return array


def test_it_is_computed_once_for_samples_that_cannot_change():
    """Each array has its own figure."""
    total, calls = counted()
    first, second = read_only([1.0, 2.0]), read_only([5.0])
    assert [total(first), total(second), total(first), total(second)] == [3.0, 5.0, 3.0, 5.0]
    assert calls == [2, 1]


def test_what_may_change_is_computed_anew():
    """An array that can be written to, and a view of it that cannot."""
    total, calls = counted()
    array = np.ones(3)
    view = array[:]
    view.flags.writeable = False
    assert (total(array), total(view)) == (3.0, 3.0)
    array[0] = 5.0
    assert (total(array), total(view)) == (7.0, 7.0)
    assert len(calls) == 4


def test_an_array_in_the_place_of_one_that_is_gone_is_not_taken_for_it():
    """Memory is used again; the figure goes with its array."""
    total, calls = counted()
    for number in range(50):
        assert total(read_only([float(number), 1.0])) == number + 1.0
        gc.collect(0)
    assert len(calls) == 50


def test_what_is_kept_of_a_signal_is_found_again_where_all_of_it_is_chosen():
    """A part of it is another array, with a figure of its own."""
    total, calls = counted()
    values, all_of_them = read_only([1.0, 2.0, 4.0]), np.ones(3, dtype=bool)
    assert total(values) == total(those_of(values, all_of_them)) == 7.0
    assert calls == [3]
    assert total(those_of(values, np.array([True, False, True]))) == 5.0
