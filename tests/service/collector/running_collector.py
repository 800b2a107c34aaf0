"""What tests of the collector share: a real table, a counting server, a process that collects."""

from __future__ import annotations

import asyncio
import sqlite3
import sys
import threading
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, closing
from pathlib import Path
from typing import Any

from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from stemwatch.connectors.modbus import Device, SampleBatch
from stemwatch.connectors.modbus.datatypes import DataType as Kind
from stemwatch.connectors.modbus.device import Link, LinkKind
from stemwatch.service.collector import Collector, SinkRefused, Spool, collect
from tests.connectors.modbus.loopback_servers import register

EVERY_S = 0.1
_TABLE = (
    "CREATE TABLE IF NOT EXISTS samples (source, tag, at_us, value, quality, reason,"
    " PRIMARY KEY (source, tag, at_us))"
)


class RealTable:
    """A table that takes each sample once, that can be away, and that can refuse.

    ``away`` makes every write fail; ``commit_then_fail`` stores and fails afterwards, as a
    connection does that breaks behind the commit; ``refuses`` is a value it never stores.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self.away = threading.Event()
        self.commit_then_fail = threading.Event()
        self.refuses: float | None = None
        with closing(sqlite3.connect(path)) as db, db:
            db.execute(_TABLE)

    def write(self, batch: SampleBatch) -> None:
        """Insert what is not there yet."""
        if self.away.is_set():
            raise ConnectionError("the database is away")
        values = batch.values.tolist()
        if self.refuses is not None and self.refuses in values:
            raise SinkRefused(f"{self.refuses} cannot be stored")
        source = [batch.source] * len(batch)
        times, quality = batch.at_us.tolist(), batch.quality.tolist()
        rows = zip(source, batch.tags, times, values, quality, batch.reasons, strict=True)
        with closing(sqlite3.connect(self._path)) as db, db:
            db.executemany("INSERT OR IGNORE INTO samples VALUES (?, ?, ?, ?, ?, ?)", rows)
        if self.commit_then_fail.is_set():
            raise ConnectionError("lost behind the commit")


def stored(path: Path, where: str = "1") -> list[tuple[str, int, float]]:
    """Tag, instant and value of each sample, in order of time."""
    with closing(sqlite3.connect(path)) as db:
        rows = db.execute(f"SELECT tag, at_us, value FROM samples WHERE {where} ORDER BY at_us")
        return rows.fetchall()


@asynccontextmanager
async def counting_server(port: int = 0) -> AsyncIterator[tuple[int, list[int]]]:
    """A device whose register 0 counts its own requests; yields its port and what it served."""
    served: list[int] = []

    async def answer(_function, _start, _address, _count, registers, _written) -> None:
        served.append(len(served) + 1)
        registers[0] = served[-1] % 65536

    memory = SimData(0, values=[0] * 4, datatype=DataType.REGISTERS)
    device = SimDevice(id=1, simdata=[memory], action=answer)
    server: Any = ModbusTcpServer(device, address=("127.0.0.1", port))
    await server.serve_forever(background=True)
    try:
        yield server.transport.sockets[0].getsockname()[1], served
    finally:
        await server.shutdown()


def counter(port: int, name: str = "plc") -> Device:
    """The device with its counter as tag ``N``."""
    link = Link(kind=LinkKind.TCP, target="127.0.0.1", port=port, timeout_s=0.5)
    tags = (register("N", 0, Kind.UINT16),)
    return Device(name=name, link=link, registers=tags, every_s=EVERY_S)


@asynccontextmanager
async def collecting(table: RealTable, folder: Path, *devices: Device) -> AsyncIterator[Collector]:
    """Collect from ``devices`` into ``table`` until the block ends, and then stop in order."""
    spool = Spool(folder)
    collector = Collector(devices, table, spool, gather_s=0.05)
    task = asyncio.create_task(collector.run())
    try:
        yield collector
    finally:
        task.cancel()
        await asyncio.wait([task])
        spool.close()
    assert task.cancelled()


def main() -> None:
    """Collect for ever: ``python -m tests.service.collector.running_collector FOLDER DATABASE
    PORT``."""
    folder, database, port = Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3])
    collector = Collector([counter(port)], RealTable(database), Spool(folder), gather_s=0.05)
    print("collecting", flush=True)
    collect(collector, threading.Event())


if __name__ == "__main__":
    main()
