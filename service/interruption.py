"""Ctrl-C and SIGTERM end a command wherever it is, but not in the middle of a transaction.

Python raises ``KeyboardInterrupt`` between any two instructions of the main thread. Raised inside a
commit, it leaves a connection that keeps the lock of the database. Raised just after one, it leaves
a run that nobody ends. Raised in a finaliser or a C callback, it is dropped. So code that must not
be interrupted runs inside ``interrupts_held``: a signal waits until the end of the block, and a
dropped one is raised again.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

INTERRUPTED = 128 + 2  # the status of a command that Ctrl-C ended
TERMINATED = 128 + 15  # the status of a command that SIGTERM ended
# A terminal, a shell and a supervisor may each pass on the same Ctrl-C.
SAME_REQUEST_S = 1.0
_ASK_AGAIN_S = 0.05


class Terminated(KeyboardInterrupt):
    """SIGTERM, handled in the same way as Ctrl-C."""


class _Interrupts:
    """Signals that are held back. Only the main thread, in which Python runs signal handlers, uses
    this object."""

    def __init__(self) -> None:
        self.held = False
        self.waiting: KeyboardInterrupt | None = None
        self.terminated = False
        self._asked_s = -SAME_REQUEST_S  # on the clock of time.monotonic()
        self._asking: threading.Timer | None = None

    def take(self, number: int, _frame: FrameType | None) -> None:
        """The handler of both signals: raise, or wait until the end of a held block.

        A second signal later than ``SAME_REQUEST_S`` raises at once: the user does not want to
        wait, for example for a database that does not answer.
        """
        interrupt = Terminated() if number == signal.SIGTERM else KeyboardInterrupt()
        self.terminated = self.terminated or isinstance(interrupt, Terminated)
        dropped, self._asking = self._asking is not None, None
        now_s = time.monotonic()
        if now_s - self._asked_s < SAME_REQUEST_S and not dropped:
            return
        self._asked_s = now_s
        if self.held and (dropped or self.waiting is None):
            self.waiting = interrupt
            return
        self.waiting = None
        raise interrupt

    def ask_again(self, dropped: KeyboardInterrupt) -> None:
        """Raise what Python has dropped a moment later, or at the end of a held block."""
        number = signal.SIGTERM if isinstance(dropped, Terminated) else signal.SIGINT
        self.waiting = dropped
        self._asking = threading.Timer(_ASK_AGAIN_S, os.kill, (os.getpid(), number))
        self._asking.daemon = True
        self._asking.start()

    def raise_waiting(self) -> None:
        """Raise what was held back or dropped."""
        interrupt, self.waiting = self.waiting, None
        if self._asking is not None:
            self._asking.cancel()
            self._asking = None
        if interrupt is not None:
            raise interrupt


_interrupts = _Interrupts()


@contextmanager
def ending_on_signals() -> Iterator[None]:
    """In this block SIGTERM raises ``Terminated`` and Ctrl-C ``KeyboardInterrupt`` in the main
    thread, once for each request. SIGTERM does so whatever handler was inherited; Ctrl-C, which
    background jobs of a script ignore, remains ignored where it was."""
    global _interrupts
    if not _in_main_thread():
        yield  # only the main thread receives signals
        return
    _interrupts = _Interrupts()
    before = {signal.SIGTERM: signal.signal(signal.SIGTERM, _interrupts.take)}
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        before[signal.SIGINT] = signal.signal(signal.SIGINT, _interrupts.take)
    previous_hook = sys.unraisablehook

    def ask_again(dropped: sys.UnraisableHookArgs) -> None:
        """Python drops what is raised in a finaliser or a callback of C."""
        if isinstance(dropped.exc_value, KeyboardInterrupt):
            _interrupts.ask_again(dropped.exc_value)
        else:
            previous_hook(dropped)

    sys.unraisablehook = ask_again
    try:
        yield
    finally:
        try:
            _interrupts.raise_waiting()
        finally:
            sys.unraisablehook = previous_hook
            for number, handler in before.items():
                signal.signal(number, handler)


@contextmanager
def interrupts_held() -> Iterator[None]:
    """The block is not interrupted: Ctrl-C and SIGTERM are raised at its end.

    Without effect outside the main thread, where no signal is raised.
    """
    yield from _with_held(True)


@contextmanager
def interrupts_let_through() -> Iterator[None]:
    """Inside ``interrupts_held``: Ctrl-C and SIGTERM are raised at once again, and what was held
    back so far is raised now."""
    yield from _with_held(False)


def _with_held(held: bool) -> Iterator[None]:
    if not _in_main_thread():
        yield
        return
    interrupts, before = _interrupts, _interrupts.held
    try:
        interrupts.held = held
        if not held:
            interrupts.raise_waiting()
        yield
    finally:
        interrupts.held = before
        if not before:
            interrupts.raise_waiting()


def _in_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()


def is_interrupt(error: BaseException) -> bool:
    """Whether Ctrl-C or SIGTERM raised ``error``: as it is, or through a compiled function, which
    makes a ``SystemError`` of what is raised between its end and its caller."""
    through_compiled = isinstance(error, SystemError) and error.__cause__ is not None
    return isinstance(error.__cause__ if through_compiled else error, KeyboardInterrupt)


def terminated() -> bool:
    """Whether this command received SIGTERM."""
    return _interrupts.terminated
