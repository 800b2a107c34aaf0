"""The service under faults: devices cut off and silent, the database stopped, the service killed.

The device notes each of its answers. At the end every one of them is in the store once, nothing
else is there as good, every instant at which the service ran has its sample, and every instant of
the schedule is accounted for. ``STEMWATCH_FAULT_ROUNDS`` repeats the faults.
"""

from __future__ import annotations

import asyncio
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from stemwatch.models.studies.simulator import demo_plant
from stemwatch.service.modbus_plant.live import LivePlant
from stemwatch.service.modbus_plant.plant_file import plant_toml
from stemwatch.service.modbus_plant.plant_server import PlantServer
from stemwatch.service.modbus_plant.register_layout import PLACE, STRIDE
from stemwatch.service.modbus_plant.register_layout import tag as tag_of
from stemwatch.service.store.errors import StoreError
from stemwatch.service.store.samples.samples import TagSamples as Samples
from stemwatch.service.store.screenings.records import RunState
from stemwatch.service.store.store import Store, open_store

ROUNDS = int(os.environ.get("STEMWATCH_FAULT_ROUNDS", "1"))
EVERY_US = 100_000
SERVE = "import typer; from stemwatch.service.cli.serve import serve; typer.run(serve)"
SETTINGS = """
[service]
workers = 1
window_s = 30
[[schedules]]
name = "often"
every_s = 10
"""
_RECONNECT_S = 16.0  # the longest that a device which is back is left alone
_LATEST_S = 1.5  # from an instant to its answer: 0.25 s to begin, 1 s to be answered
VALVES = ("FIC-101", "TIC-102")
TagSamples = tuple[float, float]
Answer = tuple[float, tuple[int, ...]]  # when, and all registers of the device


class Database:
    """A PostgreSQL server of our own, which can be stopped and started."""

    def __init__(self, programs: Path) -> None:
        self._programs = programs
        self._user = "postgres" if os.geteuid() == 0 else None
        self.folder = Path(tempfile.mkdtemp(prefix="stemwatch-pg-"))
        self.folder.chmod(0o755)
        if self._user:
            shutil.chown(self.folder, self._user)
        self._do("initdb", "-U", "postgres", "-A", "trust", "--no-sync")
        self.url = f"postgresql://postgres@/postgres?host={self.folder}"

    def start(self, after_s: float = 0.0) -> None:
        """Start after a while, and wait until it answers."""
        time.sleep(after_s)
        options = f"-F -k {self.folder} -c listen_addresses="
        self._do("pg_ctl", "-w", "-l", str(self.folder / "log"), "-o", options, "start")

    def reload(self) -> None:
        """Read the settings again."""
        self._do("pg_ctl", "reload")

    def stop(self) -> None:
        """Stop as a power cut does."""
        self._do("pg_ctl", "-m", "immediate", "stop")

    def _do(self, program: str, *arguments: str) -> None:
        subprocess.run(
            [str(self._programs / program), "-D", str(self.folder / "data"), *arguments],
            user=self._user,
            cwd="/",
            check=True,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )


class NotedServer(PlantServer):
    """A device that records each answer, and that can fall silent with its connections open."""

    def __init__(self, *arguments, served: list[Answer], silent: threading.Event, **options):
        super().__init__(*arguments, **options)
        self._served, self._silent = served, silent

    async def _answer(self, code, start, address, count, registers, values):
        while self._silent.is_set():
            await asyncio.sleep(0.05)
        text = await super()._answer(code, start, address, count, registers, values)
        self._served.append((time.time(), tuple(registers)))
        return text


class Device:
    """A simulated device on one port, which can be cut off; ``down`` says when it was, ``served``
    what it answered when."""

    def __init__(self) -> None:
        self.port = 0
        self.down: list[TagSamples] = []
        self.served: list[Answer] = []
        self._silent = threading.Event()
        self._loops = demo_plant(1)[:2]
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        """Answer from now on."""
        up, self._stop = threading.Event(), threading.Event()

        async def run() -> None:
            live = LivePlant(self._loops, wear=None, seed=1)
            noted = {"served": self.served, "silent": self._silent}
            async with NotedServer(live, "127.0.0.1", self.port, speed=10.0, **noted) as server:
                self.port = server.port
                up.set()
                await asyncio.to_thread(self._stop.wait)

        self._thread = threading.Thread(target=lambda: asyncio.run(run()))
        self._thread.start()
        assert up.wait(timeout=60)

    def stop(self) -> None:
        """Answer no more."""
        self._silent.clear()
        if self._thread is not None:
            self._stop.set()
            self._thread.join()
            self._thread = None

    def cut(self, seconds: float) -> None:
        """Be away for a while: every connection is closed and none is taken."""
        started = time.time()
        self.stop()
        time.sleep(seconds)
        self.start()
        self.down.append((started, time.time() + _RECONNECT_S))

    def hang(self, seconds: float) -> None:
        """Say nothing for a while, with every connection open."""
        started = time.time()
        self._silent.set()
        time.sleep(seconds)
        self._silent.clear()
        self.down.append((started, time.time() + _RECONNECT_S))

    def place(self, tag: str) -> int:
        """The first register of a tag."""
        return next(
            number * STRIDE + place
            for number, loop in enumerate(self._loops)
            for role, place in PLACE.items()
            if tag_of(loop, role) == tag
        )

    def plant_file(self) -> str:
        """The plant file that reads it."""
        return SETTINGS + plant_toml(self._loops, host="127.0.0.1", port=self.port, every_s=0.1)


class RestartedService:
    """The service as a process, started again when it was killed; ``dead`` says when it was."""

    def __init__(self, folder: Path, url: str) -> None:
        self.folder, self._url = folder, url
        self.port = 0  # of its pages
        self.dead: list[TagSamples] = []
        self.process: subprocess.Popen[str] | None = None

    def start(self) -> None:
        """Start the service and wait until it serves."""
        self.launch()
        self.wait()

    def launch(self) -> None:
        """Start the service, whether there is a database or not."""
        with (self.folder / "log.txt").open("a") as log:
            self.process = subprocess.Popen(
                [sys.executable, "-c", SERVE, "--port", "0"],
                cwd=self.folder,
                env={**os.environ, "OMP_NUM_THREADS": "1", "STEMWATCH_STORAGE_URL": self._url},
                stdout=subprocess.PIPE,
                stderr=log,
                text=True,
                start_new_session=True,
            )

    def wait(self) -> None:
        """Wait until it serves; before that it may have more to say."""
        for line in self.process.stdout:
            if served := re.search(r"Serving http://[^:]+:(\d+)", line):
                self.port = int(served[1])
                return
        pytest.fail(f"the service ended:\n{self.log()}")

    def kill(self, between: Callable[[], None] = lambda: None) -> None:
        """SIGKILL to the service and all its processes, and a new start; ``between`` is done while
        it starts."""
        started = time.time()
        self.end(signal.SIGKILL)
        self.launch()
        between()
        self.wait()
        self.dead.append((started, time.time()))

    def end(self, number: int) -> None:
        """End the service by a signal."""
        if self.process is not None:
            os.killpg(self.process.pid, number)
            self.process.wait(timeout=60)
            self.process.stdout.close()
            self.process = None

    def log(self) -> str:
        """What the service has said so far."""
        return (self.folder / "log.txt").read_text(encoding="utf-8")


def postgres_programs() -> Path:
    """The folder of PostgreSQL's server programs."""
    in_order = sorted(Path("/usr/lib/postgresql").glob("*/bin/initdb"))
    if on_path := shutil.which("initdb"):
        in_order.insert(0, Path(on_path))
    if not in_order:
        pytest.skip("no PostgreSQL server programs (initdb): the fault test IS NOT RUN")
    return in_order[-1].parent


@pytest.fixture
def database() -> Iterator[Database]:
    """A PostgreSQL server that runs."""
    result = Database(postgres_programs())
    result.start()
    try:
        yield result
    finally:
        result.stop()
        shutil.rmtree(result.folder, ignore_errors=True)


@pytest.fixture
def device() -> Iterator[Device]:
    """A device that answers."""
    result = Device()
    result.start()
    try:
        yield result
    finally:
        result.stop()


@pytest.mark.long
@pytest.mark.early
@pytest.mark.postgres
def test_faults_lose_no_sample_and_no_run(
    database: Database, device: Device, tmp_path: Path
) -> None:
    """Only samples that no running service could have seen are missing, and none is stored
    twice."""
    (tmp_path / "plant.toml").write_text(device.plant_file(), encoding="utf-8")
    service = RestartedService(tmp_path, database.url)
    started = time.time()
    service.start()
    try:
        with open_store(database.url) as store:
            until(lambda: store.samples.bounds("plc-1", "FIC-101.OP") is not None, service)
            for number in range(ROUNDS):
                every_fault_once(number, database, device, service, store)
            until(lambda: settled(store), service)
            service.end(signal.SIGTERM)
            ended = time.time()
            for tag in ("FIC-101.OP", "FIC-101.ZT", "TIC-102.PV"):
                check_samples(store, tag, service, device)
            check_runs(store, started, ended)
    finally:
        service.end(signal.SIGKILL)


def every_fault_once(
    number: int, database: Database, device: Device, service: RestartedService, store: Store
) -> None:
    """Every fault once; the service is killed with the database running and stopped in turn."""
    time.sleep(5)
    device.cut(2.0)
    time.sleep(2)
    device.hang(3.0)
    time.sleep(2)
    database.stop()
    time.sleep(5)
    if number % 2:
        service.kill(between=lambda: database.start(after_s=5.0))
        until(lambda: answers(store), service)
    else:
        database.start()
        until(lambda: answers(store), service)
        time.sleep(3)
        service.kill()
    time.sleep(5)


def check_samples(store: Store, tag: str, service: RestartedService, device: Device) -> None:
    """Each instant at which the service ran is stored once, with the device's values."""
    samples = store.samples.read("plc-1", tag)
    assert samples.at_us.size > 100, tag
    steps = np.diff(samples.at_us)
    assert (steps > 0).all()
    assert (samples.at_us % EVERY_US == 0).all()
    holes = [
        (samples.at_us[index] / 1e6, samples.at_us[index + 1] / 1e6)
        for index in np.flatnonzero(steps > EVERY_US)
    ]
    # Only while nobody polled: from the kill, with the poll that it interrupted, to the first poll
    # of the next collector. Neither the database nor the device leaves a hole.
    assert len(holes) <= len(service.dead), holes
    for started, end in holes:
        kill, served = min(service.dead, key=lambda dead: abs(dead[0] - started))
        assert kill - 0.3 <= started <= kill + 0.3, (tag, started, kill)
        assert end <= served + 15.0, (tag, end, served)
    bad = samples.at_us[samples.quality != 0] / 1e6
    known = device.down + holes
    lost = [at for at in bad if not inside((at, at), known)]
    # A poll that a busy machine could not make in time says so itself.
    late = store.samples.reasons("plc-1", tag)
    total = sum(count for why, count in late.items() if "not polled" in why or "no answer" in why)
    assert len(lost) <= total, late
    check_answers(samples, tag, service, device, total)


def check_answers(
    result: Samples, tag: str, service: RestartedService, device: Device, late: int
) -> None:
    """Every answer of the device is in the store once, and nothing else is there as good.

    An answer is on its way when the service is killed or the connection is cut; one that came
    after its time is a bad sample that says so, and no more than ``late`` of them are there.
    """
    missing, invented = compared(result, tag, service, device)
    assert len(missing) <= late, (tag, missing[:5])
    assert not invented, (tag, "not what the device said", invented[:5])


def compared(
    result: Samples, tag: str, service: RestartedService, device: Device
) -> tuple[list[tuple[float, float]], list[float]]:
    """Answers that are not in the store, and instants of good samples that were no answer."""
    good = result.quality == 0
    at_s, values = result.at_us[good] / 1e6, result.values[good]
    place = device.place(tag)
    free = np.ones(at_s.size, dtype=bool)
    missing = []
    for when, registers in device.served:
        words = np.array(registers[place : place + 2], dtype=">u2")
        value = float(words.view(">f4")[0])
        near = slice(*np.searchsorted(at_s, (when - _LATEST_S, when + 0.01)))
        same = np.flatnonzero(free[near] & (values[near] == value))
        if same.size:
            free[near.start + same[0]] = False
        elif not on_its_way(when, service, device):
            missing.append((when, value))
    return missing, at_s[free].tolist()


def on_its_way(when: float, service: RestartedService, device: Device) -> bool:
    """Whether an answer met a kill, or the moment in which the device closed its connections or
    spoke again to somebody who no longer waited."""
    kills = [kill for kill, _ in service.dead]
    cuts = [started for started, _ in device.down]
    back = [end - _RECONNECT_S for _, end in device.down]
    moments = [*kills, *cuts, *back]
    return any(abs(when - moment) < 0.5 for moment in moments)


def check_runs(store: Store, begun: float, ended: float) -> None:
    """Every instant of the schedule from first to last has a run, or is made up for by one that
    says so; every run is over or waits for the next start."""
    runs = sorted(store.queue.recent(1000, schedule="often"), key=lambda run: run.due)
    assert len(runs) >= 2
    for before, after in pairwise(runs):
        missed = round((after.due - before.due).total_seconds() / 10.0) - 1
        text = re.match(r"(\d+) instants? before it", after.reason)
        skipped = after.state is RunState.SKIPPED
        assert skipped or missed == (int(text[1]) if text else 0), (before, after)
    # The schedule begins when the service first opens the store, and ends with the service.
    assert begun - 10.0 <= runs[0].due.timestamp() <= begun + 60.0
    assert ended - 30.0 <= runs[-1].due.timestamp() <= ended
    assert [run for run in runs if run.state in (RunState.FAILED, RunState.CANCELLED)] == []
    left = [run for run in runs if run.state in (RunState.WAITING, RunState.RUNNING)]
    assert len(left) <= 1, left
    for run in left:  # those due after one that was not over are skipped
        later = runs[runs.index(run) + 1 :]
        assert all(after.state is RunState.SKIPPED for after in later), (run, later)
    done = [run for run in runs if run.state is RunState.DONE]
    assert done
    assert all(run.done == run.total == 2 for run in done)
    windows = [
        (valve, screening.window)
        for valve in VALVES
        for screening in store.screenings(valve, limit=1000)
    ]
    assert len(windows) == len(set(windows))
    assert len(windows) >= len(done), "each run that is done has its screenings"


def inside(stretch: TagSamples, known: list[TagSamples]) -> bool:
    return any(started <= stretch[0] and stretch[1] <= end for started, end in known)


def answers(store: Store) -> bool:
    try:
        store.queue.going()
    except StoreError:
        return False
    return True


def settled(store: Store) -> bool:
    """Whether the run that was interrupted is over and samples of now are in the store."""
    _, last = store.samples.bounds("plc-1", "FIC-101.OP")
    runs = store.queue.recent(3, schedule="often")
    over = any(run.state is RunState.DONE for run in runs)
    stale = [run for run in store.queue.going() if run.heartbeat is not None]
    return over and time.time() - last.timestamp() < 3.0 and len(stale) <= 1


def until(there, service: RestartedService, seconds: float = 120.0) -> None:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if there():
            return
        time.sleep(0.2)
    pytest.fail(f"it did not happen:\n{service.log()}")
