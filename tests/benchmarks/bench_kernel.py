"""The stick-slip kernel beside a straight C loop, compiled with ``gcc -O2``, in one process.

    python tests/benchmarks/bench_kernel.py [--samples 86400] [--rounds 200] [--json FILE]

Both run the whole chain (dead time, lags, speed limits, stick-slip, reading) over the same command,
in turns; the median of the rounds and their ratio are printed. Target: at most 1.3. The two outputs
must agree to 1e-9, or nothing is printed.
"""

from __future__ import annotations

import argparse
import ctypes
import json
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from stemwatch.models.recording import Floats
from stemwatch.models.stickslip import kernel

SOURCE = Path(__file__).with_name("stickslip.c")
AGREES = 1e-9  # percent of span
# S, J, dead time, lag up, lag down, rate up, rate down, zero, gain, re-stick.
CASES = {
    "S and J alone": np.array([4.0, 1.5, 0.0, 0.0, 0.0, np.inf, np.inf, 0.0, 1.0, 0.0]),
    "whole chain": np.array([4.0, 1.5, 2.4, 1.5, 3.0, 4.0, 2.0, 0.3, 1.02, 0.0]),
}


def command(samples: int) -> Floats:
    """(n,) OP in percent: a controller's slow wander with noise, seeded."""
    noise = np.random.default_rng(1).standard_normal(samples)
    wave = 12.0 * np.sin(np.arange(samples) / 37.0) + 5.0 * np.sin(np.arange(samples) / 411.0)
    return np.asarray(50.0 + wave + 0.05 * noise)


def compiled_c(folder: Path) -> Callable[[Floats, Floats, float, Floats, Floats], None]:
    """The C loop as a function of arrays. Ends the program where there is no gcc."""
    gcc = shutil.which("gcc")
    if gcc is None:
        sys.exit("bench_kernel: gcc is not installed; this comparison needs it (apt install gcc)")
    library = folder / "stickslip.so"
    command_line = [gcc, "-O2", "-shared", "-fPIC", "-o", str(library), str(SOURCE), "-lm"]
    subprocess.run(command_line, check=True)
    function = ctypes.CDLL(str(library)).simulate
    array = np.ctypeslib.ndpointer(dtype=np.float64, flags="C_CONTIGUOUS")
    function.argtypes = [array, array, ctypes.c_long, ctypes.c_double, array, array]
    function.restype = None

    def run(op: Floats, mv: Floats, dt: float, q: Floats, out: Floats) -> None:
        function(op, mv, op.size, dt, q, out)

    return run


def measure(samples: int, rounds: int) -> list[dict[str, object]]:
    """One row for each case: microseconds of either, and their ratio."""
    op = command(samples)
    start = np.zeros(samples, dtype=np.uint8)
    start[0] = kernel.START
    ours, theirs = np.empty(samples), np.empty(samples)
    rows: list[dict[str, object]] = []
    with tempfile.TemporaryDirectory() as folder:
        in_c = compiled_c(Path(folder))
        for name, q in CASES.items():
            kernel.simulate(op, op, start, 1.0, q, ours)
            in_c(op, op, 1.0, q, theirs)
            if not np.allclose(ours, theirs, rtol=0.0, atol=AGREES):
                sys.exit(f"bench_kernel: {name}: the two differ by {np.abs(ours - theirs).max()}")
            seconds: tuple[list[float], list[float]] = ([], [])
            for _ in range(rounds):
                started = time.perf_counter()
                kernel.simulate(op, op, start, 1.0, q, ours)
                between = time.perf_counter()
                in_c(op, op, 1.0, q, theirs)
                seconds[0].append(between - started)
                seconds[1].append(time.perf_counter() - between)
            own, c = (1e6 * float(np.median(second)) for second in seconds)
            rows.append(
                {
                    "case": name,
                    "samples": samples,
                    "kernel_us": round(own, 1),
                    "c_us": round(c, 1),
                    "ratio": round(own / c, 2),
                }
            )
    return rows


def main() -> None:
    """Read the options, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=86400)
    parser.add_argument("--rounds", type=int, default=200)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    rows = measure(arguments.samples, arguments.rounds)
    print(f"{'case':16}{'samples':>9}{'kernel, us':>12}{'C, us':>10}{'ratio':>8}")
    for row in rows:
        print(
            f"{row['case']:16}{row['samples']:>9}{row['kernel_us']:>12}{row['c_us']:>10}"
            f"{row['ratio']:>8}"
        )
    if arguments.json:
        arguments.json.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
