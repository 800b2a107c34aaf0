"""The inputs: the paper's sine, a rich training record, and families of inputs for testing only.

All are in units of the sine's amplitude, one sample a step. Training and unseen inputs come from
random streams that share no seed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from stemwatch.models.recording import Floats
from stemwatch.models.studies.reproduction.cases import AMPLITUDE, PERIODS, SAMPLES_PER_PERIOD
from stemwatch.models.studies.simulator import draw_sticky, simulate_loop

LENGTH = 1500  # samples of each unseen input and of most parts of the training record
_TRAINING, _UNSEEN = 1, 2  # first number of every seed: the streams never overlap
_RAMP = 60  # samples between two parts of the training record
_LARGEST = 1.5
_WARM_UP_S = 120.0

Family = Callable[[np.random.Generator], Floats]


def paper_sine() -> Floats:
    """(n,) whole periods of the sine; the first is not scored, because of the start."""
    n = (PERIODS + 1) * SAMPLES_PER_PERIOD
    return AMPLITUDE * np.asarray(np.sin(2.0 * np.pi * np.arange(n) / SAMPLES_PER_PERIOD))


def training_input() -> Floats:
    """(n,) one continuous record: the paper's sine, then a rich variety of movements.

    A swept sine, a sine that grows from 0 to 1.5 times the amplitude (the point where the stem
    begins to move determines the breakaway level), sums of sines and random walks.
    """
    rngs = [np.random.default_rng([_TRAINING, part]) for part in range(8)]
    parts = [
        paper_sine(),
        _swept(60.0, 400.0, LENGTH),
        _growing(2 * LENGTH),
        *(sum_of_sines(rng) for rng in rngs[:3]),
        *(random_walk(rng) for rng in rngs[3:6]),
        *(single_sine(rng) for rng in rngs[6:]),
    ]
    joined = parts[:1]
    for part in parts[1:]:
        joined += [_ramp(joined[-1][-1], part[0]), part]
    return np.concatenate(joined)


def single_sine(rng: np.random.Generator) -> Floats:
    """Amplitude 0.7 to 1.5, period 60 to 400 samples (not whole), any phase."""
    phase = rng.uniform(0.0, 2.0 * np.pi) + _phase(np.full(LENGTH, rng.uniform(60.0, 400.0)))
    return np.asarray(rng.uniform(0.7, _LARGEST) * np.sin(phase))


def sum_of_sines(rng: np.random.Generator) -> Floats:
    """Three sines of periods 40 to 500 samples, the sum scaled to a largest value of 0.8 to 1.4."""
    periods = np.exp(rng.uniform(np.log(40.0), np.log(500.0), (3, 1)))
    phases = rng.uniform(0.0, 2.0 * np.pi, (3, 1))
    waves = rng.uniform(0.3, 1.0, (3, 1)) * np.sin(
        2.0 * np.pi * np.arange(LENGTH) / periods + phases
    )
    total = waves.sum(axis=0)
    return np.asarray(rng.uniform(0.8, 1.4) * total / np.abs(total).max())


def random_walk(rng: np.random.Generator) -> Floats:
    """Normal steps of standard deviation 0.02 to 0.1, reflected at 1.2 times the amplitude."""
    walk = np.cumsum(rng.uniform(0.02, 0.1) * rng.standard_normal(LENGTH))
    return _reflected(walk, 1.2)


def recorded_like(rng: np.random.Generator) -> Floats:
    """The controller output of a simulated closed loop with a sticking valve, scaled to 0.8 to 1.3.

    The plant simulator draws and runs the loop; only its OP is used, archived at 1 s.
    """
    loop = draw_sticky(4, int(rng.integers(2**31)))[int(rng.integers(4))]
    loop = replace(loop, duration_s=float(LENGTH), warmup_s=_WARM_UP_S)
    op = simulate_loop(loop, int(rng.integers(2**31))).recording.op.values
    low, high = np.percentile(op, (0.5, 99.5))
    return np.asarray(rng.uniform(0.8, 1.3) * (2.0 * (op - low) / max(high - low, 1e-9) - 1.0))


FAMILIES: dict[str, Family] = {
    "other sines": single_sine,
    "sums of sines": sum_of_sines,
    "random walks": random_walk,
    "recorded-like OP": recorded_like,
}


def unseen(family: str, count: int) -> list[Floats]:
    """The first ``count`` inputs of a family; the k-th does not depend on ``count``."""
    family_index = list(FAMILIES).index(family)
    rngs = (np.random.default_rng([_UNSEEN, family_index, number]) for number in range(count))
    return [FAMILIES[family](rng) for rng in rngs]


def _swept(shortest: float, longest: float, n: int) -> Floats:
    return AMPLITUDE * np.asarray(np.sin(_phase(np.geomspace(longest, shortest, n))))


def _growing(n: int) -> Floats:
    period = np.sqrt(2.0) * SAMPLES_PER_PERIOD / 2.0  # irrational, so that samples do not repeat
    return np.asarray(np.linspace(0.0, _LARGEST, n) * np.sin(_phase(np.full(n, period))))


def _phase(period: Floats) -> Floats:
    return np.asarray(2.0 * np.pi * np.cumsum(1.0 / period))


def _ramp(first: float, last: float) -> Floats:
    """Between two values, without them, smooth at both ends."""
    share = np.arange(1, _RAMP + 1) / (_RAMP + 1)
    return np.asarray(first + (last - first) * 0.5 * (1.0 - np.cos(np.pi * share)))


def _reflected(walk: Floats, limit: float) -> Floats:
    folded = np.mod(walk + limit, 4.0 * limit)
    return np.asarray(np.where(folded > 2.0 * limit, 4.0 * limit - folded, folded) - limit)
