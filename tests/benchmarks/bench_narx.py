"""How well and how quickly NARX networks are trained on simulated loops: measured, never judged.

    python tests/benchmarks/bench_narx.py [--valves 64] [--seed 4242] [--batches 1,16,64] [--json F]

Three in eight loops are healthy, the others stick, in every shape. Each network is trained on the
first part of its recording, about 60 %, and judged by its free run over the rest, once with all
members started from random weights and once with half of them started from the stick-slip fit to
the same first part (grey-box). A fit below -100 % counts as -100, and so does no network.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from stemwatch.models.narx.example import NarxExample, NarxSettings
from stemwatch.models.narx.training import train
from stemwatch.models.plant import draw_healthy, draw_sticky, simulate_loop
from stemwatch.models.recording import Floats
from stemwatch.models.residual import of_stiction
from stemwatch.models.screening import start_of
from stemwatch.models.stickslip.fit import fit_stickslip

FLOOR = -100.0
CLOSE = 3.0  # points of fit


def valves(count: int, seed: int) -> tuple[list[NarxExample], Floats, float]:
    """Examples with a start, the stick-slip fit's percent on the same samples, seconds each."""
    healthy = 3 * count // 8
    loops = [*draw_healthy(healthy, seed), *draw_sticky(count - healthy, seed)]
    examples, percents, seconds = [], [], 0.0
    for at, loop in enumerate(loops):
        recording = simulate_loop(loop, 1000 * seed + at).recording
        began = time.perf_counter()
        fit = fit_stickslip(recording)
        seconds += time.perf_counter() - began
        residual = of_stiction(fit, resynced=False)
        examples.append(NarxExample.of(recording, fit.first_heldout, start_of(fit)))
        percents.append(residual.fit_percent if residual is not None else FLOOR)
    return examples, np.maximum(percents, FLOOR), seconds / count


def trained(examples: Sequence[NarxExample], batch: int) -> tuple[Floats, float]:
    """Held-out percents of fit, and seconds of processor time for each valve."""
    began = time.process_time()
    fits = train(examples, NarxSettings(valves_per_batch=batch))
    seconds = (time.process_time() - began) / len(examples)
    percents = [fit.heldout.fit_percent if fit.heldout else FLOOR for fit in fits]
    return np.maximum(percents, FLOOR), seconds


def row(
    model: str, batch: int | None, percents: Floats, stick: Floats, s: float
) -> dict[str, object]:
    return {
        "model": model,
        "batch": batch,
        "median_percent": round(float(np.median(percents)), 1),
        "mean_percent": round(float(np.mean(percents)), 1),
        "lower_quartile_percent": round(float(np.percentile(percents, 25)), 1),
        "share_close_to_stick_slip": round(float(np.mean(percents >= stick - CLOSE)), 3),
        "seconds_per_valve": round(s, 3),
    }


def measure(count: int, seed: int, batches: Sequence[int]) -> list[dict[str, object]]:
    """One row for the stick-slip element and one for each start and batch size."""
    examples, stick, seconds = valves(count, seed)
    rows = [row("stick-slip", None, stick, stick, seconds)]
    for name, some in (
        ("NARX, random starts", [replace(one, start=None) for one in examples]),
        ("NARX, half from S and J", examples),
    ):
        trained(some[:2], 2)  # what is compiled and imported once is not counted
        rows += [row(name, batch, *_judged(some, batch, stick)) for batch in batches]
    return rows


def _judged(
    examples: Sequence[NarxExample], batch: int, stick: Floats
) -> tuple[Floats, Floats, float]:
    percents, seconds = trained(examples, batch)
    return percents, stick, seconds


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--valves", type=int, default=64)
    parser.add_argument("--seed", type=int, default=4242)
    parser.add_argument("--batches", default="1,16,64")
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    rows = measure(asked.valves, asked.seed, [int(size) for size in asked.batches.split(",")])
    table = Table(*(name.replace("_", " ") for name in rows[0]))
    for one in rows:
        table.add_row(*("-" if value is None else str(value) for value in one.values()))
    Console(width=140).print(table)
    if asked.json:
        asked.json.write_text(json.dumps({"seed": asked.seed, "rows": rows}, indent=2))


if __name__ == "__main__":
    main()
