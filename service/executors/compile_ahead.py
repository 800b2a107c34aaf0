"""Kernels compiled beside other work, before the workers that need them begin.

The first run on a machine compiles for half a minute of a core. Workers that begin together would
all compile the same kernels; here each of two compiles other ones, and whoever needs them later
finds them in the compiler's cache. Where they are there already, this takes a moment.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Generator, Sequence
from contextlib import closing, contextmanager
from enum import Enum, auto

import numpy as np

from stemwatch.models.recording import Recording, Role, Signal
from stemwatch.service.executors.executor import Executor
from stemwatch.service.executors.in_process import InProcess

log = logging.getLogger(__name__)


class Kernels(Enum):
    """The kernels of a screening in two parts that take about as long to compile."""

    FITS = auto()  # the quick fit and the networks
    MISMATCH = auto()  # what they leave out


@contextmanager
def compile_ahead(executor: Executor) -> Generator[None]:
    """Compile in the workers of ``executor``, meanwhile; at the end it is waited for.

    One that works in this process has nobody to do it meanwhile, and compiles when it needs to.
    What does not compile here fails where it is needed, with the recording that it is needed for.
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
    batches = [[part] for part in Kernels]
    try:
        with closing(executor.hand_out(compile_kernels, batches, stop)) as answers:
            failures = [answer.failure for answer in answers if answer.failure is not None]
    except OSError as error:  # no worker could be started: whoever needs one will say so
        log.warning("kernels could not be compiled ahead: %s", error)
        return
    for failure in failures:
        log.warning("kernels could not be compiled ahead: %s", failure.reason)


def compile_kernels(parts: Sequence[Kernels]) -> list[Kernels]:
    """Compile ``parts`` in this process, by using them once."""
    from stemwatch.models.mismatch.explain import explain
    from stemwatch.models.screening import Case, Options, screen

    for part in parts:
        if part is Kernels.FITS:
            screen([Case(recording=short_recording())], Options(mismatch=False))
        else:
            explain(short_recording())
    return list(parts)


def short_recording() -> Recording:
    """Ten minutes of a valve that sticks and reads with noise: all kernels are needed."""
    n, stick, jump = 600, 4.0, 2.0  # samples, percent, percent
    at = np.arange(n)
    op = 50.0 + 15.0 * np.sin(2.0 * np.pi * at / 97.0) + 3.0 * np.sin(2.0 * np.pi * at / 31.0)
    mv, stem = np.empty(n), float(op[0])
    for k, command in enumerate(op):
        if abs(command - stem) > stick:
            stem = command - np.sign(command - stem) * (stick - jump)
        mv[k] = stem
    mv += np.random.default_rng(1).normal(0.0, 0.1, n)
    signals = {Role.OP: Signal.good(op, "OP"), Role.MV: Signal.good(mv, "MV")}
    return Recording(valve="made up", signals=signals, interval_s=1.0)
