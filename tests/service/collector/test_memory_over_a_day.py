"""A day of collection in one process: its memory stays what it was after the first hours."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.own_process import environment

# A poll every 10 s of the simulated day, each handed over at once; the store is away for an hour.
A_DAY = """
import asyncio, gc, sys
from pathlib import Path

from stemwatch.connectors.modbus.poller import DevicePoller
from stemwatch.service.collector import Spool
from stemwatch.service.collector.forwarder import Forwarder
from stemwatch.service.store.store import open_store
from tests.service.collector.running_collector import counter, counting_server

HOUR = 360


def resident_kb():
    gc.collect()
    lines = Path("/proc/self/status").read_text().splitlines()
    return int(next(line for line in lines if line.startswith("VmRSS")).split()[1])


async def a_day(folder):
    with open_store(f"sqlite:///{folder / 'store.db'}") as store:
        spool = Spool(folder / "spool")
        forwarder = Forwarder(spool, store.samples)
        async with counting_server() as (port, served):
            poller = DevicePoller(counter(port), spool.append)
            await poller.start()
            for number in range(24 * HOUR):
                spool.append(await poller.poll(1_700_000_000_000_000 + number * 10_000_000))
                if not 10 * HOUR < number < 11 * HOUR:
                    assert forwarder.once()
                if number % (4 * HOUR) == 4 * HOUR - 1:
                    served.clear()
                    print(resident_kb(), flush=True)
            await poller.stop()
        spool.close()


asyncio.run(a_day(Path(sys.argv[1])))
"""


@pytest.mark.long
@pytest.mark.skipif(sys.platform != "linux", reason="memory is read from /proc")
def test_memory_is_flat_over_a_day(tmp_path: Path) -> None:
    """Within 5 % from the fourth hour to the last, with an hour without the store between."""
    process = subprocess.run(
        [sys.executable, "-c", A_DAY, str(tmp_path)],
        env=environment(),
        check=False,
        capture_output=True,
        text=True,
    )
    assert process.returncode == 0, process.stderr
    first, *later = map(int, process.stdout.split())
    assert len(later) == 5
    assert max(later) <= 1.05 * first, process.stdout
