"""Where S fell and stayed low, and where it only scatters."""

import numpy as np
import pytest

from stemwatch.models.history.fall_of_stiction import STAYS, history_since_fall

DAYS = np.arange(30.0)


def worn(repaired=20, level=0.4, seed=1):
    """S that wears from 0.4 % towards 2.4 % and is ``level`` from the day ``repaired`` on."""
    S = np.where(repaired > DAYS, 0.4 + 0.1 * DAYS, level)
    return S + 0.05 * np.random.default_rng(seed).standard_normal(S.size)


@pytest.mark.parametrize("seed", range(10))
def test_a_repair_begins_a_new_history(seed):
    """From the first day with the smaller S on, with what it was and is."""
    S = worn(seed=seed)
    since = history_since_fall(DAYS.tolist(), S.tolist())
    assert (since.fall.last, since.fall.first) == (19.0, 20.0)
    assert since.fall.before == pytest.approx(2.1, abs=0.2)
    assert since.fall.after == pytest.approx(0.4, abs=0.1)
    assert since.days == DAYS[20:].tolist()
    assert since.S == S[20:].tolist()


@pytest.mark.parametrize("days_after", range(1, STAYS))
def test_one_low_window_is_no_repair_yet(days_after):
    """Too few days tell nothing, but that something may have happened."""
    end = 20 + days_after
    since = history_since_fall(DAYS[:end].tolist(), worn()[:end].tolist())
    assert since.fall is None
    assert since.unsettled
    assert len(since.days) == end


def test_low_days_that_do_not_last_are_no_repair():
    """Two low days, and S is where it was."""
    S = worn(repaired=99)
    S[18:20] = 0.4
    since = history_since_fall(DAYS.tolist(), S.tolist())
    assert since.fall is None
    assert not since.unsettled


@pytest.mark.parametrize("level", [0.3, 1.2, 4.0])
def test_scatter_is_no_repair(level):
    """Valves that do not wear, with the scatter of an estimate, a share of S."""
    falls = [
        history_since_fall(
            DAYS.tolist(),
            (level + (0.05 + 0.04 * level) * np.random.default_rng(seed).standard_normal(30)),
        ).fall
        for seed in range(60)
    ]
    assert falls == [None] * 60


def test_of_two_repairs_the_last_one_counts():
    """The history begins with the stem that is there now."""
    S = np.tile(np.linspace(0.4, 2.0, 10), 3)
    assert history_since_fall(DAYS.tolist(), S.tolist()).fall.first == 20.0


@pytest.mark.parametrize("n", range(4))
def test_short_histories_are_as_they_are(n):
    """Nothing to compare."""
    since = history_since_fall(DAYS[:n].tolist(), worn()[:n].tolist())
    assert (since.fall, since.unsettled, len(since.days)) == (None, False, n)
