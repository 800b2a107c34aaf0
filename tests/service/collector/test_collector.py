"""Collecting: every sample that a device served is in the store, exactly once, whatever happens."""

from __future__ import annotations

import asyncio
import csv
import os
import signal
import sys
import threading
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from stemwatch.connectors.modbus.sample_batch import one_instant
from stemwatch.service.collector import Collector, Spool, collect
from stemwatch.service.collector.forwarder import Forwarder
from stemwatch.service.collector.spool import backlog
from tests.own_process import environment
from tests.service.collector.running_collector import (
    EVERY_S,
    RealTable,
    collecting,
    counter,
    counting_server,
    stored,
)

GOOD = "quality = 0"


async def until(met: Callable[[], bool], patience_s: float = 30.0) -> None:
    """Wait for ``met``."""
    async with asyncio.timeout(patience_s):
        while not met():
            await asyncio.sleep(0.02)


def reached(served: list[int], count: int) -> bool:
    """Whether so many requests were served."""
    return len(served) >= count


def once_each(rows: list[tuple[str, int, float]], served: list[int]) -> None:
    """Every number that was served is stored once, in the order of time."""
    numbers = [int(value) for _, _, value in rows]
    assert numbers == served[: len(numbers)]
    assert len(served) - len(numbers) <= 1  # the answer to a poll that was cancelled


def test_what_is_served_is_stored_once(tmp_path: Path) -> None:
    """In order, on an even clock, and all of it when collecting ends."""

    async def run() -> tuple[list[int], Collector]:
        table = RealTable(tmp_path / "db")
        async with counting_server() as (port, served):
            async with collecting(table, tmp_path / "spool", counter(port)) as collector:
                await until(lambda: len(stored(tmp_path / "db")) >= 8)
            return served, collector

    served, collector = asyncio.run(run())
    once_each(stored(tmp_path / "db", GOOD), served)
    rows = stored(tmp_path / "db")
    steps = np.diff([at_us for _, at_us, _ in rows])
    assert set(steps.tolist()) == {round(EVERY_S * 1e6)}
    assert collector.store.stored == len(rows)
    assert collector.states[0].good + collector.states[0].bad == len(rows)


def test_samples_wait_on_disk_while_the_store_is_away(tmp_path: Path) -> None:
    """Polling goes on; when the store is back everything arrives, in order, once."""

    async def run() -> list[int]:
        table = RealTable(tmp_path / "db")
        async with counting_server() as (port, served):
            async with collecting(table, tmp_path / "spool", counter(port)) as collector:
                await until(lambda: len(stored(tmp_path / "db")) >= 3)
                table.away.set()
                await until(lambda: collector.store.fault != "")
                before = len(stored(tmp_path / "db"))
                count = len(served)
                await until(lambda: len(served) > count + 10)
                assert len(stored(tmp_path / "db")) == before
                assert "the database is away" in collector.store.fault
                table.away.clear()
                await until(lambda: len(stored(tmp_path / "db")) > count + 10)
                await until(lambda: collector.store.fault == "")
            return served

    served = asyncio.run(run())
    once_each(stored(tmp_path / "db", GOOD), served)


def test_a_store_that_breaks_behind_the_commit_gets_nothing_twice(tmp_path: Path) -> None:
    """The same batch comes again, and its samples are there already."""

    async def run() -> list[int]:
        table = RealTable(tmp_path / "db")
        table.commit_then_fail.set()
        async with counting_server() as (port, served):
            async with collecting(table, tmp_path / "spool", counter(port)) as collector:
                await until(lambda: len(stored(tmp_path / "db")) >= 3)
                await until(lambda: "behind the commit" in collector.store.fault)
                table.commit_then_fail.clear()
                count = len(served)
                await until(lambda: len(stored(tmp_path / "db")) >= count)
            return served

    served = asyncio.run(run())
    once_each(stored(tmp_path / "db", GOOD), served)


def test_what_waits_at_the_end_arrives_after_the_next_start(tmp_path: Path) -> None:
    """The store is away until after the process has ended in order."""

    async def first() -> list[int]:
        table = RealTable(tmp_path / "db")
        table.away.set()
        async with counting_server() as (port, served):
            async with collecting(table, tmp_path / "spool", counter(port)):
                await until(lambda: len(served) >= 6)
            return served

    served = asyncio.run(first())
    assert stored(tmp_path / "db") == []

    async def second() -> None:
        table = RealTable(tmp_path / "db")
        async with collecting(table, tmp_path / "spool"):
            await until(lambda: len(stored(tmp_path / "db")) >= 5)

    asyncio.run(second())  # a collector without devices still hands over
    once_each(stored(tmp_path / "db", GOOD), served)


def test_samples_that_the_store_refuses_hold_up_nobody(tmp_path: Path) -> None:
    """They stand in a file with the reason; the ones before and behind them are stored."""

    async def run() -> tuple[list[int], Collector]:
        table = RealTable(tmp_path / "db")
        table.refuses = 4.0
        async with counting_server() as (port, served):
            async with collecting(table, tmp_path / "spool", counter(port)) as collector:
                # On a busy machine a poll may be missed: that is stored too, but has no number.
                await until(lambda: len(stored(tmp_path / "db", GOOD)) >= 7)
            return served, collector

    _, collector = asyncio.run(run())
    numbers = [int(value) for _, _, value in stored(tmp_path / "db", GOOD)]
    assert numbers[:7] == [1, 2, 3, 5, 6, 7, 8]
    assert collector.store.refused == 1
    (path,) = (tmp_path / "spool" / "refused").glob("*.csv")
    note, _, row = list(csv.reader(path.read_text("utf-8").splitlines()))
    assert "4.0 cannot be stored" in note[0]
    assert (row[1], float(row[3])) == ("N", 4.0)


def test_refused_samples_of_several_devices_have_a_file_each(tmp_path: Path) -> None:
    """They may have waited together; none takes the place of another."""
    table = RealTable(tmp_path / "db")
    table.refuses = 4.0
    spool = Spool(tmp_path / "spool")
    for at_us in (1, 2):
        for device in ("one", "two"):
            spool.append(one_instant(device, ["N"], at_us, np.array([4.0]), np.zeros(1), [""]))
    forwarder = Forwarder(spool, table)
    assert forwarder.once()
    spool.close()
    refused = [path.read_text("utf-8") for path in (tmp_path / "spool" / "refused").glob("*.csv")]
    assert forwarder.state.refused == 4
    rows = sorted(text.splitlines()[2].split(",")[0] for text in refused)
    assert rows == ["one", "one", "two", "two"]


def test_one_device_that_is_away_does_not_stop_the_other(tmp_path: Path) -> None:
    """Two devices in one store: good samples of one, reasons from the other."""

    async def run() -> None:
        table = RealTable(tmp_path / "db")
        async with counting_server() as (port, _):
            devices = (counter(port, "alive"), counter(1, "dead"))
            async with collecting(table, tmp_path / "spool", *devices):
                await until(lambda: len(stored(tmp_path / "db", alive)) >= 6)
                await until(lambda: len(stored(tmp_path / "db", dead)) >= 6)

    alive, dead = f"source = 'alive' AND {GOOD}", "source = 'dead' AND reason LIKE '%refused%'"
    asyncio.run(run())
    assert stored(tmp_path / "db", f"source = 'dead' AND {GOOD}") == []


@pytest.mark.skipif(os.name == "nt", reason="signals are sent the POSIX way")
def test_a_killed_collector_loses_at_most_the_poll_it_was_in(tmp_path: Path) -> None:
    """SIGKILL four times: nothing that was answered before is lost, nothing is there twice."""
    database = tmp_path / "db"
    RealTable(database)

    async def run() -> list[int]:
        async with counting_server() as (port, served):
            for _ in range(4):
                process = await asyncio.create_subprocess_exec(
                    sys.executable,
                    "-m",
                    "tests.service.collector.running_collector",
                    str(tmp_path / "spool"),
                    str(database),
                    str(port),
                    env=environment(),
                )
                enough = len(served) + 12
                await until(partial(reached, served, enough))
                process.send_signal(signal.SIGKILL)
                await process.wait()
            table = RealTable(database)
            async with collecting(table, tmp_path / "spool"):
                await until(lambda: backlog(tmp_path / "spool").size_bytes == 0)
            return served

    served = asyncio.run(run())
    numbers = [int(value) for _, _, value in stored(database, GOOD)]
    assert numbers == sorted(set(numbers))
    lost = set(served) - set(numbers)
    assert len(lost) <= 4  # one for each kill: answered, and killed before it was on disk
    assert len(numbers) >= 44


def test_a_thread_collects_until_it_is_told_to_stop(tmp_path: Path) -> None:
    """The way the service runs it: beside everything else, with an event to stop."""
    table = RealTable(tmp_path / "db")
    stop, ready = threading.Event(), threading.Event()
    ports: list[int] = []

    async def serve() -> None:
        async with counting_server() as (port, _):
            ports.append(port)
            ready.set()
            await asyncio.to_thread(stop.wait)

    serving = threading.Thread(target=asyncio.run, args=(serve(),))
    serving.start()
    assert ready.wait(20)
    spool = Spool(tmp_path / "spool")
    collector = Collector([counter(ports[0])], table, spool)
    thread = threading.Thread(target=collect, args=(collector, stop))
    thread.start()
    asyncio.run(until(lambda: len(stored(tmp_path / "db")) >= 3))
    stop.set()
    thread.join(timeout=20)
    serving.join(timeout=20)
    spool.close()
    assert not thread.is_alive()
    assert collector.states[0].good >= 3
