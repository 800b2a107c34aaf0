"""Polls 500 valves (OP, MV, PV) at 1 s from a simulator in another process, and says how late.

    python tests/benchmarks/bench_modbus.py                  # 60 s
    python tests/benchmarks/bench_modbus.py --seconds 600    # the ten minutes that are asked for

Through the whole chain: poller, spool on disk, a SQLite table that takes each sample once. Lateness
is the time from a poll's instant to its last response. Target: 99th percentile below 100 ms, less
than one core, nothing missed.
"""

from __future__ import annotations

import argparse
import asyncio
import multiprocessing
import os
import sqlite3
import tempfile
import threading
import time
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from stemwatch.connectors.modbus import Device, Register, SampleBatch
from stemwatch.connectors.modbus.datatypes import DataType
from stemwatch.connectors.modbus.device import Link, LinkKind
from stemwatch.connectors.modbus.register_address import RegisterAddress, Table
from stemwatch.models.studies.simulator import demo_plant
from stemwatch.service.collector import Collector, Spool, collect
from stemwatch.service.modbus_plant.register_layout import STRIDE, words
from stemwatch.service.modbus_plant.simulated_ahead import simulate_stretch

ASKED_LATE_S, ASKED_CORES = 0.1, 1.0
SIGNALS = {"OP": 0, "ZT": 2, "PV": 4}


class OneTable:
    """The simplest store: one row for each sample; a second sample of the same key is ignored."""

    def __init__(self, path: Path) -> None:
        self._db = sqlite3.connect(path, check_same_thread=False)
        self._db.execute("PRAGMA journal_mode=WAL")
        self._db.execute(
            "CREATE TABLE samples (source, tag, at_us, value, quality, reason,"
            " PRIMARY KEY (tag, at_us, source)) WITHOUT ROWID"
        )

    def write(self, batch: SampleBatch) -> None:
        """Insert what is not there yet."""
        source = [batch.source] * len(batch)
        columns = (batch.at_us.tolist(), batch.values.tolist(), batch.quality.tolist())
        rows = zip(source, batch.tags, *columns, batch.reasons, strict=True)
        with self._db:
            self._db.executemany("INSERT OR IGNORE INTO samples VALUES (?,?,?,?,?,?)", rows)

    def count(self) -> tuple[int, int]:
        """Rows, and rows that are good."""
        rows = self._db.execute("SELECT count(*), sum(quality = 0) FROM samples").fetchone()
        return int(rows[0]), int(rows[1] or 0)


def simulator(valves: int, devices: int, ports: Connection) -> None:
    """Serve ``valves`` over ``devices`` servers: the demo plant's loops, shifted in time."""
    asyncio.run(_serve(valves, devices, ports))


async def _serve(valves: int, devices: int, ports: Connection) -> None:
    from pymodbus.server import ModbusTcpServer
    from pymodbus.simulator import DataType as Kind
    from pymodbus.simulator import SimData, SimDevice

    loops = [replace(loop, duration_s=900.0) for loop in demo_plant(1)]
    tapes = [simulate_stretch(loop, None, 0.0, 0.0, 900.0, 1).rows for loop in loops]
    began_s = time.monotonic()

    def action(first: int, count: int) -> object:
        shown = -1

        async def answer(_function, _start, _address, _count, registers, _written) -> None:
            nonlocal shown
            tick = int(time.monotonic() - began_s)
            if tick != shown:
                shown = tick
                tape = (tapes[(first + i) % len(tapes)] for i in range(count))
                rows = [rows[(tick + 37 * (first + i)) % len(rows)] for i, rows in enumerate(tape)]
                registers[: STRIDE * count] = words(rows)

        return answer

    bound = []
    each = valves // devices
    for index in range(devices):
        memory = SimData(0, values=[0] * STRIDE * each, datatype=Kind.REGISTERS)
        hook: object = action(index * each, each)
        device = SimDevice(id=1, simdata=[memory], action=hook)
        server: Any = ModbusTcpServer(device, address=("127.0.0.1", 0))
        await server.serve_forever(background=True)
        bound.append((server, server.transport.sockets[0].getsockname()[1]))
    ports.send([port for _, port in bound])
    await asyncio.Event().wait()


def device_of(place: int, port: int, valves: int) -> Device:
    """A device with OP, MV and PV of ``valves`` valves."""
    registers = tuple(
        Register(
            tag=f"V{place:02}-{valve:03}.{name}",
            unit_id=1,
            address=RegisterAddress(Table.HOLDING, STRIDE * valve + first),
            kind=DataType.FLOAT32,
        )
        for valve in range(valves)
        for name, first in SIGNALS.items()
    )
    link = Link(kind=LinkKind.TCP, target="127.0.0.1", port=port)
    return Device(name=f"plc-{place}", link=link, registers=registers, every_s=1.0)


def main() -> None:
    """Run, and print what was measured."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--valves", type=int, default=500)
    parser.add_argument("--devices", type=int, default=10, help="connections they are spread over")
    requested = parser.parse_args()
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    arguments = (requested.valves, requested.devices, there)
    process = context.Process(target=simulator, args=arguments, daemon=True)
    process.start()
    ports = here.recv()
    each = requested.valves // requested.devices
    devices = [device_of(index, port, each) for index, port in enumerate(ports)]
    with tempfile.TemporaryDirectory() as folder:
        run(devices, Path(folder), requested.seconds)
    process.kill()
    process.join()


def run(devices: list[Device], folder: Path, seconds: float) -> None:
    """Collect for ``seconds`` and print lateness, load and counts."""
    store, spool = OneTable(folder / "samples.db"), Spool(folder / "spool")
    collector = Collector(devices, store, spool)
    stop = threading.Event()
    threading.Timer(seconds, stop.set).start()
    cpu, began_s = os.times(), time.monotonic()
    collect(collector, stop)
    wall_s, after = time.monotonic() - began_s, os.times()
    spool.close()
    cores = (after.user + after.system - cpu.user - cpu.system) / wall_s
    late_s = np.concatenate([np.array(state.late_s) for state in collector.states])
    took_s = np.concatenate([np.array(state.took_s) for state in collector.states])
    rows, good = store.count()
    polled = sum(state.good + state.bad for state in collector.states)
    missed = sum(state.missed for state in collector.states)
    tags = sum(len(device.registers) for device in devices)
    blocks = sum(len(device.blocks()) for device in devices)
    print(f"{tags} tags on {len(devices)} connections in {blocks} blocks, {wall_s:.0f} s")
    for name, values in (("lateness", late_s), ("a poll takes", took_s)):
        shares = np.percentile(values, [50, 99, 100]) * 1e3
        print(f"{name}: median {shares[0]:.1f}, p99 {shares[1]:.1f}, worst {shares[2]:.1f} ms")
    print(f"processor: {cores:.2f} cores; load average {os.getloadavg()[0]:.1f}")
    print(f"samples: {polled} polled, {rows} stored, {good} good, {missed} instants missed")
    met = np.percentile(late_s, 99) < ASKED_LATE_S and cores < ASKED_CORES and rows == polled
    print("met" if met and not missed else "NOT MET")


if __name__ == "__main__":
    main()
