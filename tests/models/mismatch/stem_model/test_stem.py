"""The stem's kernel: canonical where neutral, and each addition as computed by hand."""

from __future__ import annotations

import inspect

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stemwatch.models.mismatch.stem_model import stem as stem_number
from stemwatch.models.mismatch.stem_model.kernel import Record, Scoring, follow
from stemwatch.models.mismatch.stem_model.lane_rows import LANES
from stemwatch.models.mismatch.stem_model.stem import Stem, Stems, places
from stemwatch.models.stickslip import kernel
from stemwatch.models.stickslip.evaluator import ONLY_WHEN_TURNING
from tests.models.mismatch.fitted_chain import followed

GRID = 64.0  # all in 64ths of a percent: sums are exact, and ties are ties in every order
numbers = st.integers(-6 * 64, 6 * 64)
# Held, ramped and jumping commands about mid-travel, percent.
commands = st.lists(
    st.tuples(numbers, st.integers(1, 6), st.sampled_from(["jump", "ramp"])),
    min_size=2,
    max_size=25,
).map(lambda parts: made(parts))
widths = st.integers(0, 8 * 64).map(lambda i: i / GRID)
jumps = st.integers(0, 12).map(lambda i: i / 8.0)  # J/S; above 1 the stem overshoots


def made(parts):
    """(n,) a command of pieces: how far, over how many samples, at once or evenly."""
    steps = [0]
    for far, over, way in parts:
        steps += [far, *[0] * over] if way == "jump" else [far] * over
    # Turned back at the ends rather than clipped, so that all steps remain on the grid.
    place = np.cumsum(steps) / GRID
    return 50.0 + np.abs((place + 40.0) % 160.0 - 80.0) - 40.0


def run(p, *, mv=None, marks=None, stem=None, window=0.0, up=None, down=None, dt=1.0, **values):
    """MV and ``early_late`` of a run; ``values`` are numbers of the stem by their names."""
    p = np.asarray(p, dtype=float)
    stem = stem or Stem.neutral(p.size, dt)
    for name, value in values.items():
        stem.numbers[getattr(stem_number, name)] = value
    if marks is None:
        marks = np.zeros(p.size, dtype=np.uint8)
        marks[0] = kernel.START
    mv = p if mv is None else np.asarray(mv, dtype=float)
    seen = [np.asarray(upcoming(p.size, item)) for item in (up, down)]
    out, early_late, _ = followed(stem, p, mv, marks, seen, window)
    return out, early_late


def upcoming(n, onsets):
    """(n,) the next of ``onsets`` at or after each sample, n where none is left."""
    return np.array([min((o for o in onsets or () if o >= k), default=n) for k in range(n)])


@given(
    commands,
    widths,
    jumps,
    st.sampled_from([0.0, 0.5, 4.0, np.inf, ONLY_WHEN_TURNING]),
    st.integers(-64, 64),
    st.sampled_from([0.5, 1.0, 1.25]),
    st.data(),
)
@settings(max_examples=150, deadline=None)
def test_without_additions_it_is_the_canonical_element(op, S, ratio, restick, zero, gain, data):
    """Sample for sample the published element, whatever the command, S, J, gain and restarts."""
    start = np.zeros(op.size, dtype=np.uint8)
    start[[0, data.draw(st.integers(0, op.size - 1))]] = kernel.START
    mv = op + data.draw(st.integers(-400, 400)) / GRID
    q = np.zeros(kernel.N_PARAMETERS)
    q[[kernel.S, kernel.J, kernel.GAIN, kernel.RESTICK]] = S, S * ratio, gain, restick
    q[[kernel.RATE_UP, kernel.RATE_DOWN]] = np.inf
    q[kernel.ZERO] = zero / GRID + 50.0 * (1.0 - gain)  # the kernel's gain turns about 0 %
    expected = np.empty(op.size)
    kernel.simulate(op, mv, start, 1.0, q, expected)
    seen, early_late = run(
        op, mv=mv, marks=start, S=S, J=S * ratio, RESTICK=restick, GAIN=gain, ZERO=zero / GRID
    )
    np.testing.assert_allclose(seen, expected, rtol=0.0, atol=1e-9)
    assert not early_late.any()


def he(p, S, J):
    """He's element: every sample begins at rest, and goes to ``p - d fd`` beyond ``fs``."""
    fs, fd = 0.5 * (S + J), 0.5 * (S - J)
    x = [p[0]]
    for force in p[1:]:
        gap = force - x[-1]
        x.append(force - np.sign(gap) * fd if abs(gap) > fs else x[-1])
    return np.array(x)


@given(commands, widths, jumps)
@settings(max_examples=60, deadline=None)
def test_at_a_high_speed_of_sticking_it_sticks_at_every_sample(op, S, ratio):
    """With a speed of sticking that no command reaches, the stem is He's element."""
    seen, _ = run(op, S=S, J=S * ratio, RESTICK=1e6)
    np.testing.assert_allclose(seen, he(op, S, S * ratio), rtol=0.0, atol=1e-9)


def test_a_command_slower_than_the_speed_of_sticking_moves_the_stem_by_jumps():
    """At 2 %/s of sticking, a ramp of 1 %/s is followed in jumps, one of 3 %/s smoothly."""
    slow, fast = 20.0 + np.arange(61.0), 20.0 + 3.0 * np.arange(21.0)
    jumps, _ = run(slow, S=6.0, J=2.0, RESTICK=2.0)
    moved = np.diff(jumps)
    # From fd = 2 behind the command to beyond fs = 4: three samples, of which the last moves it.
    assert {0.0, 3.0} == set(np.unique(moved[8:]).round(9).tolist())
    smooth, _ = run(fast, S=6.0, J=2.0, RESTICK=2.0)
    np.testing.assert_allclose(smooth[5:], fast[5:] - 2.0, atol=1e-9)


def test_a_moving_stem_starts_again_from_the_reading_after_a_gap():
    """START takes the whole state from the reading, within the band that friction allows."""
    p = np.concatenate((np.linspace(40.0, 60.0, 21), np.full(9, 50.0)))
    marks = np.zeros(30, dtype=np.uint8)
    marks[[0, 21]] = kernel.START
    near, _ = run(p, mv=np.full(30, 51.0), marks=marks, S=4.0, J=1.0)
    np.testing.assert_allclose(near[21:], 51.0, atol=1e-12)
    far, _ = run(p, mv=np.full(30, 80.0), marks=marks, S=4.0, J=1.0)
    np.testing.assert_allclose(far[21:], 52.5, atol=1e-12)


def test_a_resting_stem_is_put_where_the_reading_was_and_a_moving_one_is_left_alone():
    """RESYNC takes the reading of the sample before, for a stem that rests."""
    p = np.full(10, 50.0)
    mv = np.linspace(49.0, 49.9, 10)
    marks = np.zeros(10, dtype=np.uint8)
    marks[[0, 5]] = kernel.START, kernel.RESYNC
    rested, _ = run(p, mv=mv, marks=marks, S=4.0, J=1.0)
    np.testing.assert_allclose(rested, [*[mv[0]] * 5, *[mv[4]] * 5], atol=1e-12)
    ramp = np.linspace(50.0, 70.0, 10)
    moving, _ = run(ramp, mv=mv, marks=marks, S=4.0, J=1.0)
    np.testing.assert_allclose(moving[3:], ramp[3:] - 1.5, atol=1e-9)


def test_a_stem_that_its_rest_holds_is_left_where_it_is():
    """RESYNC leaves a stem where the reading was if the force is beyond its own level, but not
    beyond what its rest has added to that; beyond both it is put at their edge."""
    p = np.concatenate(([50.0] * 20, np.linspace(50.0, 53.5, 20), [53.5] * 10))
    marks = np.zeros(p.size, dtype=np.uint8)
    marks[[0, 45]] = kernel.START, kernel.RESYNC
    for read, place in ((50.0, 50.0), (45.0, 53.5 - 4.5)):
        stem = Stem.neutral(p.size, 1.0)
        stem.numbers[stem_number.BY_REST] = 1.0
        stem.breakaway[:] = np.minimum(0.1 * np.arange(p.size + 1), 2.0)
        mv = np.full(p.size, 50.0)
        mv[44] = read
        seen, _ = run(p, mv=mv, marks=marks, stem=stem, S=4.0, J=1.0)
        np.testing.assert_allclose(seen[:45], 50.0, atol=1e-12)
        np.testing.assert_allclose(seen[45], place, atol=1e-12)


def test_with_drag_the_stem_goes_on_after_the_command_has_turned():
    """The lag to ``p - fd`` decays by exp(-1/5) a sample, whether the command has turned or not."""
    up = np.concatenate(([40.0], np.full(5, 60.0)))
    p = np.concatenate((up, 60.0 - 0.2 * np.arange(1.0, 7.0)))
    seen, _ = run(p, S=4.0, J=2.0, DRAG_S=5.0)
    x, expected = 40.0, [40.0]
    for force in p[1:]:
        x += (1.0 - np.exp(-0.2)) * (force - x - 1.0)
        expected.append(x)
    np.testing.assert_allclose(seen, expected, atol=1e-9)
    assert (np.diff(seen[5:]) > 0.0).all()


@given(commands, widths, jumps, st.floats(0.5, 8.0), st.floats(0.05, 2.0), st.floats(0.2, 3.0))
@settings(max_examples=80, deadline=None)
def test_a_stem_that_goes_on_moving_is_faster_than_the_speed_of_sticking(
    p, S, ratio, drag_s, restick, dt
):
    """Each step after the first of a motion exceeds the speed of sticking times the interval."""
    seen, _ = run(p, S=S, J=S * ratio, DRAG_S=drag_s, RESTICK=restick, dt=dt)
    step = np.abs(np.diff(seen))
    goes_on = (step[1:] > 0.0) & (step[:-1] > 0.0)
    # A stem that stuck may break away again at once, by a gap of more than fs - fd = J.
    share = 1.0 - np.exp(-dt / drag_s)
    least = min(restick * dt, share * S * ratio)
    assert (step[1:][goes_on] >= least - 1e-9).all()


@given(commands, widths, jumps, st.floats(0.0, 4.0), st.floats(0.0, 6.0), st.floats(-0.1, 0.1))
@settings(max_examples=80, deadline=None)
def test_stops_are_never_passed(p, S, ratio, drag_s, play, creep):
    """Between stops at 45 and 54 % stem and reading stay there, whatever pushes."""
    inside = np.clip(p, 45.0, 54.0)
    stops = {"STOP_LOW": 45.0, "STOP_HIGH": 54.0, "CREEP": creep}
    seen, _ = run(p, mv=inside, S=S, J=S * ratio, DRAG_S=drag_s, PLAY=play, **stops)
    # The first sample is the reading as it was seen; play lets it stand half of it further out.
    assert 45.0 - 0.5 * play - 1e-9 <= seen[1:].min()
    assert seen[1:].max() <= 54.0 + 0.5 * play + 1e-9
    tight, _ = run(p, mv=inside, S=S, J=S * ratio, DRAG_S=drag_s, **stops)
    assert 45.0 - 1e-9 <= tight[1:].min()
    assert tight[1:].max() <= 54.0 + 1e-9


def test_at_a_stop_the_force_goes_on_and_the_stem_leaves_when_it_has_come_back():
    """Held at 55 % while OP goes to 70, the stem leaves only when OP is ``fs`` below it."""
    p = np.concatenate((np.arange(50.0, 71.0), np.arange(69.0, 39.0, -1.0)))
    seen, _ = run(p, S=4.0, J=0.0, STOP_HIGH=55.0)
    leaves = int(np.flatnonzero(np.diff(seen) < 0.0)[0]) + 1
    assert 55.0 == seen.max()
    assert 52.0 == p[leaves]  # the first beyond 55 - 2


@given(commands, st.integers(0, 5 * 64).map(lambda i: i / GRID))
@settings(max_examples=80, deadline=None)
def test_play_is_the_backlash_of_a_reading_without_friction(p, play):
    """A frictionless stem with play b is the play operator: the reading is dragged by b/2."""
    z, expected = p[0], []
    for x in p:
        z = min(max(z, x - 0.5 * play), x + 0.5 * play)
        expected.append(z)
    seen, _ = run(p, PLAY=play)
    np.testing.assert_allclose(seen, expected, atol=1e-9)


@given(commands, st.floats(-0.05, 0.05))
@settings(max_examples=40, deadline=None)
def test_a_resting_stem_creeps_and_nothing_else(p, creep):
    """Under a held command a stuck stem moves by its creep each sample until it breaks away."""
    held = np.full(20, p[0])
    seen, _ = run(held, S=8.0, J=1.0, CREEP=creep)
    np.testing.assert_allclose(seen, p[0] + creep * np.arange(20), atol=1e-9)


def test_the_wander_of_the_reading_is_added_only_where_it_is_switched_on():
    """The table moves the reading, not the stem; it has no effect while BY_TIME is 0."""
    p = made([(300, 4, "ramp"), (-200, 6, "jump"), (90, 5, "ramp")])
    stem = Stem.neutral(p.size, 1.0)
    stem.wander[: p.size] = np.linspace(-2.0, 3.0, p.size)
    plain, _ = run(p, mv=p, S=3.0, J=1.0)
    asleep, _ = run(p, mv=p, stem=stem, S=3.0, J=1.0)
    np.testing.assert_array_equal(asleep, plain)
    awake, _ = run(p, mv=p + stem.wander[: p.size], stem=stem, S=3.0, J=1.0, BY_TIME=1.0)
    np.testing.assert_allclose(awake - plain, stem.wander[: p.size], atol=1e-9)


def test_clear_makes_used_stems_neutral_again():
    """After tables and numbers were used, ``clear`` leaves no trace of them, and others alone."""
    p = made([(300, 4, "ramp"), (-200, 6, "jump"), (90, 5, "ramp")])
    used, fresh = Stems.neutral(3, p.size, 1.0), Stem.neutral(p.size, 1.0)
    for table in used.tables:
        table[:] = 1.0
    used.numbers[:] = 1.0
    used.clear(2)
    np.testing.assert_array_equal(used.numbers[:2], [fresh.numbers] * 2)
    for table in used.tables:
        assert not table[:2].any()
    for kept in (used.numbers, *used.tables):
        assert (kept[2] == 1.0).all()


def test_tables_over_place_are_read_between_their_entries_and_held_beyond():
    """Friction 0 at 50 and 1 % at 51 is half a percent at 50.5; beyond 120 % it is the last."""
    stem = Stem.neutral(3, 1.0)
    stem.friction[:] = np.clip(places() - 50.0, 0.0, None)

    def breaks(x, by):
        marks = np.zeros(3, dtype=np.uint8)
        marks[0] = kernel.START
        seen, _ = run([x, x + by, x + by], stem=stem, marks=marks, S=2.0, J=2.0, BY_PLACE=1.0)
        return seen[1] != seen[0]

    assert breaks(50.5, 2.51)
    assert not breaks(50.5, 2.49)
    assert breaks(130.0, 72.01)
    assert not breaks(130.0, 71.9)


class TestAssimilation:
    """A ramp of 0.1 %/s from rest, fs = 3: left alone, the stem lets go at sample 31."""

    P = 50.0 + 0.1 * np.arange(250.0)
    WINDOW = 0.35

    def let_go(self, *onsets, p=None, side="up", window=WINDOW):
        """First sample of motion, and ``early_late`` there."""
        p = self.P if p is None else p
        seen, late = run(p, S=4.0, J=2.0, window=window, **{side: onsets})
        k = int(np.flatnonzero(np.diff(seen))[0]) + 1
        assert not np.delete(late, k).any()
        return k, float(late[k])

    def test_left_alone_it_lets_go_beyond_its_level(self):
        """Without onsets the window changes nothing."""
        assert (31, 0.0) == self.let_go()
        assert (31, 0.0) == self.let_go(window=0.0)

    @pytest.mark.parametrize(("onset", "force"), [(25, 2.5), (20, 2.0), (29, 2.9)])
    def test_an_early_breakaway_happens_where_it_was_seen(self, onset, force):
        """Its loss is that of the force's distance below the level."""
        assert (onset, pytest.approx(force - 3.0)) == self.let_go(onset)

    @pytest.mark.parametrize("onset", [33, 36, 40])
    def test_a_late_breakaway_happens_where_it_was_seen(self, onset):
        """Its loss is that of the distance beyond the level in the sample before."""
        assert (onset, pytest.approx(0.1 * (onset - 1) - 3.0)) == self.let_go(onset)

    def test_between_two_samples_it_is_neither_early_nor_late(self):
        """Where the level lies between the forces of two samples, nothing is charged."""
        step = np.concatenate((np.full(10, 50.0), np.full(10, 52.0), np.full(10, 54.0)))
        assert (20, 0.0) == self.let_go(20, p=step)

    @pytest.mark.parametrize("onset", [5, 19])
    def test_outside_the_window_it_does_not_let_go_early(self, onset):
        """A force below (1 - window) fs moves no stem; it goes at its level, uncharged."""
        assert (31, 0.0) == self.let_go(onset)

    def test_it_does_not_wait_beyond_the_window(self):
        """An onset at 4.5 % is beyond (1 + window) fs = 4.05 %: it goes there, uncharged."""
        assert (41, 0.0) == self.let_go(45)

    def test_it_waits_no_longer_than_its_patience(self):
        """An onset three minutes away does not hold the stem."""
        slow = np.concatenate((self.P[:32], np.full(300, self.P[31])))
        assert (31, 0.0) == self.let_go(31 + 180, p=slow)
        assert (31 + 100, pytest.approx(0.1)) == self.let_go(31 + 100, p=slow)

    def test_the_end_of_the_record_is_no_onset(self):
        """In the last minutes of a record, too, a stem breaks away at its level where no onset is
        seen.
        """
        assert (31, 0.0) == self.let_go(p=self.P[:80])

    def test_an_onset_the_other_way_is_not_its_own(self):
        """A falling onset does not let a stem go that is pushed up."""
        assert (31, 0.0) == self.let_go(25, side="down")
        mirrored = 100.0 - self.P
        assert (25, pytest.approx(-0.5)) == self.let_go(25, p=mirrored, side="down")


@given(commands, widths, jumps, st.lists(st.integers(0, 60)), st.lists(st.integers(0, 60)))
@settings(max_examples=60, deadline=None)
def test_a_free_run_never_looks_at_onsets(p, S, ratio, up, down):
    """With window 0 the breakaways that were seen change nothing and nothing is charged."""
    blind, _ = run(p, S=S, J=S * ratio)
    seen, late = run(p, S=S, J=S * ratio, up=up, down=down)
    np.testing.assert_array_equal(seen, blind)
    assert not late.any()


def drawn_runs(rng, count, n):
    """Forces, stems with every addition in some of them, a record, and how it is scored."""
    p = 50.0 + np.cumsum(rng.normal(0.0, 0.4, (3, n)), axis=1)
    marks = np.zeros(n, dtype=np.uint8)
    marks[[0, n // 2]] = kernel.START
    marks[[n // 4, n // 3]] = kernel.RESYNC
    stems = Stems.neutral(count, n, 1.0)
    ranges = {
        "S": (0.0, 5.0), "J": (0.0, 4.0), "ASYMMETRY": (-0.4, 0.4), "GROWTH": (-0.3, 1.0),
        "CREEP": (-0.01, 0.01), "DRAG_S": (0.0, 4.0), "RESTICK": (0.0, 1.0), "PLAY": (0.0, 1.0),
        "STOP_LOW": (20.0, 49.0), "STOP_HIGH": (51.0, 80.0), "ZERO": (-1.0, 1.0),
        "DRIFT": (-1.0, 1.0), "BY_PLACE": (1.0, 1.0), "BY_REST": (1.0, 1.0), "BY_TIME": (1.0, 1.0),
    }  # fmt: skip
    for stem in stems.each:
        for name, (low, high) in ranges.items():
            if name in ("S", "J") or rng.random() < 0.3:
                stem.numbers[getattr(stem_number, name)] = rng.uniform(low, high)
        stem.friction[:] = 0.5 * np.sin(places() / rng.uniform(2.0, 9.0))
        stem.force[:] = 0.02 * (places() - 50.0)
        stem.breakaway[:] = 0.5 * (1.0 - np.exp(-np.arange(n + 1) / 20.0))
        stem.wander[:] = 0.3 * np.sin(np.arange(n + 1) / 30.0)
    up, down = (sorted(rng.choice(n, 9, replace=False)) for _ in range(2))
    mv = p[0] + rng.normal(0.0, 1.0, n)
    record = Record(mv, marks, upcoming(n, up), upcoming(n, down), 1.0, 0.35)
    block = np.where(rng.random(n) < 0.1, -1, np.arange(n) * 4 // n)
    scoring = Scoring(block, np.where(rng.random(n) < 0.2, 0.3, 0.0), 0.4, 0.2, 3.0)
    return p, stems, record, scoring


@pytest.mark.parametrize(("seed", "count"), [*enumerate([1, 2, 5, 8, 17, LANES])])
def test_a_run_does_not_depend_on_the_other_lanes(seed, count):
    """Stems run side by side; neither run nor loss depends on the other lanes, nor the loss on
    whether runs are kept.
    """
    rng = np.random.default_rng(seed)
    n = 333
    p, stems, record, scoring = drawn_runs(rng, count, n)
    rows = rng.integers(0, 3, count)
    losses, out, late = np.empty((count, 4)), np.empty((n, count)), np.zeros((count, n))
    follow(p, rows, *stems.first(count), record, scoring, losses, out, late)
    assert np.isfinite(out).all()
    seen = record.next_up, record.next_down
    for i, stem in enumerate(stems.each):
        alone = followed(stem, p[rows[i]], record.mv, record.marks, seen, 0.35, scoring, 4)
        for together, item in zip((out[:, i], late[i], losses[i]), alone, strict=True):
            np.testing.assert_array_equal(together, item)
    only, nothing = np.empty((count, 4)), np.empty((0, 0))
    follow(p, rows, *stems.first(count), record, scoring, only, nothing, nothing)
    np.testing.assert_array_equal(only, losses)


@pytest.mark.parametrize("changing", [True, False])
@pytest.mark.parametrize("seed", range(4))
def test_stems_that_only_slide_run_to_the_last_bit_as_beside_one_with_play(seed, changing):
    """What is left out where no lane needs it changes nothing, whether levels change or not."""
    p, stems, record, scoring = drawn_runs(np.random.default_rng(seed), 8, 333)
    for name in ("ASYMMETRY", "CREEP", "PLAY"):
        stems.numbers[:, getattr(stem_number, name)] = 0.0
    stems.numbers[:, stem_number.STOP_LOW] = -np.inf
    stems.numbers[:, stem_number.STOP_HIGH] = np.inf
    for name in () if changing else ("GROWTH", "DRIFT", "BY_PLACE", "BY_REST", "BY_TIME"):
        stems.numbers[:, getattr(stem_number, name)] = 0.0
    stems.numbers[7, stem_number.PLAY] = 0.5
    results = []
    for count in (8, 7):
        rows = np.arange(count) % 3
        losses, out, late = np.empty((count, 4)), np.empty((333, count)), np.zeros((count, 333))
        follow(p, rows, *stems.first(count), record, scoring, losses, out, late)
        results.append((losses[:7], out[:, :7], late[:7]))
    for beside, among_themselves in zip(*results, strict=True):
        np.testing.assert_array_equal(among_themselves, beside)


@pytest.mark.parametrize("alone", [True, False])
@pytest.mark.parametrize("seed", range(4))
def test_how_far_a_spring_lets_a_stem_slide_is_left_out_where_it_surely_holds(seed, alone):
    """The same run to the last bit where it is asked at every sample, as it is where the rest
    before tells; here that adds nothing."""
    rng = np.random.default_rng(200 + seed)
    p, stems, record, scoring = drawn_runs(rng, 8, 333)
    for name in ("ASYMMETRY", "CREEP", "PLAY") if alone else ():
        stems.numbers[:, getattr(stem_number, name)] = 0.0
    if alone:
        stems.numbers[:, stem_number.STOP_LOW] = -np.inf
        stems.numbers[:, stem_number.STOP_HIGH] = np.inf
    stems.numbers[:, stem_number.BY_PLACE] = 1.0
    stems.numbers[:, stem_number.HYSTERESIS] = rng.uniform(0.2, 3.0, 8)
    stems.numbers[:, stem_number.WAY] = rng.uniform(0.5, 6.0, 8)
    for stem in stems.each:
        stem.breakaway[:] = 0.0
    results = []
    for rest_tells in (0.0, 1.0):
        stems.numbers[:, stem_number.BY_REST] = rest_tells
        losses, out, late = np.empty((8, 4)), np.empty((333, 8)), np.zeros((8, 333))
        follow(p, np.arange(8) % 3, *stems.first(8), record, scoring, losses, out, late)
        results.append((losses, out, late))
    assert np.ptp(results[0][1], axis=0).min() > 0.5  # they move
    for left_out, asked in zip(*results, strict=True):
        np.testing.assert_array_equal(left_out, asked)


@pytest.mark.parametrize("seed", range(3))
def test_compiled_is_interpreted(seed):
    """The compiled kernel gives what the same Python gives uncompiled, additions included."""
    rng = np.random.default_rng(100 + seed)
    p, stems, record, scoring = drawn_runs(rng, 3, 90)
    rows = np.arange(3)
    matching = []
    for function in (follow, inspect.unwrap(follow)):
        losses, out, late = np.empty((3, 4)), np.zeros((90, 3)), np.zeros((3, 90))
        function(p, rows, *stems.first(3), record, scoring, losses, out, late)
        matching.append((losses, out, late))
    for compiled, plain in zip(*matching, strict=True):
        np.testing.assert_allclose(compiled, plain, rtol=1e-9, atol=1e-12)


@given(st.integers(0, 2**20), st.sampled_from([0.05, 1.0, 1e-60]), st.sampled_from([0.7, 3.0]))
@settings(max_examples=30, deadline=None)
def test_the_loss_of_a_block_is_cauchys_plus_what_the_breakaways_cost(seed, delta, event):
    """The product of many samples under one logarithm is the sum of their logarithms; a drawn
    value is charged from the edge of its slack on."""
    rng = np.random.default_rng(seed)
    n = 400
    p, stems, record, _ = drawn_runs(rng, 1, n)
    block = np.repeat([0, -1, 1, 2], 100)
    slack = np.where(rng.random(n) < 0.5, 0.4, 0.0)
    scoring = Scoring(block, slack, delta, 0.2, event)
    seen = record.next_up, record.next_down
    simulated, late, losses = followed(
        stems.each[0], p[0], record.mv, record.marks, seen, 0.35, scoring, 4
    )
    off = np.maximum(np.abs(record.mv - simulated) - slack, 0.0)
    of_sample = np.log1p((off / delta) ** 2) + event * np.log1p((late / 0.2) ** 2)
    expected = [delta**2 * of_sample[block == b].sum() for b in range(4)]
    np.testing.assert_allclose(losses, expected, rtol=1e-9)
