"""How well and how quickly NARX networks are trained on simulated loops: measurements without a
limit.

    python tests/benchmarks/bench_narx.py [--valves 64] [--seed 4242] [--batches 1,64] [--json F]

Three in eight loops are healthy, the others stick, in every shape. Each network is trained on the
first part of its recording, about 60 %, and judged by its free run over the rest, once with all
members started from random weights, as many as the product takes and four, and once with some of
them started from the stick-slip fit to the same first part (grey-box). A fit below -100 % counts as
-100, and so does no network. Where torch sees a CUDA GPU, every row is there once for the CPU and
once for the GPU.

Two populations: *all* are the first ``--valves`` drawn; of *screened* there are as many, drawn on
until so many had no obstacle to a verdict, because where nothing moves a fit in percent is one of
noise. Beside them stands *the valve itself*: simulated again on the recorded OP with everything
known but how much each breakaway scatters, which is drawn anew, eight times; its *mean run* is the
mean of the eight. It is a reference and no upper bound: OP between the samples is not known, and an
OP recorded in closed loop contains information on the true slips.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from rich.console import Console
from rich.table import Table

from stemwatch.models.decision.residual import of_stiction
from stemwatch.models.limits import Limits
from stemwatch.models.narx.example import NarxExample, NarxSettings
from stemwatch.models.narx.training import train
from stemwatch.models.record_checks.quality import assess
from stemwatch.models.recording import Floats
from stemwatch.models.screening.networks import network_start
from stemwatch.models.stickslip.fit import fit_stickslip
from stemwatch.models.studies.simulator import draw_healthy, draw_sticky, simulate_loop
from stemwatch.models.studies.simulator.loop import ManualSpan, PlantLoop

FLOOR = -100.0
CLOSE = 3.0  # points of fit
DRAWS = 8
FOUR = NarxSettings(seeds=4)


@dataclass(frozen=True)
class Valve:
    """An example with a start, percents of fit on the same samples, and whether a screening would
    go on with it. ``again`` is the valve itself: its single runs' mean fit, and their mean's."""

    example: NarxExample
    stick_percent: float
    again: tuple[float, float]
    screened: bool
    seconds: float


def drawn(seed: int) -> Iterator[PlantLoop]:
    """Loops without end, eight at a time, three of them healthy; each its own draw."""
    at = 0
    while True:
        healthy, sticky = (
            draw_healthy(3 * (at + 8) // 8, seed),
            draw_sticky(5 * (at + 8) // 8, seed),
        )
        yield from healthy[3 * at // 8 :]
        yield from sticky[5 * at // 8 :]
        at += 8


def made(loop: PlantLoop, seed: int) -> Valve:
    """One loop simulated, assessed and fitted."""
    recording = simulate_loop(loop, seed).recording
    started = time.process_time()
    fit = fit_stickslip(recording)
    seconds = time.process_time() - started
    residual = of_stiction(fit, resynced=False)
    example = NarxExample.of(recording, fit.first_heldout, network_start(fit, None))
    return Valve(
        example=example,
        stick_percent=max(residual.fit_percent, FLOOR) if residual is not None else FLOOR,
        again=itself(loop, example, seed),
        screened=not assess(recording, Limits()).obstacles,
        seconds=seconds,
    )


def itself(loop: PlantLoop, example: NarxExample, seed: int) -> tuple[float, float]:
    """The same valve in manual on the recorded OP, without measurement noise, over the held-out
    part: mean percent of ``DRAWS`` runs, and percent of their mean."""
    step = example.interval_s
    hold = min(loop.controller.scan_s, step)  # the recorded OP has been held since the scan before
    times = step * np.arange(example.op.size)
    knots = [
        (float(at), float(op))
        for time_s, op in zip(times, example.op, strict=True)
        for at in (time_s - hold - 1e-4, time_s - 1e-3)
        if at > 0.0
    ]
    manual = ManualSpan(start_s=0.0, stop_s=loop.duration_s + step, knots=tuple(knots))
    quiet = replace(loop.transmitters, position_noise=0.0)
    repeated = replace(loop, manual=(manual,), transmitters=quiet)
    runs = []
    for draw in range(DRAWS):
        mv = simulate_loop(repeated, 10**6 * (draw + 1) + seed).recording.mv
        assert mv is not None
        runs.append(mv.values)
    late = example.train_until
    truth = example.mv[late:]
    singles = [percent_of(run[late:], truth) for run in runs]
    return float(np.mean(singles)), percent_of(np.mean(runs, axis=0)[late:], truth)


def percent_of(simulated: Floats, mv: Floats) -> float:
    """100 (1 - ||y - yhat|| / ||y - mean(y)||), not below the floor."""
    error = float(np.sqrt(np.nanmean((simulated - mv) ** 2)) / np.nanstd(mv))
    return max(100.0 * (1.0 - error), FLOOR)


def devices() -> tuple[str, ...]:
    """Where networks can be trained on this machine."""
    return ("cpu", "cuda") if torch.cuda.is_available() else ("cpu",)


def trained(
    examples: Sequence[NarxExample], batch: int, settings: NarxSettings, device: str
) -> tuple[Floats, float]:
    """Held-out percents of fit, and seconds for each valve: of processor time on the CPU, and on
    the GPU, which works while the processor waits, by the clock."""
    clock = time.process_time if device == "cpu" else time.perf_counter
    started = clock()
    fits = train(examples, replace(settings, valves_per_batch=batch, device=device))
    seconds = (clock() - started) / len(examples)
    percents = [fit.heldout.fit_percent if fit.heldout else FLOOR for fit in fits]
    return np.maximum(percents, FLOOR), seconds


def row(
    model: str,
    batch: int | None,
    percents: Floats,
    stick: Floats,
    s: float | None,
    device: str | None = None,
) -> dict[str, object]:
    """One line of the table."""
    return {
        "model": model,
        "device": device,
        "batch": batch,
        "median_percent": round(float(np.median(percents)), 1),
        "mean_percent": round(float(np.mean(percents)), 1),
        "lower_quartile_percent": round(float(np.percentile(percents, 25)), 1),
        "share_close_to_stick_slip": round(float(np.mean(percents >= stick - CLOSE)), 3),
        "seconds_per_valve": None if s is None else round(s, 3),
    }


def measure(valves: Sequence[Valve], batches: Sequence[int]) -> list[dict[str, object]]:
    """One row for the element and the valve itself, one for each start and batch size."""
    stick = np.array([valve.stick_percent for valve in valves])
    single, mean = np.array([valve.again for valve in valves]).T
    rows = [
        row("the valve itself", None, single, stick, None),
        row("the valve itself, mean run", None, mean, stick, None),
        row("stick-slip", None, stick, stick, float(np.mean([valve.seconds for valve in valves]))),
    ]
    grey = [valve.example for valve in valves]
    blind = [replace(item, start=None) for item in grey]
    count = NarxSettings()
    for name, some, settings in (
        ("NARX, 4 random starts", blind, FOUR),
        (f"NARX, {count.seeds} random starts", blind, count),
        (f"NARX, {count.fitted} of {count.seeds} from S and J", grey, count),
    ):
        for device in devices():
            trained(some[:2], 2, settings, device)  # compile the kernels before the time is taken
            for batch in batches:
                percents, seconds = trained(some, batch, settings, device)
                rows.append(row(name, batch, percents, stick, seconds, device))
    return rows


def populations(count: int, seed: int) -> dict[str, list[Valve]]:
    """*all*: the first ``count`` loops; *screened*: the first ``count`` that have no obstacle."""
    every: list[Valve] = []
    for index, loop in enumerate(drawn(seed)):
        every.append(made(loop, 1000 * seed + index))
        screened = [item for item in every if item.screened]
        if len(every) >= count and len(screened) >= count:
            break
    return {"all": every[:count], "screened": screened[:count]}


def main() -> None:
    """Read the options, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--valves", type=int, default=64)
    parser.add_argument("--seed", type=int, default=4242)
    parser.add_argument("--batches", default="1,64")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    batches = [int(size) for size in arguments.batches.split(",")]
    results = {
        name: measure(valves, batches)
        for name, valves in populations(arguments.valves, arguments.seed).items()
    }
    for name, rows in results.items():
        table = Table(*(row.replace("_", " ") for row in rows[0]), title=name)
        for row in rows:
            table.add_row(*("-" if value is None else str(value) for value in row.values()))
        Console(width=140).print(table)
    if arguments.json:
        arguments.json.write_text(json.dumps({"seed": arguments.seed, "rows": results}, indent=2))


if __name__ == "__main__":
    main()
