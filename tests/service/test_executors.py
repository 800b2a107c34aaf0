"""Executors: the same results wherever the work is done, and whatever happens to a worker."""

from __future__ import annotations

import multiprocessing
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Generator
from pathlib import Path

import pytest

from stemwatch.service.executors import (
    Executor,
    InProcess,
    LocalProcesses,
    UnknownExecutor,
    choose_executor,
    dask_cluster,
)
from stemwatch.service.executors.dask_cluster import ClusterError, DaskCluster, in_worker
from tests.service import clusters

NAMES = ["in process", "local processes", "dask"]


@pytest.fixture(params=NAMES)
def executor(request: pytest.FixtureRequest) -> Executor:
    """Each executor in turn: what holds for one holds for all."""
    if request.param == "dask":
        return choose_executor(None, request.getfixturevalue("cluster").address)
    return InProcess() if request.param == "in process" else LocalProcesses(2)


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


@pytest.mark.parametrize("count", [0, 1, 7, 60])
def test_each_place_comes_once_with_its_result(executor: Executor, count: int) -> None:
    """However many items there are, each gives one result at its own place."""
    found = list(executor.map(square, range(count)))
    assert sorted(found) == [(place, place * place) for place in range(count)]


def test_items_may_come_from_a_generator(executor: Executor) -> None:
    """The items need not all be there before the first is worked on."""
    found = executor.map(square, (number for number in range(5)))
    assert sorted(found) == [(place, place * place) for place in range(5)]


def test_what_the_work_raises_comes_out(executor: Executor) -> None:
    """An error of the work itself is raised to the caller, not swallowed."""
    with pytest.raises(ZeroDivisionError):
        list(executor.map(reciprocal, [1, 0, 2]))


def test_an_executor_has_workers(executor: Executor) -> None:
    """Every executor says how many items it does at a time: here one or two."""
    assert executor.workers in (1, 2)


def test_a_dying_worker_costs_no_result() -> None:
    """What ends every worker is done by the process that asked, and nothing else is lost."""
    found = list(LocalProcesses(2).map(square_or_die, range(8)))
    assert sorted(found) == [(place, place * place) for place in range(8)]


@pytest.mark.skipif(os.name == "nt", reason="signals are sent the POSIX way")
@pytest.mark.parametrize("name", ["local processes", "dask"])
def test_a_killed_worker_costs_time_only(name: str, tmp_path: Path, request) -> None:
    """A worker killed in the middle of its work: every result comes all the same, once."""
    items = [(number, str(tmp_path)) for number in range(24)]
    expected = [(place, place * place) for place in range(24)]
    if name == "local processes":
        assert _killing(LocalProcesses(2), items, tmp_path) == expected
        return
    cluster = request.getfixturevalue("cluster")
    assert _killing(DaskCluster(cluster.host_and_port), items, tmp_path) == expected
    assert [worker.poll() is not None for worker in cluster.workers].count(True) == 1


def _killing(executor: Executor, items: list[tuple[int, str]], seen: Path) -> list[tuple[int, int]]:
    """The sorted results of ``square_slowly``; the worker of the last note is killed on the way."""
    results = executor.map(square_slowly, items)
    found = [next(results), next(results)]
    newest = max(seen.iterdir(), key=lambda path: path.stat().st_mtime_ns)
    os.kill(int(newest.name.split("-")[0]), signal.SIGKILL)
    return sorted([*found, *results])


def test_workers_use_one_thread_each(cluster: clusters.Cluster) -> None:
    """Numbers in a worker use one thread, so that workers do not fight for cores."""
    for executor in (LocalProcesses(2), DaskCluster(cluster.host_and_port)):
        assert [["1", "1"]] * 2 == [result for _, result in executor.map(threads, range(2))]


@pytest.mark.parametrize("name", ["local processes", "dask"])
def test_what_was_not_begun_is_dropped(name: str, tmp_path: Path, request) -> None:
    """A caller that stops asking does not wait for all the rest."""
    dask = name == "dask"
    executor = choose_executor(2, request.getfixturevalue("cluster").address if dask else "local")
    items = [tmp_path / str(place) for place in range(60)]
    results = executor.map(note_and_wait, items)
    assert isinstance(results, Generator)
    next(results)
    results.close()
    assert 1 <= len(list(tmp_path.iterdir())) < 20


@pytest.mark.skipif(os.name == "nt", reason="signals are sent the POSIX way")
def test_ctrl_c_ends_the_workers(tmp_path: Path) -> None:
    """Ctrl-C while workers work ends them with the program, and what was not begun is not done."""
    program = (
        "import sys\n"
        "from pathlib import Path\n"
        f"sys.path.insert(0, {str(clusters.ROOT)!r})\n"
        "from tests.service.test_executors import note_and_wait\n"
        "from stemwatch.service.executors import LocalProcesses\n"
        "if __name__ == '__main__':\n"
        "    items = [Path(sys.argv[1]) / str(place) for place in range(200)]\n"
        "    list(LocalProcesses(2).map(note_and_wait, items))\n"
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
    begun = len(list(seen.iterdir()))
    assert begun < 50
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
        list(DaskCluster(f"127.0.0.1:{port}").map(square, [1]))


def test_a_cluster_without_workers_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A scheduler without a worker is not waited for without end."""
    monkeypatch.setattr(dask_cluster, "WORKER_S", 0.3)
    with (
        clusters.dask_cluster(tmp_path, workers=0) as cluster,
        pytest.raises(ClusterError, match=r"no worker for 0\.3 s; start some with `dask worker"),
    ):
        list(DaskCluster(cluster.host_and_port).map(square, [1]))


def test_without_the_extra_the_error_names_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where Dask is not installed, the sentence says what to install."""
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ClusterError, match=r"pip install 'stemwatch\[cluster\]'"):
        list(DaskCluster("127.0.0.1:1").map(square, [1]))


def test_a_worker_of_another_version_refuses() -> None:
    """Two versions need not give the same numbers, so a worker of another one does no work."""
    with pytest.raises(ClusterError, match=r"was asked by 0\.0\.0; install one version"):
        in_worker(square, 3, "0.0.0")
