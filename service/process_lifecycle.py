"""What every process that we start keeps to: quiet on Ctrl-C while it starts, gone with its parent;
and where workers come from.

A terminal sends Ctrl-C to the whole group. A process that is still importing would answer it with a
traceback, and one whose parent was killed would wait for work, or work on, for ever.
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
