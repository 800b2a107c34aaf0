"""What workers do in tests of executors. Light, as each process that works imports it."""

from __future__ import annotations

import multiprocessing
import os
import signal
import time
from collections.abc import Sequence
from pathlib import Path


def square(number: int) -> int:
    """The square of a number."""
    return number * number


def square_or_die(number: int) -> int:
    """Dies in a worker where the number is 3, as a crash in a library would."""
    if number == 3 and multiprocessing.parent_process() is not None:
        os._exit(1)
    return number * number


def square_slowly(item: tuple[int, str]) -> int:
    """Leaves a file with the worker's number in a folder, waits, and squares."""
    number, folder = item
    (Path(folder) / f"{os.getpid()}-{number}").touch()
    time.sleep(0.1)
    return number * number


def squares_slowly(items: Sequence[tuple[int, str]]) -> list[int]:
    """``square_slowly`` of a batch."""
    return [square_slowly(item) for item in items]


def reciprocal(number: int) -> float:
    """One divided by a number."""
    return 1 / number


def note_and_wait(path: Path) -> None:
    """Leaves a file, so that a test can see what was begun."""
    path.touch()
    time.sleep(0.25)


def threads(_: int) -> list[str | None]:
    """How many threads the numbers of this process may use."""
    return [os.environ.get(name) for name in ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS")]


def double(items: Sequence[object]) -> list[int]:
    """Twice each number; some words do harm instead."""
    for item in items:
        if item == "hang":
            time.sleep(600)
        if item == "die":
            os.kill(os.getpid(), signal.SIGKILL)
        if item == "leave":
            os._exit(3)
        if item == "fail":
            raise ValueError("a reason to be shown")
        if isinstance(item, Path):
            item.touch()
    return [2 if isinstance(item, Path) else 2 * int(str(item)) for item in items]


class Unpicklable(Exception):
    """An error that cannot be told in another process."""

    def __init__(self, first: int, second: int) -> None:
        super().__init__(f"{first} and {second}")


def raise_unpicklable(items: Sequence[int]) -> list[int]:
    """Fails in a way that does not travel."""
    raise Unpicklable(items[0], 2)


def wait_long(items: Sequence[Path]) -> list[int]:
    """Leaves a file, and takes longer than any test."""
    items[0].touch()
    time.sleep(600)
    return [0]
