"""A stem that rests within a dead band is told from every actuator without friction."""

from __future__ import annotations

import numpy as np
import pytest

from stemwatch.models.recording import Floats
from stemwatch.models.signals.dead_band import DeadBand, find_dead_bands

SCANS = 10  # of a second each, between two stored samples


def command(seed: int = 4090, noise: float = 0.3) -> Floats:
    """Percent each second for six hours: a slow wander with ``noise`` of a controller on it."""
    rng = np.random.default_rng(seed)
    slow = np.empty(6 * 3600)
    level = 0.0
    for k in range(slow.size):
        level += -level / 200.0 + 0.25 * rng.standard_normal()
        slow[k] = level
    return 50.0 + 1.5 * slow + noise * rng.standard_normal(slow.size)


def play(op: Floats, half: float) -> Floats:
    """A stem that stays until OP is ``half`` away, and follows at that distance."""
    stem, out = op[0], np.empty_like(op)
    for k, now in enumerate(op):
        stem = min(max(stem, now - half), now + half)
        out[k] = stem
    return out


def lagging(op: Floats, up_s: float, down_s: float, fastest: float = np.inf) -> Floats:
    """A stem without friction behind a lag in either direction and a limit of speed, %/s."""
    stem, out = op[0], np.empty_like(op)
    for k, now in enumerate(op):
        apart = now - stem
        stem += float(np.clip(apart / (up_s if apart > 0.0 else down_s), -fastest, fastest))
        out[k] = stem
    return out


def seen(op: Floats, stem: Floats, noise: float = 0.05) -> tuple[DeadBand, ...]:
    """The wide bands that are likely in every tenth sample."""
    mv = stem + noise * np.random.default_rng(7).standard_normal(stem.size)
    found = find_dead_bands(op[::SCANS], mv[::SCANS], np.ones(op[::SCANS].size, dtype=bool))
    return tuple(band for band in found if band.percent >= 1.5 and band.t >= 2.5)


def follows_outside_alone(band: DeadBand) -> bool:
    """Whether the stem follows at least three times as closely outside ``band`` as within."""
    return band.gain >= 3.0 * abs(band.inside)


@pytest.mark.parametrize("half", [2.0, 3.0])
def test_a_dead_band_is_seen_a_little_smaller_than_it_is(half):
    """Noise of OP between the samples takes part of the band and leaves the rest."""
    op = command()
    sure = [band for band in seen(op, play(op, half)) if follows_outside_alone(band)]
    assert sure
    assert all(half < band.percent <= 2.0 * half + 0.5 for band in sure)


@pytest.mark.parametrize(
    ("up_s", "down_s", "fastest"),
    [
        (0.5, 0.5, np.inf),
        (15.0, 15.0, np.inf),
        (60.0, 60.0, np.inf),
        (20.0, 60.0, np.inf),
        (15.0, 15.0, 0.05),
    ],
)
def test_no_actuator_without_friction_has_one(up_s, down_s, fastest):
    """However slow it is, also one way alone or on large moves alone, a stem without friction moves
    wherever it is not where OP is."""
    op = command()
    assert not any(map(follows_outside_alone, seen(op, lagging(op, up_s, down_s, fastest))))


def test_too_few_steps_show_none():
    """An hour of a sample every minute is too little."""
    op = command()[:: 6 * SCANS][:60]
    assert find_dead_bands(op, play(op, 2.0), np.ones(op.size, dtype=bool)) == ()
