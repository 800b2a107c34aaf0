"""Commands that run until they are stopped end in order, whenever and however often asked."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from stemwatch.service.interruption import Terminated, ending_on_signals
from stemwatch.service.process_lifecycle import on_stop_signal
from tests.service.live_demo.running_demo import DEMO, Started

SIMULATE = ("simulate", "--modbus", "--what", "healthy", "--count", "1", "--port", "0")
ENDING = [signal.SIGTERM, signal.SIGINT]


@pytest.fixture(autouse=True)
def handlers_as_before() -> Iterator[None]:
    """The handlers of this process are those of the test runner again."""
    before = {number: signal.getsignal(number) for number in ENDING}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize("number", ENDING, ids=["SIGTERM", "SIGINT"])
def test_a_signal_while_the_event_is_locked_stops_all_the_same(number: signal.Signals) -> None:
    """The main thread may be just about to wait for the event that says stop."""
    stop = threading.Event()
    with on_stop_signal(stop.set):
        with getattr(stop, "_cond"):  # noqa: B009
            signal.raise_signal(number)
        assert stop.wait(60)


def test_being_asked_again_and_again_stops_once() -> None:
    """Also when all is being cleared away, and afterwards."""
    requested: list[int] = []
    over = threading.Event()

    def stop() -> None:
        requested.append(1)
        over.set()

    with on_stop_signal(stop, last=True):
        for _ in range(5):
            signal.raise_signal(signal.SIGTERM)
            signal.raise_signal(signal.SIGINT)
        assert over.wait(60)
    signal.raise_signal(signal.SIGINT)
    assert requested == [1]


def test_without_being_asked_nothing_is_stopped() -> None:
    """What ends by itself ends."""
    requested: list[int] = []
    with on_stop_signal(lambda: requested.append(1)):
        pass
    assert requested == []


class Late:
    """Something whose clearing away is where the signal arrives."""

    def __init__(self, number: signal.Signals) -> None:
        self.number = number

    def __del__(self) -> None:
        signal.raise_signal(self.number)


@pytest.mark.parametrize(
    ("number", "raised"), [(signal.SIGTERM, Terminated), (signal.SIGINT, KeyboardInterrupt)]
)
def test_an_end_that_a_finaliser_loses_is_asked_for_again(
    number: signal.Signals, raised: type[KeyboardInterrupt]
) -> None:
    """Python drops exceptions there, and a command that lost its signal would never end."""
    with ending_on_signals(), pytest.raises(raised):
        _lose_it_and_wait(number)


def test_a_signal_that_a_compiled_function_met_ends_the_command_too() -> None:
    """Python makes a SystemError of what is raised between its end and its caller."""
    code = (
        "import stemwatch.service.cli as cli\n"
        "from stemwatch.service.interruption import Terminated\n"
        "def app(): raise SystemError('a result with an exception set') from Terminated()\n"
        "cli.app = app\n"
        "cli.main()\n"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (ended.returncode, ended.stderr) == (130, "")


@pytest.mark.long
@pytest.mark.parametrize(("number", "status"), [(signal.SIGTERM, 143), (signal.SIGINT, 130)])
def test_a_signal_before_the_command_begins_ends_it_without_a_traceback(
    number: signal.Signals, status: int
) -> None:
    """While the command line is put together nobody else catches it."""
    code = (
        "import signal, stemwatch.service.cli as cli\n"
        f"cli.app = lambda: signal.raise_signal({int(number)})\n"
        "cli.main()\n"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (ended.returncode, ended.stderr) == (status, "")


def _lose_it_and_wait(number: signal.Signals) -> None:
    late = Late(number)
    del late
    time.sleep(60)


@contextmanager
def busy(loops: int) -> Iterator[None]:
    """So many processes that only use up time."""
    command = [sys.executable, "-c", "while True: pass"]
    started = [subprocess.Popen(command) for _ in range(loops)]
    try:
        yield
    finally:
        for process in started:
            process.kill()
            process.wait()


COMMANDS = {
    "simulate --modbus": (SIMULATE, "Modbus on", 8),
    "demo --live": (DEMO, "http://", 2),
}


@pytest.mark.long
@pytest.mark.parametrize("number", ENDING, ids=["SIGTERM", "SIGINT"])
@pytest.mark.parametrize("name", COMMANDS)
def test_again_and_again_beside_other_work_it_ends_with_its_status(
    tmp_path: Path, name: str, number: signal.Signals
) -> None:
    """Asked twice, as impatient people do, a little later each time."""
    command, ready, turns = COMMANDS[name]
    with busy(1):
        for turn in range(turns):
            running = Started(tmp_path / str(turn), command)
            running.said(ready)
            time.sleep(turn * 0.05)
            os.kill(running.process.pid, number)
            os.kill(running.process.pid, number)
            status = running.process.wait(timeout=300)
            assert status == 0, running.everything()
            assert "Traceback" not in running.everything()
