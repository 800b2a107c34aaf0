"""Process lifecycle: no traceback on Ctrl-C while starting, an orderly end, an end with the parent;
how workers are created; and whether the process with a stored name has ended.

A terminal sends Ctrl-C to the whole process group. A process that is still importing would print a
traceback, and one whose parent was killed would wait for work for ever.
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
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from multiprocessing import resource_tracker
from multiprocessing.connection import wait
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from multiprocessing.context import ForkServerContext, SpawnContext

_ORPHANED = 3
_ENDING = (signal.SIGINT, signal.SIGTERM)
_ASKED = b"1"
PRELOADED = "stemwatch.service.run.worker_preload"


def worker_context() -> SpawnContext | ForkServerContext:
    """The multiprocessing context of worker processes.

    On Linux workers are forked from a server process that has one thread and has imported what they
    need: a fork of this process would inherit locks held by its threads, and a spawned process
    takes seconds to import. On other systems they are spawned.
    """
    if sys.platform != "linux":
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([PRELOADED])
    return context


def expect_workers() -> None:
    """Start the server process of the workers early, so that its imports, which take seconds, run
    beside those of this process."""
    if sys.platform == "linux":
        from multiprocessing import forkserver

        worker_context()
        with starting_quietly():
            forkserver.ensure_running()


def environment() -> dict[str, str]:
    """The environment for a worker; the server process that it is forked from has an older one."""
    return dict(os.environ)


def take_environment(environment: Mapping[str, str]) -> None:
    """Replace this process's environment by that of the process that requested it."""
    for name in os.environ.keys() - environment.keys():
        del os.environ[name]
    os.environ.update(environment)


@contextmanager
def starting_quietly() -> Iterator[None]:
    """Processes that this thread starts in the block hold back Ctrl-C until ``take_signals``."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows, where nothing is inherited
        yield
        return
    # Python starts its resource tracker with the first process and unblocks SIGINT afterwards.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def begin_child(*, ignore: tuple[signal.Signals, ...] = ()) -> None:
    """To be called first in a child process: ``take_signals`` and ``end_with_parent``."""
    take_signals(ignore)
    end_with_parent()


def take_signals(ignore: tuple[signal.Signals, ...] = ()) -> None:
    """Ignore these signals; otherwise Ctrl-C and SIGTERM end the process at once."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    for number in ignore:
        signal.signal(number, signal.SIG_IGN)
    if hasattr(signal, "pthread_sigmask"):
        # Last, so that a signal held back meanwhile meets the new handlers.
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT, signal.SIGTERM})


def end_with_parent() -> None:
    """End this process as soon as its parent process has ended, whatever it is doing."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        watch = threading.Thread(target=_until_gone, args=(parent.sentinel,), daemon=True)
        watch.start()


def _until_gone(sentinel: int) -> None:
    wait([sentinel])
    os._exit(_ORPHANED)  # without clean-up: the parent is gone


@contextmanager
def on_stop_signal(stop: Callable[[], object], *, last: bool = False) -> Iterator[None]:
    """SIGTERM and Ctrl-C call ``stop``, once, from a thread of its own.

    A handler interrupts the main thread anywhere: if it set an event whose lock the main thread
    holds at that moment, both would wait for ever. Where this is the ``last`` thing that the
    process does, a repeated signal does not disturb its end.
    """
    if threading.current_thread() is not threading.main_thread():
        yield  # only the main thread receives signals
        return
    reader, writer = os.pipe()

    def wait_and_stop() -> None:
        if os.read(reader, 1) == _ASKED:
            stop()

    def on_signal(*_: object) -> None:
        if not written:
            written.append(os.write(writer, _ASKED))

    written: list[int] = []
    heard = threading.Thread(target=wait_and_stop, name="stop", daemon=True)
    heard.start()
    before = {number: signal.signal(number, on_signal) for number in _ENDING}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, signal.SIG_IGN if last else handler)
        os.write(writer, b"0")
        heard.join()
        os.close(reader)
        os.close(writer)


def process_name() -> str:
    """The name of this process in leases and runs: host, process id, start time, boot and
    container, and a random part."""
    pid = os.getpid()
    boot = _boot_and_container()
    return f"{socket.gethostname()}:{pid}:{_start_time(pid)}:{boot}:{uuid.uuid4().hex[:8]}"


def has_ended(name: str) -> bool:
    """Whether the process with this ``process_name`` is known to have ended.

    That can be known only for processes of this machine since its last boot; a process id that was
    reused is recognised by its start time.
    """
    parts = name.rsplit(":", 4)
    if len(parts) != 5 or not parts[2].isdigit() or not parts[1].isdigit():
        return False
    host, pid, start_time, boot, _ = parts
    if host != socket.gethostname() or not boot or boot != _boot_and_container():
        return False
    return _start_time(int(pid)) != start_time


def _start_time(pid: int) -> str:
    """The start of a process in ticks since boot; empty where there is no such process or the
    system does not tell."""
    try:
        stat = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""
    fields = stat.rpartition(")")[2].split()  # the program's name may hold blanks
    return "" if fields[0] in ("Z", "X") else fields[19]


def _boot_and_container() -> str:
    """Identifies this boot of this machine and the container, within which process ids count."""
    try:
        boot = Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii")
        return hashlib.sha256((boot + os.readlink("/proc/self/ns/pid")).encode()).hexdigest()[:12]
    except OSError:
        return ""
