"""Work is chunked in order, without repetition, and in small chunks at the end."""

from __future__ import annotations

from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from stemwatch.service.run.batches import PER_WORKER, make_chunks


@given(st.integers(0, 3000), st.integers(1, 64), st.integers(1, 40))
def test_every_item_is_in_one_chunk_and_in_order(count: int, workers: int, most: int) -> None:
    """No chunk is empty or larger than allowed, and later ones are no larger than earlier ones."""
    dealt = make_chunks(range(count), workers, most)
    assert [piece for share in dealt for piece in share] == list(range(count))
    sizes = [len(share) for share in dealt]
    assert all(1 <= size <= most for size in sizes)
    assert sizes == sorted(sizes, reverse=True)


@given(st.integers(1, 3000), st.integers(1, 64))
def test_no_chunk_is_so_large_that_other_workers_idle(count: int, workers: int) -> None:
    """Each chunk is at most its part of the remaining items, rounded up, so that the last are
    single."""
    left = count
    for share in make_chunks(range(count), workers, 16):
        assert len(share) <= -(-left // (PER_WORKER * workers))
        left -= len(share)
    assert len(make_chunks(range(count), workers, 16)[-1]) == 1


def test_a_hundred_valves_on_two_workers_are_chunked_large_to_small() -> None:
    """Large chunks come first, since networks that train together train faster."""
    sizes = [len(share) for share in make_chunks(range(100), 2, 16)]
    assert sizes[:8] == [16, 14, 12, 10, 8, 7, 6, 5]
    assert sizes[-8:] == [2, 2, 1, 1, 1, 1, 1, 1]


@given(st.lists(st.integers(1, 30), max_size=30), st.integers(1, 8), st.integers(1, 20))
def test_tasks_of_one_file_go_to_one_worker(files: list[int], workers: int, most: int) -> None:
    """A chunk begins or ends within a file only where the file is too large for one chunk."""
    items = [(f"{file}.csv", valve) for file, valves in enumerate(files) for valve in range(valves)]
    dealt = make_chunks(items, workers, most, file_of=lambda item: item[0])
    assert [item for share in dealt for item in share] == items
    assert all(1 <= len(share) <= most for share in dealt)
    for share, following in pairwise(dealt):
        (file, _), (then, _) = share[-1], following[0]
        assert file != then or {name for name, _ in share} == {file}


def test_files_of_eight_valves_are_not_split() -> None:
    """Of 100 valves in files of eight, every chunk consists of whole files; single files at the
    end."""
    dealt = make_chunks(range(100), 2, 16, file_of=lambda valve: str(valve // 8))
    assert [len(share) for share in dealt] == [16, 16, 16, 16, 8, 8, 8, 8, 4]
