"""Unknown clients of a running service cannot exhaust its memory or file descriptors."""

from __future__ import annotations

import re
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from stemwatch.service.store.runs.queue import RunToQueue
from stemwatch.service.store.screenings.records import RunState
from tests.service.serve.running_service import SERVICE, Site, get, site_in, until

pytestmark = pytest.mark.early

PATIENCE_S = 20.0
HALF_A_HEADER = b"GET / HTTP/1.1\r\nX-Waits: "
LONG_BODY = (
    b"POST /login HTTP/1.1\r\nHost: 127.0.0.1\r\n"
    b"Content-Type: application/x-www-form-urlencoded\r\n"
    b"Content-Length: 10\r\nTransfer-Encoding: chunked\r\n\r\n"
)
CHUNK = b"10000\r\n" + b"a" * 0x10000 + b"\r\n"


@pytest.fixture
def csv_site(tmp_path: Path, plant: Path) -> Iterator[Site]:
    """The small plant of exports, with a service's settings."""
    patient = SERVICE.replace("valve_timeout_s = 60", "valve_timeout_s = 600")
    plant.write_text(patient + plant.read_text(encoding="utf-8"), encoding="utf-8")
    with site_in(tmp_path) as created:
        yield created


@contextmanager
def strangers(address: str, count: int) -> Iterator[None]:
    """``count`` connections with half a header each, opened again as soon as they are closed."""
    place = (urlsplit(address).hostname, urlsplit(address).port)
    links: list[socket.socket] = []
    stop = threading.Event()

    def keep_open() -> None:
        while not stop.is_set():
            for link in list(links):
                with suppress(BlockingIOError):
                    try:
                        removed = link.recv(1000) is not None
                    except ConnectionError:
                        removed = True
                    if removed:
                        link.close()
                        links.remove(link)
            while len(links) < count and not stop.is_set():
                link = socket.socket()
                links.append(link)
                with suppress(OSError):
                    link.settimeout(1.0)
                    link.connect(place)
                    link.sendall(HALF_A_HEADER)
                link.setblocking(False)
            stop.wait(0.2)

    thread = threading.Thread(target=keep_open)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()
        for link in links:
            link.close()


def under_siege(
    site: Site, *, descriptors: int, connections: int, runs: int, seconds: float
) -> None:
    """Pages answer and every run is done while strangers hold as many connections as they get."""
    process, address = site.serve(descriptors=descriptors)
    started = time.monotonic()
    with site.store() as store, strangers(address, connections):
        for _ in range(runs):
            number = store.queue.put(
                RunToQueue(valves=("FIC-104",), who="Ann"), software_version="1"
            )

            def over(number: int = number) -> bool:
                requested = time.monotonic()
                assert get(f"{address}valve?id=FIC-104")[0] == 200
                assert time.monotonic() - requested < PATIENCE_S
                time.sleep(0.5)
                return store.run(number).finished is not None

            until(over, seconds=400, site=site)
            run = store.run(number)
            assert (run.state, run.done, run.set_aside) == (RunState.DONE, 1, 0), site.log()
        while time.monotonic() - started < seconds:
            assert get(address)[0] == 200
            time.sleep(0.5)
    assert process.poll() is None
    assert len(site.log()) < 20_000, site.log()[:5000]
    assert "Traceback" not in site.log()
    assert "the most that pages may have" in site.log()


@pytest.mark.long
def test_idle_connections_stop_neither_pages_nor_runs(csv_site: Site) -> None:
    """More connections with half a header than the service may open descriptors."""
    under_siege(csv_site, descriptors=256, connections=300, runs=1, seconds=5)


@pytest.mark.long
@pytest.mark.study
def test_idle_connections_stop_nothing_for_minutes(csv_site: Site) -> None:
    """The same at the descriptors that Linux gives a process, with run after run."""
    under_siege(csv_site, descriptors=1024, connections=1100, runs=6, seconds=120)


@pytest.mark.parametrize("megabytes", [32, pytest.param(600, marks=pytest.mark.long)])
def test_nobody_fills_the_memory_without_a_login(csv_site: Site, megabytes: int) -> None:
    """A body whose length is given twice is not kept, however long it is."""
    process, address = csv_site.serve()
    get(address)
    before = memory_mb(process.pid)
    place = (urlsplit(address).hostname, urlsplit(address).port)
    with socket.create_connection(place, timeout=PATIENCE_S) as link, suppress(ConnectionError):
        link.sendall(LONG_BODY)
        for _ in range(16 * megabytes):
            link.sendall(CHUNK)
        assert link.recv(12) == b"HTTP/1.1 400"
    assert memory_mb(process.pid) < before + 16
    assert get(address)[0] == 200


def memory_mb(process: int) -> float:
    """Resident memory of a process."""
    status = Path(f"/proc/{process}/status")
    if not status.exists():
        pytest.skip("this system has no /proc to read a process' memory from")
    match = re.search(r"VmRSS:\s+(\d+) kB", status.read_text())
    assert match is not None
    return int(match[1]) / 1024
