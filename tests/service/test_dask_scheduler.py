"""A Dask scheduler that dies or hangs amid the work: no valve is blamed for it."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from stemwatch.service.executors import dask_cluster, outcomes
from stemwatch.service.executors.dask_cluster import ClusterError, DaskCluster
from stemwatch.service.executors.executor import Outcome
from tests.service import clusters
from tests.service.worker_jobs import squares_slowly

pytestmark = [
    pytest.mark.skipif(os.name == "nt", reason="signals are sent the POSIX way"),
    pytest.mark.early,
]


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[clusters.Cluster]:
    """A cluster of its own, whose scheduler may be lost."""
    with clusters.dask_cluster(tmp_path, workers=1) as created:
        yield created


def _amid_the_work(cluster: clusters.Cluster, folder: Path, number: int) -> list[Outcome[Any, int]]:
    """Send the scheduler a signal after the first results; all results that came until the end."""
    batches = [[(index, str(folder))] for index in range(400)]
    results = outcomes(
        DaskCluster(cluster.host_and_port), squares_slowly, batches, threading.Event()
    )
    came = list(next(results))
    os.kill(cluster.scheduler.pid, number)
    try:
        for more in results:
            came += more
    finally:
        assert all(item.result is not None for item in came), "a valve was blamed"
    return came


def test_a_scheduler_that_dies_is_the_cluster_s_fault(
    cluster: clusters.Cluster, tmp_path: Path
) -> None:
    """The error says what to do; what was done until then has its results, and nothing that was not
    done counts as failed: a run is put back and tried again."""
    with pytest.raises(ClusterError, match=r"let go of the work.*run the same command again"):
        _amid_the_work(cluster, tmp_path, signal.SIGKILL)


@pytest.mark.long
def test_a_scheduler_that_hangs_is_given_up(
    cluster: clusters.Cluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It keeps its connections and says nothing, as one does behind a network that is gone."""
    monkeypatch.setattr(dask_cluster, "ASK_S", 0.5)
    monkeypatch.setattr(dask_cluster, "SILENT_S", 3.0)
    started = time.monotonic()
    try:
        with pytest.raises(ClusterError, match=r"has not answered for 3 s"):
            _amid_the_work(cluster, tmp_path, signal.SIGSTOP)
    finally:
        os.kill(cluster.scheduler.pid, signal.SIGCONT)
    assert time.monotonic() - started < 120.0


@pytest.mark.long
def test_a_busy_scheduler_is_not_given_up(
    cluster: clusters.Cluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is asked again and again while the work takes longer than the time for an answer."""
    monkeypatch.setattr(dask_cluster, "ASK_S", 0.1)
    requested: list[float] = []
    check = dask_cluster._SchedulerWatch.check

    def noted(pulse: Any) -> None:
        requested.append(pulse._since_s)
        check(pulse)

    monkeypatch.setattr(dask_cluster._SchedulerWatch, "check", noted)
    batches = [[(index, str(tmp_path))] for index in range(20)]
    executor = DaskCluster(cluster.host_and_port)
    came = [
        item
        for each in outcomes(executor, squares_slowly, batches, threading.Event())
        for item in each
    ]
    assert sorted(item.result for item in came) == [index * index for index in range(20)]
    assert len(set(requested)) > 2, "it was asked more than once"
