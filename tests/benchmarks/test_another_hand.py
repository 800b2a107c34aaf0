"""Valves of the other simulator that hide what its first draw showed to be missed."""

from __future__ import annotations

import numpy as np
import pytest

from stemwatch.models.mismatch.explain import explain
from tests.benchmarks.another_hand import EFFECTS, NOTHING, draw_hand_valve


@pytest.mark.parametrize("hidden", [NOTHING, "dead_time", "travel_stop"])
def test_the_stem_follows_its_command_within_its_friction(hidden: str) -> None:
    """Within the static level, what is hidden aside; every signal is a number."""
    valve = draw_hand_valve(hidden, 1004 if hidden == NOTHING else 1000)
    op = valve.recording.op.values
    for signal in valve.recording.signals.values():
        assert np.isfinite(signal.values).all()
    if hidden == NOTHING:
        assert np.percentile(np.abs(op - valve.place), 90.0) < 0.5 * (valve.S + valve.J) + 0.5
    assert np.ptp(valve.place) > 10.0


def test_each_effect_changes_the_valve() -> None:
    """Each draws something, under the name of the catalogue."""
    rng = np.random.default_rng(1)
    for draw in EFFECTS.values():
        assert draw(rng)


@pytest.mark.long
@pytest.mark.parametrize(
    ("hidden", "seed", "named"),
    [
        # Samples of half a second: the delay ended at 6 s, and was `unknown` and a lag.
        ("dead_time", 1000, "dead_time"),
        ("dead_time", 1002, "dead_time"),
    ],
)
def test_what_was_missed_is_named(hidden: str, seed: int, named: str) -> None:
    """Alone, or as the first name."""
    said = explain(draw_hand_valve(hidden, seed).recording)
    assert said.effects[0].slug == named
