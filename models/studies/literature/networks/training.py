"""Training the paper's networks on records with holes, and running them freely."""

from __future__ import annotations

import numpy as np
import torch

from stemwatch.models.narx.levenberg_marquardt import one_thread
from stemwatch.models.recording import Bools, Floats
from stemwatch.models.studies.reproduction.fitting import (
    Segments,
    TrainingStage,
    fit_segments,
    segment_errors,
)
from stemwatch.models.studies.reproduction.layers import (
    FEEDFORWARD,
    FEEDFORWARD_INPUTS,
    NARX,
    NARX_INPUTS,
    ThreeLayers,
)
from stemwatch.models.studies.reproduction.network_step import LIMIT, SEEDS, run_free
from stemwatch.models.verdict import Shape

STARTS = 4  # seeds
WATCHED_SHARE = 0.15  # the end of the training part, by which seed and stage are chosen
MOST_SAMPLES = 1500
LEAST_SAMPLES = 10  # pieces to train on, and to watch
WATCHED_HORIZON = 150
ONE_STEP = TrainingStage(horizon=1, steps=40)
FREE_RUNS = (TrainingStage(horizon=15, steps=20), TrainingStage(horizon=150, steps=20))

Trained = tuple[ThreeLayers, Floats]


def train(
    shape: Shape, u: Floats, y: Floats, runs: list[Bools], *, recurrent: bool
) -> Trained | str:
    """The network of ``shape`` and its (P,) weights, or a sentence on why there are none.

    ``u`` and ``y`` (n,) scaled to about -1 ... 1; each of ``runs`` (n,) marks one stretch's
    samples. First series-parallel, then, for a recurrent network, on free runs.
    """
    usable = np.flatnonzero(np.any(runs, axis=0))
    watch_from = int(usable[round((1.0 - WATCHED_SHARE) * (usable.size - 1))])
    index = np.arange(u.size)
    early, late = (
        [run & side for run in runs] for side in (index < watch_from, index >= watch_from)
    )
    if min(segments(u, y, part, 1).samples for part in (early, late)) < LEAST_SAMPLES:
        return "too few samples without a hole to train on and to watch; take a longer window"
    table, inputs = (NARX, NARX_INPUTS) if recurrent else (FEEDFORWARD, FEEDFORWARD_INPUTS)
    step = ThreeLayers(transfers=table[shape], inputs=inputs, reach=1.0)
    watched = _watched(u, y, late)
    weights = best = np.stack(
        [step.random_start(np.random.default_rng([3, k])) for k in range(STARTS)]
    )
    with one_thread():
        for stage in (ONE_STEP, *FREE_RUNS) if recurrent else (ONE_STEP,):
            cut = segments(u, y, early, stage.horizon)
            if not cut.samples:
                continue
            weights = fit_segments(step, weights, cut, stage, relative=False)
            better = segment_errors(step, weights, watched) < segment_errors(step, best, watched)
            best = np.where(better[:, None], weights, best)
        return step, best[int(np.argmin(segment_errors(step, best, watched)))]


def _watched(u: Floats, y: Floats, late: list[Bools]) -> Segments:
    """Free runs over the watched block, as long as its stretches allow."""
    for horizon in (WATCHED_HORIZON, 50, 15):
        watched = segments(u, y, late, horizon)
        if watched.samples:
            return watched
    return segments(u, y, late, 1)


def segments(u: Floats, y: Floats, runs: list[Bools], horizon: int) -> Segments:
    """Runs of ``horizon`` samples that may all be trained on; at most ``MOST_SAMPLES`` in all,
    spread evenly.
    """
    length = horizon + SEEDS
    starts: list[int] = []
    for run in runs:
        edges = np.flatnonzero(np.diff(np.concatenate([[0], run.astype(np.int8), [0]])))
        for first, last in edges.reshape(-1, 2).tolist():
            starts += range(first, last - length + 1, horizon)
    most_segments = max(MOST_SAMPLES // horizon, 1)
    if len(starts) > most_segments:
        starts = [
            starts[k] for k in np.linspace(0, len(starts) - 1, most_segments).round().astype(int)
        ]
    index = np.array(starts, dtype=np.intp)[None, :] + np.arange(length)[:, None]
    return Segments(u=torch.from_numpy(u[index]), y=torch.from_numpy(y[index]))


def run(
    step: ThreeLayers, weights: Floats, u: Floats, y: Floats, stretches: tuple[tuple[int, int], ...]
) -> tuple[Floats, bool]:
    """(n,) free run, from the first two positions of each stretch, and whether it diverged."""
    out = np.full(u.size, np.nan)
    with one_thread(), torch.inference_mode():
        batch = torch.from_numpy(weights[None])
        for first, last in stretches:
            pair = (torch.from_numpy(signal[first:last, None]) for signal in (u, y))
            out[first:last] = run_free(step, batch, *pair)[0, : last - first, 0].numpy()
    return out, bool(np.any(np.abs(out[np.isfinite(out)]) >= LIMIT))
