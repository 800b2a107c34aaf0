"""However a run is asked for and wherever it is done: the same rows, the same report."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import text

from stemwatch.service import __version__
from stemwatch.service.config import Plant, load_plant
from stemwatch.service.executors import Executor, InProcess, LocalProcesses
from stemwatch.service.run import batches
from stemwatch.service.run.engine import RunNow, screen_now
from stemwatch.service.run.plan import Request
from stemwatch.service.run.queue_worker import QueueWorker
from stemwatch.service.store.runs.queue import RunToQueue
from stemwatch.service.store.screenings.records import RunState
from stemwatch.service.store.store import Store, open_store
from tests.service.clusters import Cluster

Ask = Callable[[Plant, Store], Path]
TABLES = ("screenings", "indicators", "networks")
# Numbers given in the order in which results came, and what the clock said.
NOT_COMPARED = {"id", "screening_id", "seconds", "at", "created"}


@dataclass(frozen=True)
class Kept:
    """What a run left behind: rows of the store, objects of the report, files of the report."""

    rows: dict[str, list[dict[str, Any]]]
    valves: list[dict[str, Any]]
    files: list[str]


@pytest.fixture
def kept(small_plant: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Kept]:
    """Runs a schedule with one line in ``[service]``, in a folder of its own."""
    monkeypatch.setattr(batches, "PER_WORKER", 1)

    def work(service: str, ask: Ask) -> Kept:
        folder = tmp_path / str(len(list(tmp_path.iterdir())))
        folder.mkdir()
        file = folder / "plant.toml"
        schedule = '[[schedules]]\nname = "hourly"\nevery_s = 3600\n'
        export = (small_plant.parent / "export").as_posix()
        described = small_plant.read_text(encoding="utf-8").replace('"export/', f'"{export}/')
        file.write_text(f"[service]\n{service}\n{schedule}\n{described}", encoding="utf-8")
        loaded = load_plant(file, environment={})
        with open_store(loaded.storage) as store:
            report = ask(loaded, store)
            return Kept(
                rows={table: _rows(store, table) for table in TABLES},
                valves=_plain(json.loads((report / "valves.json").read_bytes())),
                files=sorted(path.name for path in report.iterdir()),
            )

    return work


def by_schedule(plant: Plant, store: Store) -> Path:
    """What a schedule asks for, done by the worker of the queue; the folder of its report."""
    store.schedules.take_from_file(plant.schedules)
    number = store.queue.put(RunToQueue(schedule="hourly"), software_version=__version__)
    assert number is not None
    assert QueueWorker(store, plant).once(threading.Event())
    process = store.run(number)
    assert (process.state, process.done, process.set_aside) == (RunState.DONE, 3, 0), process.reason
    return Path(process.report)


def by_command(executor: Executor) -> Ask:
    """What ``stemwatch screen --plant`` asks for."""

    def ask(plant: Plant, store: Store) -> Path:
        out = plant.beside("report")
        how = RunNow(store=store, executor=executor, out=out, limits=plant.limits)
        result = screen_now(Request(plant=plant), how)
        assert (result.not_read, result.not_saved) == ((), ())
        return out

    return ask


def _rows(store: Store, table: str) -> list[dict[str, Any]]:
    """The rows of a table that do not depend on the clock, in an order of their own."""
    with store.transactions.reading() as session:
        rows = session.execute(text(f"SELECT * FROM {table}")).mappings().all()
    return sorted((_plain(dict(row)) for row in rows), key=repr)


def _plain(result: Any) -> Any:
    """``found`` without what is not compared, at any depth; JSON in a column is looked into."""
    if isinstance(result, dict):
        return {k: _plain(v) for k, v in result.items() if k not in NOT_COMPARED}
    if isinstance(result, list):
        return [_plain(item) for item in result]
    if isinstance(result, str) and result.startswith(("{", "[")):
        return _plain(json.loads(result))
    return result


@pytest.mark.long
def test_a_cluster_keeps_the_same(kept, cluster: Cluster) -> None:
    """A schedule's run here and on a cluster."""
    near = kept("workers = 1", by_schedule)
    assert near == kept(f'executor = "{cluster.address}"', by_schedule)


def test_every_way_keeps_the_same(kept) -> None:
    """A schedule's run and the command line's run of the same plant, in one process and in several:
    screenings with their intervals, indicators, networks and the report's objects are the same
    number for number, though other networks trained together."""
    near = kept("workers = 1", by_schedule)
    assert near == kept("workers = 1", by_command(InProcess()))
    assert near == kept("workers = 1", by_command(LocalProcesses(2, isolated=True)))
    valves = ["FIC-104", "FIC-107", "FIC-113"]
    assert [screening["valve"] for screening in near.rows["screenings"]] == valves
    assert sorted(valve["valve"] for valve in near.valves) == valves
    assert {indicator["valve"] for indicator in near.rows["indicators"]} == set(valves)
    assert {network["valve"] for network in near.rows["networks"]} == {"FIC-104", "FIC-107"}
    assert {"report.html", "valves.csv", "valves.xlsx"} <= set(near.files)
