"""PostgreSQL fails over: the primary is gone, its standby is promoted, and the service goes on."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from stemwatch.connectors.modbus.sample_batch import one_instant
from stemwatch.service.collector import Spool
from stemwatch.service.collector.forwarder import Forwarder
from stemwatch.service.store.runs.queue import RunToQueue
from stemwatch.service.store.screenings.records import RunState
from stemwatch.service.store.store import Store, open_store
from tests.service.test_faults import Database, postgres_programs

START_US = 1_700_000_000_000_000
pytestmark = [pytest.mark.long, pytest.mark.postgres]


class Pair:
    """A primary, and a standby that has each commit before the primary says that it is done."""

    def __init__(self, programs: Path) -> None:
        self.primary = Database(programs)
        self._programs = programs
        self.standby = Path(tempfile.mkdtemp(prefix="stemwatch-standby-"))
        self.standby.chmod(0o755)
        self._user = "postgres" if os.geteuid() == 0 else None
        if self._user:
            shutil.chown(self.standby, self._user)
        settings = self.primary.folder / "data" / "postgresql.conf"
        with settings.open("a") as file:
            file.write("synchronous_standby_names = '*'\nsynchronous_commit = local\n")
        self.primary.start()
        where = ["-h", str(self.primary.folder), "-U", "postgres"]
        self._do("pg_basebackup", *where, "-D", str(self._data), "-R", "-X", "stream")
        self._control(
            "-w", "-l", str(self.standby / "log"), "-o", f"-k {self.standby} -c listen_addresses= "
            "-c synchronous_standby_names= -c synchronous_commit=on", "start",
        )  # fmt: skip
        with settings.open("a") as file:
            file.write("synchronous_commit = on\n")
        self.primary.reload()
        hosts = f"{self.primary.folder},{self.standby}"
        self.url = f"postgresql://postgres@/postgres?host={hosts}&target_session_attrs=read-write"

    @property
    def _data(self) -> Path:
        return self.standby / "data"

    def fail_over(self) -> None:
        """The primary is gone at once; the standby is told to be the primary."""
        self.primary.stop()
        self._control("-w", "promote")

    def end(self) -> None:
        """Stop what runs and remove both."""
        self._control("-m", "immediate", "stop")
        for folder in (self.standby, self.primary.folder):
            shutil.rmtree(folder, ignore_errors=True)

    def _control(self, *arguments: str) -> None:
        self._do("pg_ctl", "-D", str(self._data), *arguments)

    def _do(self, program: str, *arguments: str) -> None:
        subprocess.run(
            [str(self._programs / program), *arguments],
            user=self._user,
            cwd="/",
            check=True,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )


@pytest.fixture
def pair() -> Iterator[Pair]:
    """Primary and standby."""
    result = Pair(postgres_programs())
    try:
        yield result
    finally:
        result.end()


def until_stored(forwarder: Forwarder) -> None:
    end = time.monotonic() + 120.0
    while not forwarder.once():
        assert time.monotonic() < end, forwarder.state.fault
        time.sleep(0.2)


def test_a_failover_loses_and_doubles_nothing(pair: Pair, tmp_path: Path) -> None:
    """Samples, a run that was going on and a message that waits: all go on with the new primary,
    through the same store, without a restart."""
    spool = Spool(tmp_path / "spool")
    with open_store(pair.url) as store:
        forwarder = Forwarder(spool, store.samples)
        number = store.queue.put(RunToQueue(), software_version="1")
        assert store.queue.claim("me") is not None
        store.deliveries.put({"a": {"subject": "s"}}, "k1", [])
        for second in range(60):
            if second == 30:
                pair.fail_over()
            at_us = START_US + second * 1_000_000
            value = np.array([float(second)])
            spool.append(one_instant("plc", ["T"], at_us, value, np.zeros(1, np.uint8), [""]))
            forwarder.once()  # fails while there is no primary, and is tried again
        until_stored(forwarder)
        assert store.samples.read("plc", "T").values.tolist() == [float(n) for n in range(60)]
        assert store.queue.beat(number, "me") is not None
        assert store.queue.finish(number, RunState.DONE).state is RunState.DONE
        assert _message(store) == "k1"
    spool.close()


def _message(store: Store) -> str:
    claimed = store.deliveries.claim()
    return "" if claimed is None else claimed.key
