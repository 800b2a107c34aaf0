"""A run's batches on a Dask cluster: every item has its outcome, and a bad one costs itself."""

from __future__ import annotations

import threading
from pathlib import Path

from stemwatch.service.scheduler.cluster_pool import ClusterPool
from tests.service.clusters import dask_cluster


def double(items: list[int]) -> list[int]:
    """Twice each number; 3 is an error."""
    if 3 in items:
        raise ValueError("three is too much")
    return [2 * item for item in items]


def test_a_bad_item_costs_itself_only(tmp_path: Path) -> None:
    """A batch that fails is done again one by one; the item that fails again has the reason."""
    with dask_cluster(tmp_path, workers=2) as cluster:
        pool = ClusterPool(cluster.address)
        assert pool.workers == 2
        outcomes = list(pool.each(double, [[1, 2], [3, 4], [], [5]], threading.Event()))
        stopped = threading.Event()
        stopped.set()
        assert list(pool.each(double, [[1]], stopped)) == []
    assert {one.item: one.result for one in outcomes} == {1: 2, 2: 4, 3: None, 4: 8, 5: 10}
    assert [one.reason for one in outcomes if one.item == 3] == ["ValueError: three is too much"]
