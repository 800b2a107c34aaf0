"""The service through one fault after the other, counted: what ``make faults`` prints.

    python -m tests.faults --rounds 4

A simulated device that notes each of its answers, PostgreSQL and the service as a process. After
each fault it is waited for until the service is itself again: a good sample from after the fault's
end is in the store. At the end the store is compared with what the device answered.
"""

from __future__ import annotations

import argparse
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from stemwatch.service.store.errors import StoreError
from stemwatch.service.store.screenings.records import RunState
from stemwatch.service.store.store import Store, open_store
from tests.service.test_faults import Database, Device, Night, compared

TAGS = ("FIC-101.OP", "FIC-101.ZT", "TIC-102.PV")
PATIENCE_S = 180.0


def main() -> int:
    """Try every fault in each round and print the table; 1 where something was lost for good."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=4)
    rounds = parser.parse_args().rounds
    programs = sorted(Path("/usr/lib/postgresql").glob("*/bin/initdb"))
    if not programs:
        print("make faults needs the server programs of PostgreSQL (initdb)", file=sys.stderr)
        return 2
    database, device = Database(programs[-1].parent), Device()
    folder = Path(tempfile.mkdtemp(prefix="stemwatch-faults-"))
    database.start()
    device.start()
    night = Night(folder, database.url)
    try:
        return _night(rounds, database, device, night)
    finally:
        night.end(signal.SIGKILL)
        device.stop()
        database.stop()
        shutil.rmtree(folder, ignore_errors=True)
        shutil.rmtree(database.folder, ignore_errors=True)


def _night(rounds: int, database: Database, device: Device, night: Night) -> int:
    (night.folder / "plant.toml").write_text(device.plant_file(), encoding="utf-8")
    night.start()
    faults: dict[str, Callable[[], object]] = {
        "the device cuts every connection for 2 s": lambda: device.cut(2.0),
        "the device says nothing for 3 s": lambda: device.hang(3.0),
        "the database is away for 5 s": lambda: _away(database),
        "the service is killed": night.kill,
        "the service is killed while the database is away": lambda: _both(database, night),
    }
    with open_store(database.url) as store:
        _again(store, time.time())
        again_s = {
            name: [_tried(store, fault) for _ in range(rounds)] for name, fault in faults.items()
        }
        time.sleep(15.0)  # a run more
        night.end(signal.SIGTERM)
        return _report(again_s, store, night, device)


def _tried(store: Store, fault: Callable[[], object]) -> float:
    """Seconds from the fault's end until the service is itself again."""
    time.sleep(4.0)
    fault()
    ended = time.time()
    _again(store, ended)
    return time.time() - ended


def _again(store: Store, since: float) -> None:
    end = time.monotonic() + PATIENCE_S
    while time.monotonic() < end:
        try:
            if store.samples.bounds("plc-1", TAGS[0]) is not None:
                samples = store.samples.read("plc-1", TAGS[0])
                if (samples.at_us[samples.quality == 0] > since * 1e6).any():
                    return
        except StoreError:
            pass  # the database is away
        time.sleep(0.05)
    raise SystemExit("the service did not come to itself again")


def _away(database: Database) -> None:
    database.stop()
    database.start(after_s=5.0)


def _both(database: Database, night: Night) -> None:
    database.stop()
    night.kill(between=lambda: database.start(after_s=5.0))


def _report(again_s: dict[str, list[float]], store: Store, night: Night, device: Device) -> int:
    lost = invented = doubled = samples = said_late = 0
    for tag in TAGS:
        recording = store.samples.read("plc-1", tag)
        missing, wrong = compared(recording, tag, night, device)
        late = store.samples.reasons("plc-1", tag)
        total = sum(n for why, n in late.items() if "not polled" in why or "no answer" in why)
        samples += int((recording.quality == 0).sum())
        lost, said_late = lost + max(0, len(missing) - total), said_late + total
        invented, doubled = (
            invented + len(wrong),
            doubled + int((np.diff(recording.at_us) <= 0).sum()),
        )
    runs = store.queue.recent(1000, schedule="often")
    person = sum(run.state in (RunState.FAILED, RunState.CANCELLED) for run in runs)
    print("| fault | tried | itself again after, p50 | p99 |\n|---|---|---|---|")
    for name, seconds in again_s.items():
        p50, p99 = np.percentile(seconds, (50, 99))
        print(f"| {name} | {len(seconds)} | {p50:.1f} s | {p99:.1f} s |")
    tried = sum(map(len, again_s.values()))
    print(f"\n{tried} faults, {samples} good samples of {len(TAGS)} tags, {len(runs)} runs.")
    for what, count in (
        ("answers lost", lost),
        ("samples doubled", doubled),
        ("wrong but good", invented),
        ("runs that needed a person", person),
    ):
        print(f"{what}: {count}")
    print(f"polls that were late or unanswered, and say so: {said_late}")
    return int(lost + doubled + invented + person > 0)


if __name__ == "__main__":
    sys.exit(main())
