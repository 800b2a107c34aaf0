"""Use each kernel once, so that numba compiles it and keeps it in its cache.

Their modules are imported late, because a process that leaves the compiling to a worker needs none
of them.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from enum import Enum, auto

import numpy as np

from stemwatch.models.recording import Floats, Recording, Role, Signal


class Kernels(Enum):
    """The kernels, in parts. The first takes about as long to compile as the other two."""

    FITS = auto()  # the quick fit and the networks
    MISMATCH = auto()  # the search for effects beside S and J
    SIMULATOR = auto()


OF_A_SCREENING = (Kernels.FITS, Kernels.MISMATCH)


def compile_kernels(parts: Sequence[Kernels]) -> list[Kernels]:
    """Compile ``parts`` in this process, by using them once."""
    from stemwatch.models.mismatch.explain import explain
    from stemwatch.models.screening.screen import Case, Options, screen
    from stemwatch.models.studies.simulator import demo_plant, simulate_loop
    from stemwatch.models.without_position.features import evidence

    for part in parts:
        if part is Kernels.FITS:
            screen([Case(recording=short_recording())], Options(mismatch=False))
            # writable, as in actual use: numba compiles read-only arrays separately
            op = short_recording().op.values.copy()
            evidence(op, np.cumsum(op - op.mean()))  # of loops with PV
            _run_a_loop(op)
            _compare_units_and_rests()
        elif part is Kernels.MISMATCH:
            explain(short_recording())
        else:
            simulate_loop(demo_plant(1)[0], 1)
    return list(parts)


def _run_a_loop(op: Floats) -> None:
    """Compile the kernels that simulate the control loop of a sticking valve."""
    from stemwatch.models.closed_loop import kernel
    from stemwatch.models.closed_loop.process_model import process_model

    process_model(op, np.cumsum(op - op.mean()))
    signals = (np.empty_like(op) for _ in range(3))
    kernel.run_loop(op, op, op, np.ones(kernel.N_NUMBERS), np.zeros(2), op, *signals)


def _compare_units_and_rests() -> None:
    """Compile the kernels of a recording that is long enough for a slower unit of time, and of a
    position that rests."""
    from stemwatch.models.preparation.own_unit import samples_in_unit
    from stemwatch.models.stickslip.problem import make_problem
    from stemwatch.models.stickslip.rests import Rests

    recording = short_recording(1500)
    samples_in_unit(recording)
    Rests.of(make_problem(recording))


def short_recording(n: int = 600) -> Recording:
    """``n`` seconds of a sticking valve with noise, for which all kernels are needed."""
    stick, jump = 4.0, 2.0  # percent
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


if __name__ == "__main__":
    compile_kernels([Kernels[name] for name in sys.argv[1:]])
