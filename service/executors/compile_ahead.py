"""Compiling the numba kernels in workers while other work is done.

On the first run on a machine, compiling takes about half a minute of processor time. Workers that
start together would all compile the same kernels; here two workers compile one half each, and later
ones find them in numba's cache. If they are in the cache already, this is quick.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Generator
from contextlib import closing, contextmanager

from stemwatch.models.compile_kernels import OF_A_SCREENING, compile_kernels
from stemwatch.service.executors.executor import Executor
from stemwatch.service.executors.in_process import InProcess

log = logging.getLogger(__name__)


@contextmanager
def compile_ahead(executor: Executor) -> Generator[None]:
    """Compile in the workers of ``executor`` during the block, and wait for them at its end.

    An executor in this process compiles when needed instead. Errors are only logged: they are
    raised again where the kernels are used.
    """
    if isinstance(executor, InProcess):
        yield
        return
    stop = threading.Event()
    compiling = threading.Thread(
        target=_compile, args=(executor, stop), name="compiling", daemon=True
    )
    compiling.start()
    try:
        yield
        compiling.join()
    finally:
        stop.set()


def _compile(executor: Executor, stop: threading.Event) -> None:
    batches = [[part] for part in OF_A_SCREENING]
    try:
        with closing(executor.hand_out(compile_kernels, batches, stop)) as answers:
            failures = [answer.failure for answer in answers if answer.failure is not None]
    except OSError as error:  # no worker could be started: the run itself will report it
        log.warning("kernels could not be compiled ahead: %s", error)
        return
    for failure in failures:
        log.warning("kernels could not be compiled ahead: %s", failure.reason)
