"""Executors: the same results wherever the work is done, and whatever happens to a worker."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from collections.abc import Generator
from pathlib import Path

import pytest

from stemwatch.service.executors import Executor, InProcess, LocalProcesses, choose_executor

EXECUTORS = [InProcess(), LocalProcesses(2)]


def square(number: int) -> int:
    return number * number


def square_or_die(number: int) -> int:
    """Dies in a worker where the number is 3, as a crash in a library would."""
    if number == 3 and multiprocessing.parent_process() is not None:
        os._exit(1)
    return number * number


def reciprocal(number: int) -> float:
    return 1 / number


def note_and_wait(path: Path) -> None:
    """Leaves a file, so that a test can see what was begun."""
    path.touch()
    time.sleep(0.25)


def threads(_: int) -> list[str | None]:
    return [os.environ.get(name) for name in ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS")]


@pytest.mark.parametrize("executor", EXECUTORS, ids=repr)
@pytest.mark.parametrize("count", [0, 1, 7])
def test_each_place_comes_once_with_its_result(executor: Executor, count: int) -> None:
    """However many items there are, each gives one result at its own place."""
    found = list(executor.map(square, range(count)))
    assert sorted(found) == [(place, place * place) for place in range(count)]


@pytest.mark.parametrize("executor", EXECUTORS, ids=repr)
def test_what_the_work_raises_comes_out(executor: Executor) -> None:
    """An error of the work itself is raised to the caller, not swallowed."""
    with pytest.raises(ZeroDivisionError):
        list(executor.map(reciprocal, [1, 0, 2]))


def test_a_dying_worker_costs_no_result() -> None:
    """What a dead worker left undone is done by the process that asked."""
    found = list(LocalProcesses(2).map(square_or_die, range(8)))
    assert sorted(found) == [(place, place * place) for place in range(8)]


def test_workers_use_one_thread_each() -> None:
    """Numbers in a worker use one thread, so that workers do not fight for cores."""
    assert [["1", "1"]] * 2 == [result for _, result in LocalProcesses(2).map(threads, range(2))]


def test_what_was_not_begun_is_dropped(tmp_path: Path) -> None:
    """A caller that stops asking does not wait for all the rest."""
    items = [tmp_path / str(place) for place in range(40)]
    results = LocalProcesses(2).map(note_and_wait, items)
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
        f"sys.path.insert(0, {str(Path(__file__).parent)!r})\n"
        "from test_executors import note_and_wait\n"
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
    assert LocalProcesses(3) == choose_executor(3)
    cores = os.cpu_count() or 1
    assert choose_executor(None) == (LocalProcesses(cores) if cores > 1 else InProcess())
