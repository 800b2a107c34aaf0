"""The known defects of the flow chart, A1 to A10, shown; and who is free of them."""

from __future__ import annotations

import numpy as np
import pytest

from stemwatch.models.studies.literature.canonical import CANONICAL
from stemwatch.models.studies.literature.choudhury import CHOUDHURY_AS_DRAWN, CHOUDHURY_TEXT
from stemwatch.models.studies.literature.kano import KANO
from tests.models.studies.literature.named_models import BY_NAME

READINGS = [CHOUDHURY_TEXT, CHOUDHURY_AS_DRAWN]
readings = pytest.mark.parametrize("model", READINGS, ids=lambda m: m.name)


def run(model, op, S=5.0, J=2.0, y0=None):
    op = np.array(op, dtype=float)
    return model.simulate(op, np.array([S, J]), 1.0, float(op[0]) if y0 is None else y0)


def rms(a, b):
    return float(np.sqrt(np.mean((a[200:] - b[200:]) ** 2)))


def test_noise_sets_the_force_back_as_drawn(signals):
    """A1: with noise on the command the reading as drawn is further off than the text's."""
    op = signals["noisy sine"]
    expected = run(CANONICAL, op)
    assert rms(run(CHOUDHURY_AS_DRAWN, op), expected) > 2.0 * rms(run(CHOUDHURY_TEXT, op), expected)


def test_a_dithering_stuck_stem_never_lets_go_as_drawn():
    """A1: a command that climbs 20 % in zigzags of less than S does not move the stem at all."""
    climb = np.repeat(np.arange(0.0, 20.0), 2) + np.tile([0.0, 1.7], 20) + 30.0
    assert np.ptp(run(CHOUDHURY_AS_DRAWN, climb)) == 0.0
    assert np.ptp(run(CHOUDHURY_TEXT, climb)) > 10.0
    assert np.ptp(run(CANONICAL, climb)) > 10.0


@readings
def test_a_restart_after_dither_is_asked_for_the_whole_band(model):
    """A2: up, a dip, and up again: the flow chart waits for S where the physics needs J."""
    op = [50, 54, 58, 62, 61, 62.5, 64.5, 66.5]
    assert run(CANONICAL, op)[-2:].tolist() == [63.0, 65.0]
    assert run(model, op)[-2] == 60.5


@pytest.mark.parametrize("model", [*READINGS, CANONICAL, KANO], ids=lambda m: m.name)
def test_one_repeated_sample_makes_a_stop(model):
    """A3: a repeated command stops the stem, which then needs a further J. All share it."""
    op = [50.0, 54.0, 58.0, 62.0, 62.0, 63.0, 65.0]
    assert np.diff(run(model, op))[-3:].tolist() == [0.0, 0.0, 3.0]


def test_a_jump_can_land_on_the_wrong_side():
    """A4: the offset takes the sign of the command's last step, not of the force: a stem held far
    above a command that sank in zigzags is pulled down, and lands S - J too low."""
    zigzag = np.repeat(np.arange(0.0, 14.0, 2.0), 2) + np.tile([3.5, 2.0], 7)
    op = np.concatenate(([50.0, 54.0, 58.0, 62.0], 62.0 - zigzag, [51.6]))
    y = run(CHOUDHURY_AS_DRAWN, op)
    assert y[-2] == 60.5
    assert y[-1] == pytest.approx(51.6 - 1.5)
    assert y[-2] > op[-1]  # it was pulled down, and so belongs 1.5 % above the command


@pytest.mark.parametrize("model", [*READINGS, CANONICAL, KANO], ids=lambda m: m.name)
def test_a_jump_above_the_band_overshoots(model, signals):
    """A5: with J > S a moving stem runs ahead of its command by (J - S)/2."""
    op = signals["triangle"]
    y = run(model, op, S=2.0123, J=5.0071)
    rising = (np.diff(op, prepend=op[0]) > 0) & (np.diff(y, prepend=y[0]) > 0) & (y > 50.0)
    np.testing.assert_allclose((y - op)[rising], 0.5 * (5.0071 - 2.0123), atol=1e-9)


@readings
def test_the_first_cycle_is_not_defined(model, signals):
    """A6: before the first slip a reading is off by percents, after it by nothing."""
    op = signals["triangle"]
    apart = np.abs(run(model, op, 5.0123, 2.0071) - run(CANONICAL, op, 5.0123, 2.0071))
    assert 1.0 < apart[:300].max() < 4.0
    assert apart[300:].max() < 1e-9


@readings
def test_saturation_ignores_friction(model):
    """A7: at 100 % the stem is put where the command is; friction would hold it fd short."""
    op = [90.0, 94.0, 98.0, 101.0, 103.0]
    assert run(model, op)[-1] == 100.0
    assert run(CANONICAL, op)[-1] == 101.5


@pytest.mark.parametrize(("model", "q"), [("he2", (3.0, 1.0)), ("stenman", (3.0,))])
def test_a_tie_does_not_slip(model, q):
    """A9: the breakaway is strictly greater, in every model."""
    op = np.array([50.0, 53.0, 53.0, 53.0 + 1e-9])
    y = BY_NAME[model].simulate(op, np.array(q), 1.0, 50.0)
    assert y[2] == 50.0
    assert y[3] > 50.0


@pytest.mark.parametrize("model", [*READINGS, CANONICAL, KANO], ids=lambda m: m.name)
def test_the_rate_of_sampling_matters_for_a_coarse_command(model, signals):
    """A10: a command held for three samples sticks where the same one sampled once does not."""
    op = signals["sine"][::3]
    slow = run(model, op)
    fast = run(model, np.repeat(op, 3))[2::3]
    assert rms(slow, fast) > 0.3


@readings
def test_the_source_says_that_it_is_from_memory(model):
    """A reader is told that the flow chart was not read again."""
    assert "from memory" in model.source
