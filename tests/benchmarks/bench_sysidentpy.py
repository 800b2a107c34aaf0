"""Networks trained here beside SysIdentPy's, on the same simulated recordings and one core.

    python tests/benchmarks/bench_sysidentpy.py [--valves N] [--seed K] [--json FILE]

Seconds of processor time per valve, which a busy machine hardly changes, and the free run's fit on
the held-out part (the last 40 %), without a restart. *stemwatch* is the training alone, from random
weights; *stemwatch screen* a whole screening, whose networks may start from its stick-slip fit.
SysIdentPy gets what favours it: signals of mean 0 and standard deviation 1, and OP moved on by one
sample, because its lags begin at 1 and a stem answers within the sample.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from stemwatch.models.narx.example import NarxExample
from stemwatch.models.narx.training import train
from stemwatch.models.recording import Floats, Recording
from stemwatch.models.screening.screen import Case, screen
from stemwatch.models.screening_result import Screening
from stemwatch.models.studies.simulator import draw_healthy, draw_sticky, simulate_loop

ONE_CORE = dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
SAMPLES, TRAINED_SHARE = 3240, 0.6
EPOCHS, UNITS = 200, 10
DEGREE, TERMS, LAGS = 2, 20, 4
OLDEST, INSTALL = (0, 9), "pip install 'sysidentpy>=0.9' ."
WORST_FIT = -100.0  # percent; a run that diverged counts as this
OURS, SCREEN = "stemwatch", "stemwatch screen"
FROLS, NARXNN = "SysIdentPy FROLS", "SysIdentPy NARXNN"
Fitted = tuple[float, float | None]  # seconds, held-out fit in percent; None where refused


@dataclass(frozen=True)
class Row:
    """One valve, one method: seconds, and the held-out free run's fit in percent.

    ``fit_percent`` is ``None`` where the method refused the recording and made no network.
    """

    valve: str
    story: str
    method: str
    seconds: float
    fit_percent: float | None


def recordings(valves: int, seed: int) -> list[tuple[str, Recording]]:
    """Half sticking, half healthy loops of 54 minutes at 1 s, each with its story."""
    drawn = [*draw_sticky(valves - valves // 2, seed), *draw_healthy(valves // 2, seed)]
    seeded = [(replace(loop, duration_s=float(SAMPLES)), index) for index, loop in enumerate(drawn)]
    return [(loop.story, simulate_loop(loop, 1000 * seed + at).recording) for loop, at in seeded]


def example_of(recording: Recording) -> NarxExample:
    """The recording, its first 60 % to be trained on."""
    return NarxExample.of(recording, int(TRAINED_SHARE * len(recording)))


def fit_percent(simulated: Floats, mv: Floats) -> float:
    """100 (1 - ||y - yhat|| / ||y - mean(y)||), not below -100."""
    with np.errstate(over="ignore"):  # a run that diverged
        error = float(np.sqrt(np.mean((simulated - mv) ** 2)) / np.std(mv))
    return max(100.0 * (1.0 - error), WORST_FIT) if np.isfinite(error) else WORST_FIT


def ours(batch: list[NarxExample]) -> list[Fitted]:
    """All valves trained together with the product's own settings; the time divided by them."""
    started = time.process_time()
    fits = train(batch)
    seconds = (time.process_time() - started) / len(batch)
    held = [fit.heldout for fit in fits]
    return [(seconds, max(item.fit_percent, WORST_FIT) if item else None) for item in held]


def screened(batch: list[Recording]) -> list[Fitted]:
    """Whole screenings: stick-slip fit, intervals, and networks of which some start from the fit.

    Scored on the samples that neither the screening nor the others were fitted to.
    """
    started = time.process_time()
    fits = screen([Case(recording=recording) for recording in batch])
    seconds = (time.process_time() - started) / len(batch)
    return [
        (seconds, _screened_fit(item, recording))
        for item, recording in zip(fits, batch, strict=True)
    ]


def _screened_fit(fits: Screening, recording: Recording) -> float | None:
    narx, heldout_from = fits.traces.narx, fits.traces.heldout_from
    if narx is None or heldout_from is None or recording.mv is None:
        return None
    first = max(heldout_from, int(TRAINED_SHARE * len(recording)))
    return fit_percent(narx[first:], recording.mv.values[first:])


def sysidentpy(example: NarxExample, build: Callable[[], Any]) -> Fitted:
    """One of SysIdentPy's models: fitted on the first part, run freely over the rest."""
    until = example.train_until
    op = np.append(example.op[1:], example.op[-1])  # so that lag 1 is the present sample
    x, y = ((s - s[:until].mean()) / s[:until].std() for s in (op, example.mv))
    model = build()
    started = time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a diverging run overflows, and says so at every sample
        model.fit(X=x[:until, None], y=y[:until, None])
        seconds = time.process_time() - started
        start = until - LAGS  # the run begins from the last measured samples before it
        try:
            run = model.predict(X=x[start:, None], y=y[start:until, None])
        except (ValueError, FloatingPointError, OverflowError):  # its own check of infinities
            return seconds, WORST_FIT
    return seconds, fit_percent(np.asarray(run, dtype=float).ravel()[LAGS:], y[until:])


def _other(part: str = "") -> Any:
    """SysIdentPy, or a part of it; it has no types and may not be installed."""
    return importlib.import_module(f"sysidentpy.{part}" if part else "sysidentpy")


def polynomial() -> Any:
    """FROLS, degree 2, 20 terms, lags to 4, least squares."""
    return _other("model_structure_selection").FROLS(
        order_selection=False,
        n_terms=TERMS,
        xlag=LAGS,
        ylag=LAGS,
        basis_function=_other("basis_function").Polynomial(degree=DEGREE),
        estimator=_other("parameter_estimation").LeastSquares(),
    )


def neural() -> Any:
    """NARXNN, one layer of 10 tanh units on lags to 4, Adam, 200 epochs of one-step error."""
    layers = torch.nn.Sequential(
        torch.nn.Linear(2 * LAGS, UNITS), torch.nn.Tanh(), torch.nn.Linear(UNITS, 1)
    )
    return _other("neural_network").NARXNN(
        xlag=LAGS,
        ylag=LAGS,
        basis_function=_other("basis_function").Polynomial(degree=1),
        net=layers,
        epochs=EPOCHS,
        random_state=0,
    )


def measure(valves: int, seed: int) -> list[Row]:
    """Every method on every valve, one after the other."""
    torch.set_num_threads(1)
    drawn = recordings(valves, seed)
    _warm_up()
    batch = [example_of(recording) for _, recording in drawn]
    by_method = {
        OURS: ours(batch),
        SCREEN: screened([recording for _, recording in drawn]),
        FROLS: [sysidentpy(example, polynomial) for example in batch],
        NARXNN: [sysidentpy(example, neural) for example in batch],
    }
    return [
        Row(recording.valve, story, method, seconds, fit)
        for method, fitted in by_method.items()
        for (story, recording), (seconds, fit) in zip(drawn, fitted, strict=True)
    ]


def _warm_up() -> None:
    """Compile the kernels before the clock runs."""
    _, recording = recordings(1, 999)[0]
    train([example_of(recording)])
    screen([Case(recording=recording)])


def show(rows: list[Row]) -> None:
    """Each valve, then what the methods come to, and their seconds."""
    methods = (OURS, SCREEN, FROLS, NARXNN)
    columns = [[row for row in rows if row.method == method] for method in methods]
    _line("held-out free-run fit, %", methods)
    for group in zip(*columns, strict=True):
        _line(f"{group[0].valve} {group[0].story}", [_cell(row.fit_percent) for row in group])
    fits = [np.array([row.fit_percent for row in column], dtype=float) for column in columns]
    common = np.all(np.isfinite(fits), axis=0)
    if common.any():  # over other valves the columns could not be compared
        name = f"median of the {int(common.sum())} that all fitted"
        _line(name, [_cell(float(np.median(fit[common]))) for fit in fits])
        _line("mean of them", [_cell(float(np.mean(fit[common]))) for fit in fits])
    for name, own in zip((OURS, SCREEN), fits, strict=False):
        _line(f"{name} fits better on", [_wins(own, fit) for fit in fits])
    seconds = [float(np.mean([row.seconds for row in column])) for column in columns]
    _line("seconds per valve, fitting", [f"{second:.3f}" for second in seconds])
    _line("times the seconds of stemwatch", [f"{second / seconds[0]:.2f}" for second in seconds])
    print("-: refused, with a reason, so no network. Seconds of screen hold everything it does.")


def _line(name: str, cells: Sequence[str]) -> None:
    print(f"{name:42}" + "".join(f"{cell:>20}" for cell in cells))


def _cell(fit: float | None) -> str:
    return "-" if fit is None else f"{fit:.1f}"


def _wins(own: Floats, other: Floats) -> str:
    both = np.isfinite(own) & np.isfinite(other)
    return "" if own is other else f"{int(np.sum(own[both] > other[both]))} of {int(both.sum())}"


def main() -> None:
    """Read the options, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--valves", type=int, default=8)
    parser.add_argument("--seed", type=int, default=2026)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    if options.valves < 1:
        parser.error(f"--valves: at least 1 expected, received {options.valves}")
    if not ONE_CORE.items() <= os.environ.items():  # read when numpy is imported: begin again
        repeated = subprocess.run([sys.executable, *sys.argv], env={**os.environ, **ONE_CORE})
        sys.exit(repeated.returncode)
    try:
        version = _other().__version__
    except ImportError:
        sys.exit(
            "bench_sysidentpy: SysIdentPy is not installed; it serves this comparison only. "
            f"Install it beside stemwatch, in an environment of its own: {INSTALL}"
        )
    if tuple(int(part) for part in version.split(".")[:2]) < OLDEST:
        sys.exit(
            f"bench_sysidentpy: SysIdentPy {version} is too old, which is what pip finds for this "
            f"numpy. In an environment of its own: {INSTALL}"
        )
    rows = measure(options.valves, options.seed)
    print(f"SysIdentPy {version}, numpy {np.__version__}, torch {torch.__version__}")
    show(rows)
    if options.json:
        text = json.dumps([asdict(row) for row in rows], indent=1)
        options.json.write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
