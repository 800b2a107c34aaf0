"""Workers that hang, die or fail cost their own item and nothing else."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Sequence

from stemwatch.service.scheduler.workers import WorkerPool


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
    return [2 * int(str(item)) for item in items]


def outcomes(pool: WorkerPool, batches) -> dict[object, tuple[object, str]]:
    found = pool.each(double, batches, threading.Event())
    return {one.item: (one.result, one.reason) for one in found}


def test_every_item_comes_back() -> None:
    """Results of all batches, whatever worker did them; nothing is done for no items."""
    found = outcomes(WorkerPool(2, 30.0), [[1, 2, 3], [4], [], [5, 6]])
    assert {item: result for item, (result, _) in found.items()} == {
        1: 2, 2: 4, 3: 6, 4: 8, 5: 10, 6: 12,
    }  # fmt: skip
    assert outcomes(WorkerPool(2, 30.0), []) == {}


def test_a_bad_item_costs_only_itself() -> None:
    """In one batch with others: the others are done again alone, the bad one is given up with what
    happened to it."""
    found = outcomes(WorkerPool(2, 30.0), [[1, "die", 2], [3, "leave"], ["fail", 4], [5]])
    assert {item: result for item, (result, _) in found.items() if result} == {
        1: 2, 2: 4, 3: 6, 4: 8, 5: 10,
    }  # fmt: skip
    assert "SIGKILL" in found["die"][1]
    assert "status 3" in found["leave"][1]
    assert "a reason to be shown" in found["fail"][1]


def test_an_item_that_hangs_is_given_up(monkeypatch) -> None:
    """Its process is killed when its time is over, and the rest is finished."""
    monkeypatch.setattr("stemwatch.service.scheduler.workers._STARTING_S", 8.0)
    found = outcomes(WorkerPool(2, 1.0), [["hang", 1], [2]])
    assert found["hang"] == (None, "no result after 1 s")
    assert (found[1][0], found[2][0]) == (2, 4)


def test_stopping_ends_the_workers() -> None:
    """Asked to stop, the pool gives up what is being done and leaves no process behind."""
    stop = threading.Event()
    threading.Timer(2.0, stop.set).start()
    pool = WorkerPool(1, 600.0)
    begun = threading.active_count()
    assert list(pool.each(double, [["hang"]], stop)) == []
    assert stop.is_set()
    assert threading.active_count() <= begun
