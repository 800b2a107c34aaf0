"""The other simulator: its stems follow, and each effect changes them."""

from __future__ import annotations

import numpy as np
import pytest

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
