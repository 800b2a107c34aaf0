"""Rules for every child process: no traceback on Ctrl-C while it starts, and an end with its
parent; and how worker processes are created.

A terminal sends Ctrl-C to the whole process group. A process that is still importing would print a
traceback, and one whose parent was killed would wait for work for ever.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from multiprocessing import resource_tracker
from multiprocessing.connection import wait
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from multiprocessing.context import ForkServerContext, SpawnContext

_ORPHANED = 3
PRELOADED = "stemwatch.service.executors.worker_preload"


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
        with quiet_start():
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
def quiet_start() -> Iterator[None]:
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
