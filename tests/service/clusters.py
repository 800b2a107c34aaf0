"""A real Dask cluster on loopback: a scheduler and workers, each a process of its own."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from distributed import Client

from tests.own_process import environment

Found = TypeVar("Found")
PATIENCE_S = 60.0
# A cluster that waits for work samples its own stack a hundred times a second and its clock fifty
# times: 7 % of a core for as long as the tests last, and with these 2 %.
AT_REST = {
    "DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED": "False",
    "DASK_DISTRIBUTED__ADMIN__TICK__INTERVAL": "1s",
    "DASK_DISTRIBUTED__ADMIN__SYSTEM_MONITOR__INTERVAL": "5s",
}


@dataclass
class Cluster:
    """The cluster's address, and the processes of its scheduler and its workers."""

    address: str
    scheduler_file: Path
    scheduler: subprocess.Popen[bytes]
    workers: list[subprocess.Popen[bytes]] = field(default_factory=list)

    @property
    def host_and_port(self) -> str:
        """The address without its scheme."""
        return self.address.removeprefix("dask://")

    def add_worker(self, **variables: str) -> subprocess.Popen[bytes]:
        """One more worker, with one thread, and ``variables`` in its environment."""
        worker = _dask(
            "worker", "--scheduler-file", str(self.scheduler_file),
            "--nthreads", "1", "--no-nanny", "--no-dashboard", **variables,
        )  # fmt: skip
        self.workers.append(worker)
        return worker

    def client(self) -> Client:
        """A connection to the scheduler, beside whatever else is connected."""
        address = self.address.replace("dask://", "tcp://")
        return Client(address, timeout=PATIENCE_S, set_as_default=False)

    def have(self, count: int) -> None:
        """Start or end workers until ``count`` live, and wait until the scheduler knows it."""
        self.workers = [worker for worker in self.workers if worker.poll() is None]
        while len(self.workers) < count:
            self.add_worker()
        while len(self.workers) > count:
            worker = self.workers.pop()
            worker.kill()
            worker.wait(timeout=PATIENCE_S)
        with self.client() as client:
            _until(lambda: len(client.scheduler_info(n_workers=-1)["workers"]) == count)

    def kill_worker_amid(self, function: str, job: Callable[[], Found]) -> tuple[set[str], Found]:
        """Do ``job`` and meanwhile SIGKILL a worker that is inside ``function``.

        Returns the tasks that died with the worker and what ``job`` gave. Where a worker is, is
        read off its call stack; what died with it is the scheduler's word.
        """
        with self.client() as client, ThreadPoolExecutor(1) as beside:
            pids = client.run(os.getpid)
            result = beside.submit(job)
            while not (victim := _inside(client, function)):
                assert not result.done(), f"over before a worker was killed: {result.result()!r}"
            os.kill(pids[victim], signal.SIGKILL)
            (end,) = _until(lambda: _ends(client, victim))
            return set(end["processing-tasks"]), result.result()


@contextmanager
def dask_cluster(folder: Path, workers: int) -> Iterator[Cluster]:
    """A cluster whose workers are there, and that ends with the block."""
    file = folder / "scheduler.json"
    arguments = ("--host", "127.0.0.1", "--port", "0", "--scheduler-file", str(file))
    scheduler = _dask("scheduler", *arguments, "--no-dashboard")
    cluster = Cluster(address="", scheduler_file=file, scheduler=scheduler)
    try:
        cluster.address = f"dask://{_address(file, scheduler)}"
        cluster.have(workers)
        yield cluster
    finally:
        for process in (*cluster.workers, scheduler):
            process.kill()
            process.wait(timeout=PATIENCE_S)


def _dask(*arguments: str, **variables: str) -> subprocess.Popen[bytes]:
    """A process of Dask that can import the tests."""
    return subprocess.Popen(
        [sys.executable, "-m", "dask", *arguments],
        env={**environment(), "OMP_NUM_THREADS": "1", **AT_REST, **variables},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


def _address(file: Path, scheduler: subprocess.Popen[bytes]) -> str:
    """``HOST:PORT`` of the scheduler, once it has written where it listens."""
    until = time.monotonic() + PATIENCE_S
    while time.monotonic() < until and scheduler.poll() is None:
        try:
            address: str = json.loads(file.read_text(encoding="utf-8"))["address"]
            return address.removeprefix("tcp://")
        except (OSError, ValueError, KeyError):
            time.sleep(0.05)
    raise RuntimeError("the Dask scheduler did not start")


def _inside(client: Client, function: str) -> str | None:
    """The address of a worker that is inside ``function`` now."""
    for worker, stacks in client.call_stack().items():
        if any(f"in {function}" in frame for frames in stacks.values() for frame in frames):
            return str(worker)
    return None


def _ends(client: Client, worker: str) -> list[dict[str, Any]]:
    """What the scheduler noted when ``worker`` went."""
    events = [event for _, event in client.get_events(worker)]
    return [event for event in events if event.get("action") == "remove-worker"]


def _until(there: Callable[[], Found]) -> Found:
    """What ``there`` gives, as soon as it gives something."""
    until = time.monotonic() + PATIENCE_S
    while not (result := there()):
        if time.monotonic() > until:
            raise TimeoutError(f"it did not happen within {PATIENCE_S:g} s")
        time.sleep(0.02)
    return result
