"""A run's batches on a Dask cluster: every item has its outcome, and a bad one costs itself."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from stemwatch.service.scheduler.cluster_pool import DEADLY, ClusterPool
from tests.service.clusters import Cluster


def double(items: list[int]) -> list[int]:
    """Twice each number; 3 is an error."""
    if 3 in items:
        raise ValueError("three is too much")
    return [2 * item for item in items]


def double_or_die(items: list[tuple[int, int]]) -> list[int]:
    """Twice each number; 3 kills its process, unless that is the one that asks."""
    for number, asking in items:
        if number == 3 and os.getpid() != asking:
            os.kill(os.getpid(), signal.SIGKILL)
    return [2 * number for number, _ in items]


def wait_long(items: list[Path]) -> list[int]:
    """Leaves a file, and takes longer than any test."""
    items[0].touch()
    time.sleep(600)
    return [0]


@contextmanager
def one_death_is_enough(cluster: Cluster) -> Iterator[None]:
    """The scheduler gives up what one worker died on, instead of four."""

    def allow(dask_scheduler, deaths: int) -> int:
        before, dask_scheduler.allowed_failures = dask_scheduler.allowed_failures, deaths
        return before

    with cluster.client() as client:
        before = client.run_on_scheduler(allow, deaths=0)
        try:
            yield
        finally:
            client.run_on_scheduler(allow, deaths=before)


def test_a_bad_item_costs_itself_only(cluster: Cluster) -> None:
    """A batch that fails is done again one by one; the item that fails again has the reason."""
    pool = ClusterPool(cluster.address)
    assert pool.workers == 2
    outcomes = list(pool.each(double, [[1, 2], [3, 4], [], [5]], threading.Event()))
    stopped = threading.Event()
    stopped.set()
    assert list(pool.each(double, [[1]], stopped)) == []
    assert {one.item: one.result for one in outcomes} == {1: 2, 2: 4, 3: None, 4: 8, 5: 10}
    assert [one.reason for one in outcomes if one.item == 3] == ["ValueError: three is too much"]


@pytest.mark.skipif(os.name == "nt", reason="signals are sent the POSIX way")
def test_an_item_that_ends_workers_is_not_done_by_the_service(cluster: Cluster) -> None:
    """It is given up with its reason and never done in the process that asks; what a worker that
    died held beside it is done."""
    cluster.have(3)
    items = [(number, os.getpid()) for number in range(1, 6)]
    with one_death_is_enough(cluster):
        pool = ClusterPool(cluster.address)
        outcomes = list(pool.each(double_or_die, [items[:3], items[3:]], threading.Event()))
    assert {one.item[0]: one.result for one in outcomes} == {1: 2, 2: 4, 3: None, 4: 8, 5: 10}
    assert [one.reason for one in outcomes if one.reason] == [DEADLY]


def test_a_pool_that_waits_for_the_cluster_can_be_stopped(cluster: Cluster, tmp_path: Path) -> None:
    """Asked to stop when all its workers are gone, it ends without their answer."""
    stop, begun = threading.Event(), tmp_path / "begun"

    def stop_once_begun() -> None:
        while not begun.exists():
            time.sleep(0.02)
        cluster.have(0)
        stop.set()

    threading.Thread(target=stop_once_begun, daemon=True).start()
    assert list(ClusterPool(cluster.address).each(wait_long, [[begun]], stop)) == []
    assert stop.is_set()
