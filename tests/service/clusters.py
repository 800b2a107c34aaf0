"""A real Dask cluster on loopback: a scheduler and workers, each a process of its own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from distributed import Client

ROOT = Path(__file__).parent.parent.parent
PATIENCE_S = 60.0


@dataclass
class Cluster:
    """The cluster's address, and its worker processes."""

    address: str
    scheduler_file: Path
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


@contextmanager
def dask_cluster(folder: Path, workers: int) -> Iterator[Cluster]:
    """A cluster whose workers are there, and that ends with the block."""
    file = folder / "scheduler.json"
    arguments = ("--host", "127.0.0.1", "--port", "0", "--scheduler-file", str(file))
    scheduler = _dask("scheduler", *arguments, "--no-dashboard")
    cluster = Cluster(address="", scheduler_file=file)
    try:
        cluster.address = f"dask://{_address(file, scheduler)}"
        for _ in range(workers):
            cluster.add_worker()
        if workers:
            with Client(cluster.address.replace("dask://", "tcp://"), timeout=PATIENCE_S) as client:
                client.wait_for_workers(workers, timeout=PATIENCE_S)
        yield cluster
    finally:
        for process in (*cluster.workers, scheduler):
            process.kill()
            process.wait(timeout=PATIENCE_S)


def _dask(*arguments: str, **variables: str) -> subprocess.Popen[bytes]:
    """A process of Dask that can import the tests."""
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    return subprocess.Popen(
        [sys.executable, "-m", "dask", *arguments],
        env={**os.environ, "PYTHONPATH": path, "OMP_NUM_THREADS": "1", **variables},
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
