"""Child processes end with their parent, and end on Ctrl-C without a traceback while they start."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from stemwatch.service.process_lifecycle import has_ended, process_name

pytestmark = pytest.mark.skipif(os.name == "nt", reason="signals are sent the POSIX way")

HEAD = """
import os, pathlib, sys, threading, time
folder = pathlib.Path(sys.argv[1])
(folder / f"began-{os.getpid()}").touch()  # each process passes here, the started ones too

def work(items):
    for item in items if isinstance(items, list) else [items]:
        (folder / f"at-work-{os.getpid()}").touch()
        time.sleep(120)
    return [1]
"""
POOLS = {
    "batches of a run": HEAD
    + """
if __name__ == "__main__":
    from stemwatch.service.executors import LocalProcesses, outcomes
    try:
        list(outcomes(LocalProcesses(2, 300.0, isolated=True), work, [[1], [2]], threading.Event()))
    except KeyboardInterrupt:
        sys.exit(130)
""",
    "pieces of a study": HEAD
    + """
if __name__ == "__main__":
    from stemwatch.service.executors import LocalProcesses, map_items
    try:
        list(map_items(LocalProcesses(2), work, [1, 2]))
    except KeyboardInterrupt:
        sys.exit(130)
""",
}


@contextmanager
def started(script: str, folder: Path) -> Iterator[subprocess.Popen[str]]:
    """The script as a process group of its own; at the end nothing of it is left."""
    file = folder / "script.py"
    file.write_text(script, encoding="utf-8")
    process = subprocess.Popen(
        [sys.executable, str(file), str(folder)],
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        yield process
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate(timeout=30)


def there(folder: Path, pattern: str, count: int, seconds: float = 120.0) -> list[int]:
    """The processes that left a file of this pattern, as soon as there are ``count``."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        in_order = sorted(folder.glob(pattern))
        if len(in_order) >= count:
            return [int(path.name.rpartition("-")[2]) for path in in_order]
        time.sleep(0.01)
    return pytest.fail(f"no {count} of {pattern} in {sorted(folder.iterdir())}")


def alive(process: int) -> bool:
    """Whether this process runs; one that ended and was not collected does not."""
    with contextlib.suppress(OSError):
        return Path(f"/proc/{process}/stat").read_text().rpartition(") ")[2][0] != "Z"
    return False


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks into /proc")
@pytest.mark.parametrize("pool", POOLS)
def test_workers_end_with_a_parent_that_was_killed(pool: str, tmp_path: Path) -> None:
    """Also those that are at work and look at no pipe."""
    with started(POOLS[pool], tmp_path) as parent:
        workers = there(tmp_path, "at-work-*", 2)
        parent.kill()
        end = time.monotonic() + 30.0
        while any(map(alive, workers)) and time.monotonic() < end:
            time.sleep(0.05)
        assert [worker for worker in workers if alive(worker)] == []


NAMED = """
import pathlib, sys, time
from stemwatch.service.process_lifecycle import process_name
path = pathlib.Path(sys.argv[1]) / "named-1"
path.with_suffix(".new").write_text(process_name(), encoding="utf-8")
path.with_suffix(".new").rename(path)
time.sleep(120)
"""


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks into /proc")
def test_a_process_of_this_machine_is_known_to_have_ended(tmp_path: Path) -> None:
    """While it lives it has not ended; killed it has, before and after it was collected. Whoever
    has its number later is another, and of another machine or start nobody knows."""
    with started(NAMED, tmp_path) as process:
        there(tmp_path, "named-1", 1)
        name = (tmp_path / "named-1").read_text(encoding="utf-8")
        assert not has_ended(name)
        process.kill()
        os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)
        assert has_ended(name)
        process.communicate(timeout=30)
        assert has_ended(name)
    own = process_name()
    host, pid, start_time, place, _ = own.rsplit(":", 4)
    assert not has_ended(own)
    assert has_ended(f"{host}:{pid}:{int(start_time) + 1}:{place}:0")
    for other in (f"x{host}:{pid}:1:{place}:0", f"{host}:{pid}:1:x:0", f"{host}:{pid}:ab", "Ann"):
        assert not has_ended(other)


@pytest.mark.parametrize("pool", POOLS)
def test_ctrl_c_while_workers_start_prints_no_traceback(pool: str, tmp_path: Path) -> None:
    """Sent to a worker that has begun and is still importing; its parent, which would end it, is
    told later, when others are at work."""
    with started(POOLS[pool], tmp_path) as parent:
        for process in set(there(tmp_path, "began-*", 2)) - {parent.pid}:
            os.kill(process, signal.SIGINT)
        there(tmp_path, "at-work-*", 2)
        os.killpg(parent.pid, signal.SIGINT)
        _, text = parent.communicate(timeout=60)
        assert parent.returncode == 130
        assert "Traceback" not in text
