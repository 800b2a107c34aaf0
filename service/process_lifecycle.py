"""What every process of ours keeps to: quiet on Ctrl-C while it starts, in order on SIGTERM, gone
with its parent; where workers come from; and whether a process that wrote its name has ended.

A terminal sends Ctrl-C to the whole group. A process that is still importing would answer it with a
traceback, and one whose parent was killed would wait for work, or work on, for ever.
"""

from __future__ import annotations

import hashlib
import multiprocessing
import os
import signal
import socket
import sys
import threading
import uuid
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from multiprocessing import resource_tracker
from multiprocessing.connection import wait
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from multiprocessing.context import ForkServerContext, SpawnContext

_ORPHANED = 3
_terminated = threading.Event()
INTERRUPTED = 128 + 2  # the status of a command that Ctrl-C ended
TERMINATED = 128 + 15  # the status of a command that SIGTERM ended
PRELOADED = "stemwatch.service.executors.worker_preload"


def worker_context() -> SpawnContext | ForkServerContext:
    """Where worker processes come from.

    On Linux they are forked from a server of ours that has one thread and has imported what they
    need: a fork of this process would inherit locks that its threads hold, and a spawned process
    imports for seconds. Elsewhere they are spawned.
    """
    if sys.platform != "linux":
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([PRELOADED])
    return context


def expect_workers() -> None:
    """Let the server of the workers begin with its imports, beside whatever is done here until
    they are needed: both take seconds of a core."""
    if sys.platform == "linux":
        from multiprocessing import forkserver

        worker_context()
        with quiet_start():
            forkserver.ensure_running()


def environment() -> dict[str, str]:
    """The environment that a worker is to have: the server that it comes from has an older one."""
    return dict(os.environ)


def take_environment(environment: Mapping[str, str]) -> None:
    """Have the ``environment`` of the process that asked for this one."""
    for name in os.environ.keys() - environment.keys():
        del os.environ[name]
    os.environ.update(environment)


@contextmanager
def quiet_start() -> Iterator[None]:
    """Processes started here by this thread keep Ctrl-C waiting until ``take_signals``."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows, where nothing is inherited
        yield
        return
    # Python starts its tracker with the first process, and lets Ctrl-C through again after that.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def begin_child(*, ignore: tuple[signal.Signals, ...] = ()) -> None:
    """What a started process does first: ``take_signals`` and ``end_with_parent``."""
    take_signals(ignore)
    end_with_parent()


def take_signals(ignore: tuple[signal.Signals, ...] = ()) -> None:
    """Ignore these signals, and end at once on Ctrl-C and SIGTERM where they are not among them."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    for number in ignore:
        signal.signal(number, signal.SIG_IGN)
    if hasattr(signal, "pthread_sigmask"):
        # Only now: what came meanwhile is met by what was just said.
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT, signal.SIGTERM})


def end_with_parent() -> None:
    """End this process as soon as the one that started it is gone, whatever it is doing."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        watch = threading.Thread(target=_until_gone, args=(parent.sentinel,), daemon=True)
        watch.start()


def _until_gone(sentinel: int) -> None:
    wait([sentinel])
    os._exit(_ORPHANED)  # nobody is left to whom anything could be told


class Terminated(KeyboardInterrupt):
    """SIGTERM: whatever is done is ended in the way in which Ctrl-C ends it."""


@contextmanager
def ending_on_sigterm() -> Iterator[None]:
    """Have SIGTERM raise ``Terminated`` in the main thread, whatever was inherited: a script's
    background job ignores Ctrl-C, so that SIGTERM cannot be handed on as that."""

    def end(*_: object) -> None:
        _terminated.set()
        raise Terminated

    if threading.current_thread() is not threading.main_thread():
        yield  # only that one hears of signals
        return
    before = signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def terminated() -> bool:
    """Whether SIGTERM asked this command to end."""
    return _terminated.is_set()


def process_name() -> str:
    """The name under which this process has duties: its machine, its number, when it began and
    where its number counts, and a part that no other name has."""
    pid = os.getpid()
    return f"{socket.gethostname()}:{pid}:{_began(pid)}:{_place()}:{uuid.uuid4().hex[:8]}"


def has_ended(name: str) -> bool:
    """Whether the process of this ``process_name`` is known to have ended.

    Only of a process of this machine, since its last start, can that be known; a number that was
    given to another process since is told by when that one began.
    """
    parts = name.rsplit(":", 4)
    if len(parts) != 5 or not parts[2].isdigit() or not parts[1].isdigit():
        return False
    host, pid, began, place, _ = parts
    if host != socket.gethostname() or not place or place != _place():
        return False
    return _began(int(pid)) != began


def _began(pid: int) -> str:
    """When a process began, in ticks since the machine's start; empty where there is none, or
    where the system does not say."""
    try:
        said = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""
    fields = said.rpartition(")")[2].split()  # the program's name may hold blanks
    return "" if fields[0] in ("Z", "X") else fields[19]


def _place() -> str:
    """This start of this machine, and the container: elsewhere the same number is another."""
    try:
        boot = Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii")
        return hashlib.sha256((boot + os.readlink("/proc/self/ns/pid")).encode()).hexdigest()[:12]
    except OSError:
        return ""
