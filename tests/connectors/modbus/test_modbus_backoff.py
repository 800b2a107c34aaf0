"""Waits between attempts: growing, bounded, different by chance, and short again after success."""

from __future__ import annotations

import random

from hypothesis import given
from hypothesis import strategies as st

from stemwatch.connectors.modbus.backoff import Backoff


@given(st.floats(0.01, 1.0), st.floats(2.0, 60.0), st.integers(0, 2**32), st.integers(1, 2000))
def test_waits_grow_up_to_a_limit(first_s, longest_s, seed, failures) -> None:
    """Each between half and the whole of the doubled one, never above the longest."""
    backoff = Backoff(first_s, longest_s, random.Random(seed))
    for index in range(failures):
        whole_s = min(longest_s, first_s * 2.0 ** min(index, 60))
        assert whole_s / 2 <= backoff.failed() <= whole_s
    assert backoff.failures == failures
    backoff.succeeded()
    assert backoff.failed() <= first_s


def test_two_clients_do_not_knock_together() -> None:
    """Random waits separate clients that lost their connection in the same outage."""
    waits = {Backoff(1.0, 15.0).failed() for _ in range(20)}
    assert len(waits) == 20
