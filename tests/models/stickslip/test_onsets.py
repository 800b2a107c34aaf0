"""Breakaways are seen in the position alone: where they are, and nowhere else."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from stemwatch.models.stickslip.onsets import Onsets, onsets

SIGMA = 0.05
rests = st.lists(
    st.tuples(
        st.integers(15, 40), st.floats(0.7, 5.0), st.sampled_from([-1.0, 1.0]), st.integers(1, 4)
    ),
    min_size=1,
    max_size=8,
)


def noisy(place, seed, sigma=SIGMA):
    """The place read with noise."""
    return place + sigma * np.random.default_rng(seed).standard_normal(np.size(place))


def seen(mv, usable=None, sigma=SIGMA, interval_s=1.0):
    """The onsets of a position that is usable throughout unless said."""
    mv = np.asarray(mv, dtype=float)
    usable = np.ones(mv.size, dtype=bool) if usable is None else usable
    return onsets(mv, usable, sigma, interval_s)


def steps_from_rest(parts):
    """A position that rests, then moves at ``rate`` for some samples, again and again; where."""
    place, at, sides, levels = [50.0], [], [], []
    for rest, rate, side, over in parts:
        place += [place[-1]] * rest
        at.append(len(place))
        sides.append(side)
        levels.append(place[-1])
        place += (place[-1] + side * rate * np.arange(1, over + 1)).tolist()
    place += [place[-1]] * 15
    return np.array(place), at, sides, levels


@given(rests, st.integers(0, 2**20))
@settings(max_examples=120, deadline=None)
def test_a_step_from_rest_is_found_at_its_first_sample(parts, seed):
    """Under noise every departure is found where it begins, with its side and place; no other."""
    place, at, sides, levels = steps_from_rest(parts)
    result = seen(noisy(place, seed))
    assert at == result.at.tolist()
    assert sides == result.side.tolist()
    np.testing.assert_allclose(result.place, levels, atol=4.0 * SIGMA)
    assert (result.rested <= [rest + 1 for rest, *_ in parts]).all()


@given(rests, st.integers(0, 2**20), st.sampled_from([0.25, 0.4, 0.5]))
@settings(max_examples=40, deadline=None)
@example([(40, 2.0, 1.0, 2)], 0, 0.25)
def test_a_rest_of_many_samples_has_its_place(parts, seed, interval_s):
    """Where three seconds are more samples than a resting place is a mean of: the same onsets."""
    parts = [(rest + 40, *other) for rest, *other in parts]
    place, at, sides, levels = steps_from_rest(parts)
    result = seen(noisy(place, seed), interval_s=interval_s)
    assert at == result.at.tolist()
    assert sides == result.side.tolist()
    np.testing.assert_allclose(result.place, levels, atol=4.0 * SIGMA)


@given(rests, st.integers(0, 2**20))
@settings(max_examples=40, deadline=None)
def test_up_and_down_are_alike(parts, seed):
    """The mirrored position has the same onsets with their sides turned."""
    mv = noisy(steps_from_rest(parts)[0], seed)
    up, down = seen(mv), seen(-mv)
    np.testing.assert_array_equal(up.at, down.at)
    np.testing.assert_array_equal(up.side, -down.side)


def test_a_slow_departure_is_found_when_it_leaves_the_noise():
    """At 0.1 % a sample the onset comes within a few samples of the first motion."""
    place = np.concatenate((np.full(40, 50.0), 50.0 + 0.1 * np.arange(1.0, 20.0)))
    late = [int(seen(noisy(place, seed)).at[0]) - 40 for seed in range(50)]
    assert 0 <= min(late)
    assert max(late) <= 6


@pytest.mark.parametrize("sigma", [0.005, 0.05, 0.5])
def test_noise_alone_moves_no_stem(sigma):
    """In a hundred thousand samples of noise at most one onset is seen."""
    result = seen(noisy(np.full(100_000, 50.0), 1, sigma), sigma=sigma)
    assert result.at.size <= 1


@pytest.mark.parametrize(("creep", "most"), [(0.01, 0), (-0.01, 0), (0.02, 10), (-0.02, 10)])
def test_a_creeping_stem_rests(creep, most):
    """At a hundredth of a percent a second no onset is seen in hours; at two, hardly any."""
    mv = [noisy(50.0 + creep * np.arange(2000.0), seed) for seed in range(5)]
    assert sum(seen(item).at.size for item in mv) <= most


def test_a_moving_stem_has_no_onsets():
    """A ramp and a triangle have no rest from which anything could begin."""
    t = np.arange(2000.0)
    assert not seen(noisy(20.0 + 0.4 * t % 60.0, 1)).at.size
    assert not seen(noisy(50.0 + np.abs(0.4 * t % 40.0 - 20.0), 1)).at.size


@given(rests, st.integers(0, 2**20), st.data())
@settings(max_examples=60, deadline=None)
def test_what_happens_in_a_gap_is_not_seen(parts, seed, data):
    """No onset lies in a gap or right after it; those that rested after it or before it stay."""
    place, *_ = steps_from_rest(parts)
    mv = noisy(place, seed)
    first = data.draw(st.integers(1, mv.size - 10))
    last = data.draw(st.integers(first + 1, min(first + 30, mv.size)))
    usable = np.ones(mv.size, dtype=bool)
    usable[first:last] = False
    mv[first:last] = mv[first - 1]
    result, complete = seen(mv, usable), seen(noisy(place, seed))
    assert not ((result.at >= first) & (result.at < last + 3)).any()
    before, after = complete.at[complete.at < first - 1], complete.at[complete.at > last + 20]
    np.testing.assert_array_equal(result.at[result.at < first - 1], before)
    assert set(after) <= set(result.at)


def test_a_pause_is_no_rest():
    """Ten samples a second: a stem that pauses for one second has not rested; five are a rest."""
    for pause_s, count in ((1.0, 1), (5.0, 2)):
        place = np.concatenate(
            (
                np.full(80, 50.0),
                np.linspace(50.5, 55.0, 10),
                np.full(round(10 * pause_s), 55.0),
                np.linspace(55.5, 60.0, 10),
                np.full(5, 60.0),
            )
        )
        assert count == seen(noisy(place, 3), interval_s=0.1).at.size


@given(st.lists(st.integers(0, 59), unique=True), st.integers(0, 2**20))
@settings(max_examples=40, deadline=None)
def test_upcoming_is_the_next_onset_of_a_side(array, seed):
    """At each sample, the first onset at or after it, or n where none is left."""
    array = np.array(sorted(array), dtype=np.int64)
    side = np.random.default_rng(seed).choice([-1.0, 1.0], array.size)
    result = Onsets(array, side, np.zeros(array.size, np.int64), np.zeros(array.size))
    for wanted, upcoming in zip((1.0, -1.0), result.upcoming(60), strict=True):
        mine = array[side == wanted]
        expected = [min((int(o) for o in mine if o >= k), default=60) for k in range(60)]
        assert expected == upcoming.tolist()
