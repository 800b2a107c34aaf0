"""Work is dealt in order, nothing twice, and in small shares at the end."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from stemwatch.service.shares import PER_WORKER, shares


@given(st.integers(0, 3000), st.integers(1, 64), st.integers(1, 40))
def test_every_piece_is_dealt_once_and_in_order(count: int, workers: int, most: int) -> None:
    """No share is empty or larger than allowed, and later ones are no larger than earlier ones."""
    dealt = shares(range(count), workers, most)
    assert [piece for share in dealt for piece in share] == list(range(count))
    sizes = [len(share) for share in dealt]
    assert all(1 <= size <= most for size in sizes)
    assert sizes == sorted(sizes, reverse=True)


@given(st.integers(1, 3000), st.integers(1, 64))
def test_no_share_is_so_large_that_others_wait_for_it(count: int, workers: int) -> None:
    """Each share is at most its part of what was left, rounded up, so that the last are single."""
    left = count
    for share in shares(range(count), workers, 16):
        assert len(share) <= -(-left // (PER_WORKER * workers))
        left -= len(share)
    assert len(shares(range(count), workers, 16)[-1]) == 1


def test_a_hundred_valves_on_two_workers() -> None:
    """Large shares first: networks that train together train quicker."""
    sizes = [len(share) for share in shares(range(100), 2, 16)]
    assert sizes[:8] == [16, 14, 12, 10, 8, 7, 6, 5]
    assert sizes[-8:] == [2, 2, 1, 1, 1, 1, 1, 1]
