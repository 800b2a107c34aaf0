"""A run that Ctrl-C or SIGTERM interrupts is over with the reason, wherever it was."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any
from unittest.mock import patch

import pytest

from stemwatch.models.recording import Role
from stemwatch.service import interruption
from stemwatch.service.executors.executor import Answer, Failure, Item, Result
from stemwatch.service.interruption import (
    SAME_REQUEST_S,
    ending_on_signals,
    interrupts_held,
    interrupts_let_through,
)
from stemwatch.service.run.engine import NothingScreened, RunNow, screen_now
from stemwatch.service.run.plan import Request
from stemwatch.service.store.errors import StoreError
from stemwatch.service.store.screenings.records import RunState
from stemwatch.service.store.store import Store, open_store

pytestmark = pytest.mark.skipif(os.name == "nt", reason="signals are sent the POSIX way")

REASON = {signal.SIGINT: "interrupted by Ctrl-C", signal.SIGTERM: "ended by SIGTERM"}


class AllFail:
    """An executor that gives every valve up at once, so that a run is over in no time."""

    workers = 1

    def hand_out(
        self,
        work: Callable[[Sequence[Item]], Sequence[Result]],
        batches: Iterable[Sequence[Item]],
        stop: threading.Event,
        *,
        alone: bool = False,
    ) -> Generator[Answer[Result]]:
        for index, _ in enumerate(batches):
            yield Answer(index=index, failure=Failure(reason="nobody is at work"))


@dataclass
class SignalAtLine:
    """A trace function that sends this process a signal before the ``number``-th line that runs
    from the beginning of the run's row on; ``lines`` are those that ran."""

    number: int
    sent: signal.Signals = signal.SIGINT
    lines: list[str] = field(default_factory=list)
    ended_before: bool = False  # the run was over by itself when it came
    dropped: bool = False  # it came in a finaliser, and was asked for again
    _over: bool = False  # its own error is on its way to where it is stored
    _stored: bool = False  # or was, or is being, stored

    def __call__(self, frame: FrameType, event: str, _arg: Any) -> Any:
        if not self.lines and frame.f_code.co_name != "begin_run":
            return self
        name = frame.f_code.co_name
        self._over = self._over or (event == "return" and name == "_screen_planned")
        self._stored = self._stored or name == "_note_end"
        if event == "line":
            self.lines.append(frame.f_code.co_filename)
            if len(self.lines) == self.number:
                waits = interruption._interrupts.held
                self.ended_before = self._stored or (self._over and waits)
                signal.raise_signal(self.sent)
        return self


def traced_run(request: Request, how: RunNow, at: SignalAtLine) -> BaseException | None:
    """What the run raised, with ``at`` called for each of its lines."""
    before = sys.gettrace()
    try:
        with ending_on_signals():
            ask_again = sys.unraisablehook

            def note(dropped: sys.UnraisableHookArgs) -> None:
                at.dropped = True
                ask_again(dropped)

            with patch.object(sys, "unraisablehook", note):
                sys.settrace(at)
                try:
                    screen_now(request, how)
                finally:
                    sys.settrace(before)
    except (KeyboardInterrupt, NothingScreened) as error:
        return error
    return None


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Store]:
    """A store in a file."""
    with open_store(f"sqlite:///{tmp_path / 'kept.db'}") as opened:
        yield opened


def prepared(store: Store, one_valve: Path, folder: Path) -> tuple[Request, RunNow]:
    """A run of one valve, in which everything that a run needs is imported."""
    tags = {Role.OP: "FIC-104.OP", Role.MV: "FIC-104.ZT"}
    request = Request(sources=(str(one_valve),), tags=tags)
    how = RunNow(store=store, executor=AllFail(), out=folder)
    with pytest.raises(NothingScreened):
        screen_now(request, how)
    return request, how


@pytest.mark.parametrize(
    ("sent", "every"),
    [
        pytest.param(signal.SIGINT, 1_499, marks=pytest.mark.long),
        (signal.SIGTERM, 2_503),
        pytest.param(signal.SIGINT, 61, marks=pytest.mark.long),
    ],
)
def test_wherever_it_is_interrupted_a_run_is_over_with_the_reason(
    store: Store, one_valve: Path, tmp_path: Path, sent: signal.Signals, every: int
) -> None:
    """From its row on, at every line of the engine and at some of the thousands beneath it."""
    request, how = prepared(store, one_valve, tmp_path)
    whole = SignalAtLine(0)
    assert isinstance(traced_run(request, how, whole), NothingScreened)
    engine = [n for n, file in enumerate(whole.lines, 1) if file.endswith("/service/run/engine.py")]
    for place in sorted({*engine, *range(1, len(whole.lines), every)}):
        at = SignalAtLine(place, sent)
        raised = traced_run(request, how, at)
        if len(at.lines) < place:
            continue  # caches made this run shorter than the first
        assert isinstance(raised, KeyboardInterrupt), place
        run = store.queue.recent(1)[0]
        assert run.finished is not None, place
        if at.ended_before or (at.dropped and run.state is RunState.FAILED):
            assert run.reason.startswith("NothingScreened"), place
        else:
            assert (run.state, run.reason) == (RunState.CANCELLED, REASON[sent]), place


def test_what_is_held_is_whole_before_the_interrupt_is_raised() -> None:
    """One within another, and at once again where it is let through."""
    done: list[str] = []

    def held() -> None:
        with interrupts_held():
            with interrupts_held():
                signal.raise_signal(signal.SIGINT)
                done.append("inner")
            done.append("outer")
            with interrupts_let_through():
                done.append("never")

    with ending_on_signals(), pytest.raises(KeyboardInterrupt):
        held()
    assert done == ["inner", "outer"]


def test_the_same_request_twice_is_one_and_a_later_one_does_not_wait() -> None:
    """A terminal and a supervisor both pass Ctrl-C on; a person asks again when nothing happens."""
    done: list[str] = []

    def held() -> None:
        with interrupts_held():
            signal.raise_signal(signal.SIGINT)
            signal.raise_signal(signal.SIGTERM)
            done.append("held")
            with patch.object(time, "monotonic", lambda: clock + 2 * SAME_REQUEST_S):
                signal.raise_signal(signal.SIGINT)
            done.append("never")

    clock = time.monotonic()
    with ending_on_signals(), pytest.raises(KeyboardInterrupt):
        held()
    assert done == ["held"]


def test_other_threads_hold_nothing() -> None:
    """Signals are raised in the main thread alone; a transaction of another must not delay them."""
    holding, over = threading.Event(), threading.Event()

    def hold() -> None:
        with interrupts_held():
            holding.set()
            over.wait(60)

    thread = threading.Thread(target=hold)
    thread.start()
    try:
        assert holding.wait(60)
        with ending_on_signals(), pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    finally:
        over.set()
        thread.join()


def test_an_end_that_cannot_be_stored_is_said(
    store: Store, one_valve: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """The reason of the run remains what it was; the database's stands in the log."""
    request, how = prepared(store, one_valve, tmp_path)
    refusal = StoreError("the database is locked")
    with (
        patch.object(store.queue, "finish", side_effect=refusal),
        pytest.raises(NothingScreened),
    ):
        screen_now(request, how)
    assert "which could not be stored: the database is locked" in caplog.text
