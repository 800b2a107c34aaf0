"""The service through one fault after the other, counted: what ``make faults`` prints.

    python -m tests.faults --rounds 4

First the rounds of one service: a simulated device that notes each of its answers, PostgreSQL and
the service as a process. After each fault it is waited for until the service is itself again: a
good sample from after the fault's end is in the store, and where the fault was one of runs or
pages, a run that began after it is done, or a page answers. At the end the store is compared with
what the device answered. Then the faults that need a plant of their own, each by the tests that
make it.
"""

from __future__ import annotations

import argparse
import gzip
import http.client
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from stemwatch.service.interruption import ending_on_signals
from stemwatch.service.store.errors import StoreError
from stemwatch.service.store.screenings.records import RunState
from stemwatch.service.store.store import Store, open_store
from tests.service.test_faults import Database, Device, RestartedService, compared

ROOT = Path(__file__).resolve().parent.parent
TAGS = ("FIC-101.OP", "FIC-101.ZT", "TIC-102.PV")
PATIENCE_S = 180.0
DROPPED = '\n[[sources]]\nname = "dropped"\nfolder = "dropped"\n'
STRANGERS = 1100
# Faults with a plant of their own, and the tests that make them and count what is lost.
ELSEWHERE = {
    "answers later than the time-out, RTU over TCP and serial": (
        "connectors/modbus/test_modbus_late_answers.py",
    ),
    "SQL, OPC UA, PI, InfluxDB and Parquet archives that break, hang, garble, vanish": (
        "connectors/test_hostile_archives.py",
        "connectors/pi/test_pi_archive.py",
        "connectors/influx/test_influx_archive.py",
    ),
    "power loss": ("service/test_power_loss.py",),
    "PostgreSQL fails over to its standby": ("service/test_database_failover.py",),
    "the clock is set; both nights of daylight saving": ("service/test_clock_steps.py",),
    "mail servers that hang, dribble, refuse, break off": ("service/alerts/test_mail_servers.py",),
    "webhooks that redirect, rebind, dribble": ("service/alerts/test_webhook.py",),
    "a Dask scheduler that dies or hangs": ("service/test_dask_scheduler.py",),
    "a simulated day of polls: memory": ("service/collector/test_memory_over_a_day.py",),
    "exports that unpack to gigabytes, are cut, change, kill their reader": (
        "service/watch/test_watched_folder.py",
    ),
    "a run that is killed or asked to stop": ("service/test_cli_interrupt.py",),
}


@dataclass(frozen=True)
class Fault:
    """What is done, and what beside good samples shows that it is over: ``also`` by the time in
    seconds since 1970 when the fault ended."""

    make: Callable[[], object]
    also: Callable[[Store, float], bool] = lambda store, ended: True


def main() -> int:
    """Try every fault in each round and print the tables; 1 where something was lost for good."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=4)
    parser.add_argument("--night-only", action="store_true", help="without the tests' faults")
    arguments = parser.parse_args()
    programs = sorted(Path("/usr/lib/postgresql").glob("*/bin/initdb"))
    if not programs:
        print("make faults needs the server programs of PostgreSQL (initdb)", file=sys.stderr)
        return 2
    with ending_on_signals(), ExitStack() as things:
        database, device = Database(programs[-1].parent), Device()
        things.callback(shutil.rmtree, database.folder, ignore_errors=True)
        folder = Path(tempfile.mkdtemp(prefix="stemwatch-faults-"))
        things.callback(shutil.rmtree, folder, ignore_errors=True)
        database.start()
        things.callback(database.stop)
        device.start()
        things.callback(device.stop)
        service = RestartedService(folder, database.url)
        things.callback(service.end, signal.SIGKILL)
        failed = _fault_rounds(arguments.rounds, database, device, service)
    if not arguments.night_only:
        failed |= _elsewhere()
    return failed


def _fault_rounds(
    rounds: int, database: Database, device: Device, service: RestartedService
) -> int:
    (service.folder / "dropped").mkdir()
    (service.folder / "plant.toml").write_text(device.plant_file() + DROPPED, encoding="utf-8")
    service.start()
    faults = {
        "the device cuts every connection for 2 s": Fault(lambda: device.cut(2.0)),
        "the device says nothing for 3 s": Fault(lambda: device.hang(3.0)),
        "the database is away for 5 s": Fault(lambda: _away(database)),
        "the service is killed": Fault(service.kill),
        "the service is killed while the database is away": Fault(lambda: _both(database, service)),
        "the service is asked to stop, and started again": Fault(lambda: _restarted(service)),
        "the service stands still for 5 s (SIGSTOP)": Fault(lambda: _frozen(service)),
        "the collector's process is killed": Fault(lambda: _killed(service, "spawn_main")),
        "the process that workers are forked from is killed": Fault(
            lambda: _killed(service, "forkserver"), _run_since
        ),
        f"{STRANGERS} connections with half a request for 5 s": Fault(
            lambda: _half_open(service), lambda *_: _page(service)
        ),
        "200 MB are sent to /login by a stranger": Fault(
            lambda: _flooded(service), lambda *_: _page(service)
        ),
        "an export that unpacks to 1.6 GB is dropped": Fault(
            lambda: _bomb(service), lambda *_: not any((service.folder / "dropped").glob("*.gz"))
        ),
    }
    with open_store(database.url) as store:
        _again(store, time.time())
        again_s = {
            name: [_tried(store, fault) for _ in range(rounds)] for name, fault in faults.items()
        }
        time.sleep(15.0)  # a run more
        service.end(signal.SIGTERM)
        return _report(again_s, store, service, device)


def _tried(store: Store, fault: Fault) -> float:
    """Seconds from the fault's end until the service is itself again."""
    time.sleep(4.0)
    fault.make()
    ended = time.time()
    _again(store, ended, fault.also)
    return time.time() - ended


def _again(
    store: Store, since: float, also: Callable[[Store, float], bool] = lambda store, ended: True
) -> None:
    end = time.monotonic() + PATIENCE_S
    while time.monotonic() < end:
        with suppress(StoreError, OSError):  # the database or a page is away
            if _sample_since(store, since) and also(store, since):
                return
        time.sleep(0.05)
    raise SystemExit("the service did not come to itself again")


def _sample_since(store: Store, since: float) -> bool:
    if store.samples.bounds("plc-1", TAGS[0]) is None:
        return False
    found = store.samples.read("plc-1", TAGS[0])
    return bool((found.at_us[found.quality == 0] > since * 1e6).any())


def _run_since(store: Store, since: float) -> bool:
    after = datetime.fromtimestamp(since, UTC)
    runs = store.queue.recent(20, schedule="often")
    return any(run.state is RunState.DONE and run.due >= after for run in runs)


def _page(service: RestartedService) -> bool:
    connection = http.client.HTTPConnection("127.0.0.1", service.port, timeout=10)
    try:
        connection.request("GET", "/health")
        return connection.getresponse().status == 200
    finally:
        connection.close()


def _away(database: Database) -> None:
    database.stop()
    database.start(after_s=5.0)


def _both(database: Database, service: RestartedService) -> None:
    database.stop()
    service.kill(between=lambda: database.start(after_s=5.0))


def _restarted(service: RestartedService) -> None:
    begun = time.time()
    service.end(signal.SIGTERM)
    service.start()
    service.dead.append((begun, time.time()))


def _frozen(service: RestartedService) -> None:
    assert service.process is not None
    begun = time.time()
    os.killpg(service.process.pid, signal.SIGSTOP)
    time.sleep(5.0)
    os.killpg(service.process.pid, signal.SIGCONT)
    service.dead += [(begun, begun), (time.time(), time.time())]


def _killed(service: RestartedService, what: str) -> None:
    """SIGKILL to those children of the service whose command line has ``what``."""
    assert service.process is not None
    found = [pid for pid in _children(service.process.pid) if what in _command(pid)]
    if not found:
        raise SystemExit(f"the service has no process {what!r} to kill")
    service.dead.append((time.time(), time.time()))
    for pid in found:
        os.kill(pid, signal.SIGKILL)


def _children(parent: int) -> Iterator[int]:
    for status in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            if int(status.read_text().rpartition(")")[2].split()[1]) == parent:
                yield int(status.parent.name)


def _command(pid: int) -> str:
    with suppress(OSError):
        return Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode()
    return ""


def _half_open(service: RestartedService) -> None:
    """More than a process may have open by default; refused ones are tried again."""
    links: list[socket.socket] = []
    try:
        for _ in range(STRANGERS):
            with suppress(OSError):
                link = socket.create_connection(("127.0.0.1", service.port), timeout=2)
                links.append(link)
                link.sendall(b"GET /login HTTP/1.1\r\nHost: x\r\n")
        time.sleep(5.0)
    finally:
        for link in links:
            link.close()


def _flooded(service: RestartedService) -> None:
    """With both lengths that HTTP knows, until the service hangs up."""
    head = (
        b"POST /login HTTP/1.1\r\nHost: x\r\nContent-Type: application/x-www-form-urlencoded\r\n"
        b"Content-Length: 10\r\nTransfer-Encoding: chunked\r\n\r\n"
    )
    piece = b"%x\r\n" % (1 << 20) + b"x" * (1 << 20) + b"\r\n"
    with (
        suppress(OSError),
        socket.create_connection(("127.0.0.1", service.port), timeout=10) as link,
    ):
        link.sendall(head)
        for _ in range(200):
            link.sendall(piece)


def _bomb(service: RestartedService) -> None:
    name = f"export-{time.time_ns()}.csv.gz"
    row = b"2026-01-01T00:00:00Z,1.0,2.0\n" * 32_768
    with gzip.open(service.folder / name, "wb") as file:
        file.write(b"Time,FIC-101.OP,FIC-101.ZT\n")
        for _ in range(1700):
            file.write(row)
    (service.folder / name).rename(service.folder / "dropped" / name)


def _report(
    again_s: Mapping[str, list[float]], store: Store, service: RestartedService, device: Device
) -> int:
    lost = invented = doubled = samples = said_late = 0
    for tag in TAGS:
        found = store.samples.read("plc-1", tag)
        missing, wrong = compared(found, tag, service, device)
        late = store.samples.reasons("plc-1", tag)
        said = sum(n for why, n in late.items() if "not polled" in why or "no answer" in why)
        samples += int((found.quality == 0).sum())
        lost, said_late = lost + max(0, len(missing) - said), said_late + said
        invented, doubled = invented + len(wrong), doubled + int((np.diff(found.at_us) <= 0).sum())
    runs = store.queue.recent(1000, schedule="often")
    person = sum(run.state in (RunState.FAILED, RunState.CANCELLED) for run in runs)
    print("| fault | tried | itself again after, p50 | p99 |\n|---|---|---|---|")
    for name, seconds in again_s.items():
        p50, p99 = np.percentile(seconds, (50, 99))
        print(f"| {name} | {len(seconds)} | {p50:.1f} s | {p99:.1f} s |")
    every = [second for seconds in again_s.values() for second in seconds]
    p50, p99 = np.percentile(every, (50, 99))
    print(f"| all | {len(every)} | {p50:.1f} s | {p99:.1f} s |")
    print(f"\n{len(every)} faults, {samples} good samples of {len(TAGS)} tags, {len(runs)} runs.\n")
    print("| counted | |\n|---|---|")
    for what, count in (
        ("answers lost", lost),
        ("samples doubled", doubled),
        ("wrong but good", invented),
        ("runs that needed a person", person),
        ("polls that were late or unanswered, and say so", said_late),
    ):
        print(f"| {what} | {count} |")
    return int(lost + doubled + invented + person > 0)


def _elsewhere() -> int:
    """Each of ``ELSEWHERE`` by its tests, the long ones too."""
    print("\n| fault | tests | held | not run here |\n|---|---|---|---|", flush=True)
    failed = False
    with tempfile.TemporaryDirectory() as folder:
        for name, places in ELSEWHERE.items():
            told = Path(folder) / "told.xml"
            command = [sys.executable, "-m", "pytest", "-q", "-m", "", f"--junitxml={told}"]
            files = [str(ROOT / "tests" / place) for place in places]
            ended = subprocess.run([*command, *files], cwd=ROOT, capture_output=True, text=True)
            cases = ElementTree.parse(told).findall(".//testcase") if told.exists() else []
            skipped = sum(case.find("skipped") is not None for case in cases)
            held = sum(len(case) == 0 or case[0].tag.startswith("system") for case in cases)
            print(f"| {name} | {len(cases)} | {held} | {skipped} |", flush=True)
            if ended.returncode or held + skipped < len(cases):
                failed = True
                print(ended.stdout[-3000:], file=sys.stderr)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
