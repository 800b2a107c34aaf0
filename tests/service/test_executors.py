"""Executors: one contract for all of them, whatever happens to a worker.

The contract runs over every implementation, taken as a user names it. What only processes can do,
such as to survive a death, runs over those that have some.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from stemwatch.service.config import PlantFileError, load_plant
from stemwatch.service.executors import (
    Executor,
    ExecutorUnavailable,
    InProcess,
    LocalProcesses,
    UnknownExecutor,
    choose_executor,
    dask_cluster,
    map_items,
    outcomes,
)
from stemwatch.service.executors.dask_cluster import (
    WORKERS_DIED,
    ClusterError,
    DaskCluster,
    in_worker,
)
from tests.own_process import REPOSITORY
from tests.service import clusters
from tests.service.worker_jobs import (
    double,
    note_and_wait,
    raise_unpicklable,
    reciprocal,
    square,
    square_or_die,
    square_slowly,
    threads,
    wait_long,
)

pytestmark = pytest.mark.early

NAMES = ["in process", "local processes", "dask"]


@pytest.fixture(params=NAMES)
def executor(request: pytest.FixtureRequest) -> Executor:
    """Each executor in turn: what holds for one holds for all."""
    if request.param == "dask":
        return choose_executor(None, request.getfixturevalue("cluster").address)
    return InProcess() if request.param == "in process" else LocalProcesses(2)


def found_of(executor: Executor, batches, stop: threading.Event | None = None) -> dict:
    """The result and the reason of each item; every item comes once, at its own place."""
    items = [item for batch in batches for item in batch]
    matching = [
        item
        for outcome in outcomes(executor, double, batches, stop or threading.Event())
        for item in outcome
    ]
    assert all(items[item.index] == item.item for item in matching)
    assert len({item.index for item in matching}) == len(matching)
    return {item.item: (item.result, item.reason) for item in matching}


def test_every_item_of_a_batch_has_its_outcome(executor: Executor) -> None:
    """Results of all batches, whoever did them; nothing is done for no items."""
    result = found_of(executor, [[1, 2, 3], [4], [5, 6]])
    assert {item: result for item, (result, _) in result.items()} == {
        1: 2, 2: 4, 3: 6, 4: 8, 5: 10, 6: 12,
    }  # fmt: skip
    assert found_of(executor, []) == {}


def test_an_item_that_fails_costs_itself_only(executor: Executor) -> None:
    """Its batch is done again one by one; what fails again has the reason, and the rest results."""
    result = found_of(executor, [[1, "fail", 2], ["x"], [3]])
    assert {item: result for item, (result, _) in result.items() if result} == {1: 2, 2: 4, 3: 6}
    assert result["fail"] == (None, "ValueError: a reason to be shown")
    assert "invalid literal" in result["x"][1]


def test_an_error_that_cannot_travel_is_a_reason(executor: Executor) -> None:
    """The words come back all the same."""
    ((item,),) = outcomes(executor, raise_unpicklable, [[1]], threading.Event())
    assert item.reason == "Unpicklable: 1 and 2"


def test_who_is_told_to_stop_begins_nothing(executor: Executor, tmp_path: Path) -> None:
    """A stop that came before has no outcome and no work."""
    stop = threading.Event()
    stop.set()
    assert found_of(executor, [[tmp_path / "begun"], [1]], stop) == {}
    assert not (tmp_path / "begun").exists()


def test_what_does_harm_costs_itself_only() -> None:
    """In one batch with others: the others are done again alone, what ends its process again is
    given up with what happened to it, and the process that asks does none of it."""
    result = found_of(LocalProcesses(2, 30.0), [[1, "die", 2], [3, "leave"], ["fail", 4], [5]])
    assert {item: result for item, (result, _) in result.items() if result} == {
        1: 2, 2: 4, 3: 6, 4: 8, 5: 10,
    }  # fmt: skip
    assert "SIGKILL" in result["die"][1]
    assert "status 3" in result["leave"][1]
    assert "a reason to be shown" in result["fail"][1]


def test_an_isolated_executor_does_nothing_itself() -> None:
    """A single item that ends its process ends another than the one that asks."""
    result = found_of(LocalProcesses(1, 30.0, isolated=True), [["die"]])
    assert "SIGKILL" in result["die"][1]


def test_an_item_that_hangs_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its process is killed when its time is over, and the rest is finished."""
    monkeypatch.setattr("stemwatch.service.executors.local_processes._FIRST_S", 4.0)
    result = found_of(LocalProcesses(2, 1.0), [["hang", 1], [2]])
    assert result["hang"] == (None, "no result after 1 s")
    assert (result[1][0], result[2][0]) == (2, 4)


def test_stopping_ends_the_workers() -> None:
    """Asked to stop, it gives up what is being done and leaves no process behind."""
    stop = threading.Event()
    timer = threading.Timer(2.0, stop.set)
    timer.start()
    assert found_of(LocalProcesses(1, 600.0, isolated=True), [["hang"]], stop) == {}
    assert stop.is_set()
    timer.join()
    assert [item for item in multiprocessing.active_children() if item.name != "forkserver"] == []


@pytest.mark.long
@pytest.mark.skipif(sys.platform != "linux", reason="workers are forked from a server on Linux")
def test_a_dead_fork_server_is_renewed() -> None:
    """Killed between two runs, or while it is needed, it costs nothing."""
    from multiprocessing import forkserver

    assert found_of(LocalProcesses(2), [[1], [2]]) == {1: (2, ""), 2: (4, "")}
    server = forkserver._forkserver._forkserver_pid  # type: ignore[attr-defined]
    os.kill(server, signal.SIGKILL)
    assert found_of(LocalProcesses(2), [[3], [4]]) == {3: (6, ""), 4: (8, "")}


def test_a_worker_that_cannot_be_started_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    """After some trials the sentence says what to look for; nothing waits for ever."""
    monkeypatch.setattr("stemwatch.service.executors.local_processes._RETRY_S", 0.0)

    def refuse(*_: object) -> None:
        raise OSError(11, "Resource temporarily unavailable")

    monkeypatch.setattr("multiprocessing.process.BaseProcess.start", refuse)
    with pytest.raises(ExecutorUnavailable, match=r"ulimit -a"):
        found_of(LocalProcesses(2), [[1], [2]])


@contextmanager
def one_death_is_enough(cluster: clusters.Cluster) -> Iterator[None]:
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


@pytest.mark.long
@pytest.mark.skipif(os.name == "nt", reason="signals are sent the POSIX way")
def test_what_ends_workers_of_a_cluster_is_not_done_here(cluster: clusters.Cluster) -> None:
    """It is given up with its reason and never done in the process that asks; what a worker that
    died held beside it is done."""
    cluster.have(4)  # the item ends one in company and one alone
    with one_death_is_enough(cluster):
        result = found_of(DaskCluster(cluster.host_and_port), [[1, 2, "die"], [4, 5]])
    cluster.have(2)
    assert {item: result for item, (result, _) in result.items()} == {
        1: 2, 2: 4, "die": None, 4: 8, 5: 10,
    }  # fmt: skip
    assert result["die"][1] == WORKERS_DIED


@pytest.mark.long
def test_waiting_for_a_cluster_without_workers_can_be_stopped(
    cluster: clusters.Cluster, tmp_path: Path
) -> None:
    """Asked to stop when all its workers are gone, it ends without their answer."""
    stop, started = threading.Event(), tmp_path / "begun"

    def stop_once_begun() -> None:
        while not started.exists():
            time.sleep(0.02)
        cluster.have(0)
        stop.set()

    threading.Thread(target=stop_once_begun, daemon=True).start()
    executor = DaskCluster(cluster.host_and_port)
    assert list(outcomes(executor, wait_long, [[started]], stop)) == []
    assert stop.is_set()
    cluster.have(2)


@pytest.mark.parametrize("count", [0, 1, 7, 60])
def test_each_place_comes_once_with_its_result(executor: Executor, count: int) -> None:
    """However many items there are, each gives one result at its own place."""
    as_list = list(map_items(executor, square, range(count)))
    assert sorted(as_list) == [(index, index * index) for index in range(count)]


def test_items_may_come_from_a_generator(executor: Executor) -> None:
    """The items need not all be there before the first is worked on."""
    result = map_items(executor, square, (number for number in range(5)))
    assert sorted(result) == [(index, index * index) for index in range(5)]


def test_what_the_work_raises_comes_out(executor: Executor) -> None:
    """An error of the work itself is raised to the caller, not swallowed."""
    with pytest.raises(ZeroDivisionError):
        list(map_items(executor, reciprocal, [1, 0, 2]))


def test_an_executor_has_workers(executor: Executor) -> None:
    """Every executor says how many items it does at a time: here one or two."""
    assert executor.workers in (1, 2)


def test_a_dying_worker_costs_no_result() -> None:
    """What ends every worker is done by the process that asked, and nothing else is lost."""
    as_list = list(map_items(LocalProcesses(2), square_or_die, range(8)))
    assert sorted(as_list) == [(index, index * index) for index in range(8)]


@pytest.mark.skipif(os.name == "nt", reason="signals are sent the POSIX way")
@pytest.mark.parametrize("name", ["local processes", pytest.param("dask", marks=pytest.mark.long)])
def test_a_killed_worker_costs_time_only(name: str, tmp_path: Path, request) -> None:
    """A worker killed in the middle of its work: every result comes all the same, once."""
    items = [(number, str(tmp_path)) for number in range(24)]
    expected = [(index, index * index) for index in range(24)]
    if name == "local processes":
        assert _killing(LocalProcesses(2), items, tmp_path) == expected
        return
    cluster = request.getfixturevalue("cluster")
    assert _killing(DaskCluster(cluster.host_and_port), items, tmp_path) == expected
    assert [worker.poll() is not None for worker in cluster.workers].count(True) == 1


def _killing(executor: Executor, items: list[tuple[int, str]], seen: Path) -> list[tuple[int, int]]:
    """The sorted results of ``square_slowly``; the worker of the last note is killed on the way."""
    results = map_items(executor, square_slowly, items)
    matching = [next(results), next(results)]
    newest = max(seen.iterdir(), key=lambda path: path.stat().st_mtime_ns)
    os.kill(int(newest.name.split("-")[0]), signal.SIGKILL)
    return sorted([*matching, *results])


def test_workers_use_one_thread_each(cluster: clusters.Cluster) -> None:
    """Numbers in a worker use one thread, so that workers do not fight for cores."""
    for executor in (LocalProcesses(2), DaskCluster(cluster.host_and_port)):
        assert [["1", "1"]] * 2 == [result for _, result in map_items(executor, threads, range(2))]


@pytest.mark.parametrize("name", ["local processes", "dask"])
def test_what_was_not_begun_is_dropped(name: str, tmp_path: Path, request) -> None:
    """A caller that stops asking does not wait for all the rest."""
    dask = name == "dask"
    executor = choose_executor(2, request.getfixturevalue("cluster").address if dask else "local")
    items = [tmp_path / str(index) for index in range(60)]
    results = map_items(executor, note_and_wait, items)
    assert isinstance(results, Generator)
    next(results)
    results.close()
    assert 1 <= len(list(tmp_path.iterdir())) < 20


@pytest.mark.long
@pytest.mark.skipif(os.name == "nt", reason="signals are sent the POSIX way")
def test_ctrl_c_ends_the_workers(tmp_path: Path) -> None:
    """Ctrl-C while workers work ends them with the program, and what was not begun is not done."""
    program = (
        "import sys\n"
        "from pathlib import Path\n"
        f"sys.path.append({str(REPOSITORY)!r})\n"
        "from tests.service.worker_jobs import note_and_wait\n"
        "from stemwatch.service.executors import LocalProcesses, map_items\n"
        "if __name__ == '__main__':\n"
        "    items = [Path(sys.argv[1]) / str(place) for place in range(200)]\n"
        "    list(map_items(LocalProcesses(2), note_and_wait, items))\n"
    )
    script, seen = tmp_path / "program.py", tmp_path / "seen"
    script.write_text(program, encoding="utf-8")
    seen.mkdir()
    process = subprocess.Popen(
        [sys.executable, str(script), str(seen)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    while len(list(seen.iterdir())) < 2 and process.poll() is None:
        time.sleep(0.02)
    assert process.poll() is None
    os.killpg(process.pid, signal.SIGINT)
    process.wait(timeout=60)
    started = len(list(seen.iterdir()))
    assert started < 50
    with pytest.raises(ProcessLookupError):
        _wait_for_group_to_end(process.pid)


def _wait_for_group_to_end(group: int) -> None:
    """Raises ``ProcessLookupError`` once no process of the group is left."""
    for _ in range(500):
        os.killpg(group, 0)
        time.sleep(0.02)


def test_workers_are_chosen() -> None:
    """One worker works in this process; none given means one for each core."""
    assert InProcess() == choose_executor(1)
    assert InProcess() == choose_executor(4, "in-process")
    assert LocalProcesses(3) == choose_executor(3) == choose_executor(3, "local")
    cores = os.cpu_count() or 1
    assert choose_executor(None) == (LocalProcesses(cores) if cores > 1 else InProcess())
    assert choose_executor(None, "dask://10.0.0.5:8786") == DaskCluster("10.0.0.5:8786")
    assert choose_executor(None, "dask://[::1]:8786") == DaskCluster("[::1]:8786")


def test_an_executor_of_another_package_is_found_by_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stemwatch, one_valve: Path
) -> None:
    """A package with an entry point in ``stemwatch.executors`` is all it takes: the command line
    screens a valve with it."""
    (tmp_path / "tiny_executor.py").write_text(
        "from pathlib import Path\n"
        "from stemwatch.service.executors import InProcess\n"
        "class Tiny(InProcess):\n"
        "    def __init__(self, address):\n"
        "        super().__init__()\n"
        "        Path(__file__).with_name('asked').write_text(address)\n",
        encoding="utf-8",
    )
    about = tmp_path / "tiny_executor-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: tiny-executor\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text("[stemwatch.executors]\ntiny = tiny_executor:Tiny\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    out = tmp_path / "out"
    outcome = stemwatch("screen", one_valve, "--executor", "tiny://farm", "--out", out)
    assert outcome.status == 0, outcome.said
    assert (tmp_path / "asked").read_text() == "tiny://farm"
    assert (out / "report.html").is_file()
    outcome = stemwatch("screen", one_valve, "--executor", "tiny://farm", "--workers", 2)
    assert outcome.status == 2
    assert "tiny://farm has its own" in " ".join(outcome.said.replace("│", " ").split())
    with pytest.raises(UnknownExecutor, match=r"or tiny://"):
        choose_executor(None, "huge://farm")
    file = tmp_path / "plant.toml"
    file.write_text('[service]\nexecutor = "tiny://farm"\n', encoding="utf-8")
    assert load_plant(file, environment={}).service.executor == "tiny://farm"
    file.write_text('[service]\nexecutor = "huge://farm"\n', encoding="utf-8")
    with pytest.raises(PlantFileError, match=r"dask://HOST:PORT.*tiny://"):
        load_plant(file, environment={})


@pytest.mark.parametrize(
    "address", ["ray://here:1", "dask", "dask://", "dask://here", "dask://h:99999", "10.0.0.5:8786"]
)
def test_an_unknown_executor_is_refused(address: str) -> None:
    """What names no executor is refused with what was found and what was expected."""
    with pytest.raises(UnknownExecutor) as refused:
        choose_executor(2, address)
    assert repr(address) in str(refused.value)
    assert "expected local, in-process or dask://HOST:PORT" in str(refused.value)


def test_a_cluster_that_is_not_there_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where no scheduler answers, the error says so and what to start."""
    monkeypatch.setattr(dask_cluster, "CONNECT_S", 0.5)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with pytest.raises(ClusterError, match=r"no scheduler answers.*dask scheduler"):
        list(map_items(DaskCluster(f"127.0.0.1:{port}"), square, [1]))


def test_a_cluster_without_workers_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A scheduler without a worker is not waited for without end."""
    monkeypatch.setattr(dask_cluster, "WORKER_S", 0.3)
    with (
        clusters.dask_cluster(tmp_path, workers=0) as cluster,
        pytest.raises(ClusterError, match=r"no worker for 0\.3 s; start some with `dask worker"),
    ):
        list(map_items(DaskCluster(cluster.host_and_port), square, [1]))


def test_without_the_extra_the_error_names_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where Dask is not installed, the sentence says what to install."""
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ClusterError, match=r"pip install 'stemwatch\[cluster\]'"):
        list(map_items(DaskCluster("127.0.0.1:1"), square, [1]))


def test_a_worker_of_another_version_refuses() -> None:
    """Two versions need not give the same numbers, so a worker of another one does no work."""
    with pytest.raises(ClusterError, match=r"was asked by 0\.0\.0; install one version"):
        in_worker(double, [3], "0.0.0")
