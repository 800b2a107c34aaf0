"""How many processes work, and in which order they end, changes no number."""

from __future__ import annotations

import os
import signal
from collections.abc import Generator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from stemwatch.models.narx import training
from stemwatch.models.narx.example import NarxFit, NarxSettings
from stemwatch.models.narx.training_record import TrainingRecord
from stemwatch.models.screening_result import Screening
from stemwatch.service.executors import Executor, InProcess, LocalProcesses
from stemwatch.service.executors.dask_cluster import DaskCluster
from stemwatch.service.executors.executor import Answer
from stemwatch.service.report import to_contract
from stemwatch.service.run import batches
from stemwatch.service.run.engine import RunNow, screen_now
from stemwatch.service.run.plan import Request
from stemwatch.service.run.spill import ResultSpill
from stemwatch.service.store.store import open_store
from tests.service.clusters import Cluster

pytestmark = pytest.mark.early

ATTEMPTS = 6  # a worker may be done between the look at its stack and the signal


@dataclass(frozen=True)
class LastFirst:
    """Does the last item first, as a busy machine may."""

    workers: int = 1

    def hand_out(self, work, batches, stop, *, alone=False) -> Generator[Answer[Any]]:
        for place, batch in reversed(list(enumerate(batches))):
            yield Answer(index=place, results=work(batch))


@pytest.fixture
def result(small_plant: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Screens the small plant with an executor, in the fewest chunks that keep it busy."""
    monkeypatch.setattr(batches, "PER_WORKER", 1)
    export = small_plant.parent / "export" / "historian.csv"

    def screen(executor: Executor, name: str) -> tuple[list[Any], list[tuple[str, int, int]]]:
        answer: list[tuple[str, int, int]] = []

        def tell(screening: Screening, done: int, of: int) -> None:
            answer.append((screening.valve, done, of))

        with open_store(f"sqlite:///{tmp_path / name}.db") as store:
            how = RunNow(store=store, executor=executor, out=tmp_path / name)
            result = screen_now(Request(sources=(str(export),)), how, tell)
        assert [item.valve for item in result.brief] == [item.valve for item in result.screenings]
        assert isinstance(result.screenings, ResultSpill)
        plots = [result.screenings.evidence(index) for index in range(len(result.screenings))]
        return [(_without_timing(screening), plots) for screening in result.screenings], answer

    return screen


def _without_timing(screening: Screening) -> dict[str, Any]:
    """The result as JSON, without how long it took."""
    results = {k: v for k, v in to_contract(screening).items() if k != "seconds"}
    if results["mismatch"] is not None:
        results["mismatch"] = {k: v for k, v in results["mismatch"].items() if k != "seconds"}
    return results


@pytest.mark.long
def test_every_executor_finds_the_same(result, cluster: Cluster) -> None:
    """Every number, word, interval and plot is the same bit for bit, in this process, in two
    others and in a Dask cluster, though other networks train together."""
    alone, _ = result(InProcess(), "alone")
    together, answer = result(LocalProcesses(2), "together")
    far, _ = result(DaskCluster(cluster.host_and_port), "far")
    assert alone == together
    assert alone == far
    assert ["FIC-104", "FIC-107", "FIC-113"] == sorted(valve for valve, _, _ in answer)


@pytest.mark.long
def test_a_run_trains_the_networks_of_a_batch_together_on_a_gpu_that_is_there(
    result, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The engine hands out batches that are worth a GPU, and the valves that have a fit go to it
    in one piece. Where the GPU works is put in its place here; all before it is as in a plant."""
    trained: list[tuple[str, int]] = []

    def on_a_gpu(
        device: str, valves: Sequence[TrainingRecord], settings: NarxSettings
    ) -> list[NarxFit]:
        trained.append((device, len(valves)))
        return [NarxFit(valve=valve.example.valve, reason="no GPU here") for valve in valves]

    assert batches.CHUNK >= training.LEAST_ON_GPU
    monkeypatch.setattr("torch.cuda.is_available", lambda: True)
    monkeypatch.setattr(training, "LEAST_ON_GPU", 2)
    monkeypatch.setattr(training, "_train_on", on_a_gpu)
    result(InProcess(), "gpu")
    assert trained == [("cuda", 2)]


@pytest.mark.long
@pytest.mark.skipif(os.name == "nt", reason="signals are sent the POSIX way")
def test_a_worker_killed_while_it_screens_changes_no_number(
    result, cluster: Cluster, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A worker of the cluster that dies amid a batch costs time: every number, word, interval and
    plot of every valve is the same bit for bit as without workers, and each valve comes once."""
    alone, _ = result(InProcess(), "alone")
    monkeypatch.setattr(batches, "CHUNK", 1)
    for attempt in range(ATTEMPTS):
        screened = partial(result, DaskCluster(cluster.host_and_port), f"killed {attempt}")
        lost, (killed, answer) = cluster.kill_worker_amid("screen_tasks", screened)
        assert [worker.poll() for worker in cluster.workers].count(-signal.SIGKILL) == 1
        if lost:
            break  # the signal came before the worker was done
        cluster.have(2)
    assert lost, f"no worker was killed amid its work in {ATTEMPTS} attempts"
    assert killed == alone
    assert sorted(valve for valve, _, _ in answer) == ["FIC-104", "FIC-107", "FIC-113"]


def test_the_order_of_work_does_not_show(result, monkeypatch: pytest.MonkeyPatch) -> None:
    """Results stand in the sources' order however they come in; progress counts as they come."""
    monkeypatch.setattr(batches, "CHUNK", 1)
    forward, _ = result(InProcess(), "forward")
    backward, answer = result(LastFirst(), "backward")
    assert forward == backward
    assert [("FIC-113", 1, 3), ("FIC-107", 2, 3), ("FIC-104", 3, 3)] == answer
