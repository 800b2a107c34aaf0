"""Tasks divided among workers, so that all finish at nearly the same time and few files are parsed
twice.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

from stemwatch.service.run.task import Task

PER_WORKER = 3  # chunks per worker into which the remaining items are divided
T = TypeVar("T")
# The most valves that one worker takes at a time. Their networks train together, which is quicker;
# but every worker should get some, and progress should be visible.
CHUNK = 16
# From this many valves on, fitting takes far longer than parsing a file of up to this many bytes
# once more.
SPLIT_FROM_VALVES, SPLIT_UP_TO_BYTES = 8, 32 * 2**20


def make_batches(tasks: Sequence[Task], workers: int) -> list[tuple[Task, ...]]:
    """``tasks`` divided among ``workers``: valves of one file go to one worker, unless others would
    idle meanwhile."""
    keep_files_whole = not _worth_splitting(tasks, workers)
    file_of = (lambda task: task.text_file) if keep_files_whole else (lambda task: None)
    return make_chunks(tasks, workers, CHUNK, file_of)


def _worth_splitting(tasks: Sequence[Task], workers: int) -> bool:
    """Whether several workers should parse the same files: many valves in fewer files than there
    are workers, and files that are quick to parse and small enough for every worker's memory."""
    files = {task.text_file for task in tasks}
    if len(tasks) < SPLIT_FROM_VALVES or len(files) >= workers:
        return False
    try:
        return sum(Path(file).stat().st_size for file in files if file) <= SPLIT_UP_TO_BYTES
    except OSError:  # reported by the worker that reads the file
        return False


def make_chunks(
    items: Sequence[T],
    workers: int,
    largest: int,
    file_of: Callable[[T], str | None] = lambda _: None,
) -> list[tuple[T, ...]]:
    """``items`` in order, divided into chunks so that ``workers`` finish at nearly the same time.

    Each chunk has the number of remaining items divided by ``PER_WORKER * workers``, rounded up and
    at most ``largest``: guided self-scheduling (Polychronopoulos and Kuck, 1987). With equal chunks
    all but one worker could idle during the last one. ``file_of`` names the file that has to be
    parsed for an item, if any: neighbours of one file go to one worker where ``largest`` allows it.
    """
    files = [file_of(item) for item in items]
    chunks: list[tuple[T, ...]] = []
    begin = 0
    while begin < len(items):
        end = begin + min(largest, -(-(len(items) - begin) // (PER_WORKER * workers)))
        end = _between_files(files, begin, end, largest)
        chunks.append(tuple(items[begin:end]))
        begin = end
    return chunks


def _between_files(files: Sequence[str | None], begin: int, end: int, largest: int) -> int:
    """``end``, moved to the nearest boundary between two files: after it within ``largest`` items
    of ``begin``, else before it; unchanged where there is none."""

    def splits_file(index: int) -> bool:
        is_between = 0 < index < len(files) and files[index] is not None
        return is_between and files[index - 1] == files[index]

    after = next((p for p in range(end, begin + largest + 1) if not splits_file(p)), None)
    if after is not None:
        return min(after, len(files))
    return next((p for p in range(end - 1, begin, -1) if not splits_file(p)), end)
