"""Compiling the numba kernels in workers while other work is done.

On the first run on a machine, compiling takes about half a minute of processor time. Workers that
start together would all compile the same kernels; here two workers compile one half each, and later
ones find them in numba's cache. If they are in the cache already, this is quick.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Generator, Sequence
from contextlib import closing, contextmanager
from enum import Enum, auto

import numpy as np

from stemwatch.models.recording import Floats, Recording, Role, Signal
from stemwatch.service.executors.executor import Executor
from stemwatch.service.executors.in_process import InProcess

log = logging.getLogger(__name__)


class Kernels(Enum):
    """The kernels of a screening, in two parts that take about equally long to compile."""

    FITS = auto()  # the quick fit and the networks
    MISMATCH = auto()  # the search for effects beside S and J


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
    batches = [[part] for part in Kernels]
    try:
        with closing(executor.hand_out(compile_kernels, batches, stop)) as answers:
            failures = [answer.failure for answer in answers if answer.failure is not None]
    except OSError as error:  # no worker could be started, which the run itself will report
        log.warning("kernels could not be compiled ahead: %s", error)
        return
    for failure in failures:
        log.warning("kernels could not be compiled ahead: %s", failure.reason)


def compile_kernels(parts: Sequence[Kernels]) -> list[Kernels]:
    """Compile ``parts`` in this process, by using them once."""
    from stemwatch.models.mismatch.explain import explain
    from stemwatch.models.screening import Case, Options, screen
    from stemwatch.models.without_position.hammerstein import element

    for part in parts:
        if part is Kernels.FITS:
            screen([Case(recording=short_recording())], Options(mismatch=False))
            op = short_recording().op.values.copy()  # to be written to, as where it is used
            element(op, 4.0, 2.0, np.empty_like(op))  # of loops with PV
            _run_a_loop(op)
        else:
            explain(short_recording())
    return list(parts)


def _run_a_loop(op: Floats) -> None:
    """Compile what runs the loop of a sticking valve again."""
    from stemwatch.models.closed_loop import kernel
    from stemwatch.models.closed_loop.process_model import process_model

    process_model(op, np.cumsum(op - op.mean()))
    signals = (np.empty_like(op) for _ in range(3))
    kernel.run_loop(op, op, op, np.ones(kernel.N_NUMBERS), np.zeros(2), op, *signals)


def short_recording() -> Recording:
    """Ten minutes of a sticking valve with noise, for which all kernels are needed."""
    n, stick, jump = 600, 4.0, 2.0  # samples, percent, percent
    sample_index = np.arange(n)
    op = (
        50.0
        + 15.0 * np.sin(2.0 * np.pi * sample_index / 97.0)
        + 3.0 * np.sin(2.0 * np.pi * sample_index / 31.0)
    )
    mv, stem = np.empty(n), float(op[0])
    for k, command in enumerate(op):
        if abs(command - stem) > stick:
            stem = command - np.sign(command - stem) * (stick - jump)
        mv[k] = stem
    mv += np.random.default_rng(1).normal(0.0, 0.1, n)
    signals = {Role.OP: Signal.good(op, "OP"), Role.MV: Signal.good(mv, "MV")}
    return Recording(valve="made up", signals=signals, interval_s=1.0)


def compile_all() -> None:
    """Compile the kernels of a screening and of the simulator in this process."""
    from stemwatch.models.studies.simulator import demo_plant, simulate_loop

    compile_kernels(list(Kernels))
    simulate_loop(demo_plant(1)[0], 1)


if __name__ == "__main__":
    compile_all()
