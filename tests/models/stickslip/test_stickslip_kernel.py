"""The stick-slip element against its published relatives, written here independently."""

from __future__ import annotations

import inspect
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stemwatch.models.stickslip import kernel

SAMPLES = 1500
# Steps of these signals divide no threshold below exactly, so that > and >= cannot differ.
PAIRS = [(5.0123, 2.0071), (6.0123, 0.0), (4.0123, 4.0123), (2.0123, 5.0071), (0.0, 0.0)]


def chosen(S, J, *, dead_time_s=0.0, lag=(0.0, 0.0), rate=(np.inf, np.inf), restick=0.0):
    """The kernel's parameter vector, spelt out by name."""
    q = np.zeros(kernel.N_PARAMETERS)
    q[kernel.S], q[kernel.J], q[kernel.DEAD_TIME_S] = S, J, dead_time_s
    q[kernel.LAG_UP_S], q[kernel.LAG_DOWN_S] = lag
    q[kernel.RATE_UP], q[kernel.RATE_DOWN] = rate
    q[kernel.GAIN], q[kernel.RESTICK] = 1.0, restick
    return q


def run(u, S, J, y0, *, dt=1.0, **how):
    """Free run from ``y0``, started once."""
    marks = np.zeros(u.size, dtype=np.uint8)
    marks[0] = kernel.START
    out = np.empty(u.size)
    kernel.simulate(u, np.full(u.size, y0), marks, dt, chosen(S, J, **how), out)
    return out


def signals():
    """The six input signals on which the published models are compared."""
    k = np.arange(SAMPLES)
    rng = np.random.default_rng(3)
    sine = 50.0 + 9.87654 * np.sin(2 * np.pi * (k + 0.3) / 150.0)
    ar = np.zeros(SAMPLES)
    for i in range(1, SAMPLES):
        ar[i] = 0.98 * ar[i - 1] + rng.standard_normal()
    return {
        "triangle": 50.0 + 9.87654 * (2.0 * np.abs((k / 100.0) % 2.0 - 1.0) - 1.0),
        "sine": sine,
        "random walk": 50.0 + np.cumsum(rng.standard_normal(SAMPLES) * 0.5),
        "noisy sine": sine + 0.2 * rng.standard_normal(SAMPLES),
        "quantised sine": np.round(sine / 0.5) * 0.5,
        "autoregressive": 50.0 + ar,
    }


SIGNALS = signals()
everywhere = pytest.mark.parametrize("name", sorted(SIGNALS))
for_pairs = pytest.mark.parametrize(("S", "J"), PAIRS)


@st.composite
def some_run(draw):
    """A signal, S, J and a first position within the stick band; no threshold ends in a tie."""
    u = SIGNALS[draw(st.sampled_from(sorted(SIGNALS)))][: draw(st.integers(2, 400))]
    u = draw(st.sampled_from([0.37, 1.0, 2.3])) * u
    S = 0.05 * draw(st.integers(0, 240)) + 0.0123457
    J = 0.05 * draw(st.integers(0, 240)) + 0.0071357
    y0 = u[0] + draw(st.floats(-0.49, 0.49)) * (S + J) + 0.0031419
    return u, S, J, min(y0, u[0] + 0.499 * (S + J))


def kano(u, S, J, y0):
    """Kano's flow (2004): the state is the input ``us`` at which the stem last stopped."""
    fd = 0.5 * (S - J)
    d, us, stopped, y = 1, y0 + fd, True, [y0]
    for before, now in pairwise(u):
        if not stopped and (now - before) * d <= 0:
            us, stopped = before, True
        if stopped and -d * (now - us) > S:
            d, stopped = -d, False
        elif stopped and d * (now - us) > J:
            stopped = False
        y.append(y[-1] if stopped else now - d * fd)
    return np.array(y)


def he(u, fs, fd, y0):
    """He's two-parameter model (2007): a residual force and no moving state."""
    force, y = u[0] - y0, [y0]
    for before, now in pairwise(u):
        force += now - before
        if abs(force) > fs:
            y.append(now - np.sign(force) * fd)
            force = np.sign(force) * fd
        else:
            y.append(y[-1])
    return np.array(y)


def play(u, width, y0):
    """The play operator: the stem is dragged by the ends of a slot of ``width``."""
    y = [y0]
    for now in u[1:]:
        y.append(min(max(y[-1], now - 0.5 * width), now + 0.5 * width))
    return np.array(y)


def asymmetric(u, S, J, shift, y0):
    """Friction levels larger by ``shift`` upward and smaller by it downward."""
    x, moving, d, y = y0, False, 1, [y0]
    for before, now in pairwise(u):
        if moving and d * (now - before) <= 0:
            moving = False
        force = now - x
        side = 1 if force > 0 else -1
        if not moving and abs(force) > 0.5 * (S + J) + side * shift:
            moving, d = True, side
        if moving:
            x = now - d * (0.5 * (S - J) + d * shift)
        y.append(x)
    return np.array(y)


def test_golden_vector():
    """Repeated samples, same-direction restarts and exact ties give the documented positions."""
    u = np.concatenate((np.arange(50.0, 58.0), np.arange(57.0, 60.0), np.arange(58.0, 50.0, -1.0)))
    u = np.concatenate((u, np.arange(52.0, 58.0)))
    expected = [50.0] * 4 + [52.5, 53.5, 54.5] + [55.5] * 11 + [52.5] * 6 + [55.5]
    assert expected == run(u, 5.0, 2.0, 50.0).tolist()


def test_golden_vector_of_he():
    """With a re-stick speed without limit the same inputs give He's documented staircase."""
    u = np.array([50, 51, 52, 53, 54, 55, 56, 57, 57, 58, 59], dtype=float)
    expected = [50.0] * 4 + [52.5] * 3 + [55.5] * 4
    assert expected == run(u, 5.0, 2.0, 50.0, restick=np.inf).tolist()


@everywhere
@for_pairs
def test_is_kano(name, S, J):
    """I1: Kano's model, whose state is where the input stopped, is the same element."""
    u = SIGNALS[name]
    np.testing.assert_allclose(run(u, S, J, u[0]), kano(u, S, J, u[0]), atol=1e-9)


@everywhere
@for_pairs
def test_always_resticking_is_he(name, S, J):
    """I4: an infinite re-stick speed is He's model, which has no moving state."""
    u = SIGNALS[name]
    expected = he(u, 0.5 * (S + J), 0.5 * (S - J), u[0])
    np.testing.assert_allclose(run(u, S, J, u[0], restick=np.inf), expected, atol=1e-9)


@everywhere
def test_without_jump_it_is_play(name):
    """I9: with J = 0 the element is the play operator of width S."""
    u = SIGNALS[name]
    np.testing.assert_allclose(run(u, 5.0123, 0.0, u[0]), play(u, 5.0123, u[0]), atol=1e-9)


@everywhere
def test_without_friction_it_is_the_command(name):
    """I10: S = J = 0 hands the command on."""
    u = SIGNALS[name]
    np.testing.assert_allclose(run(u, 0.0, 0.0, u[0]), u, atol=1e-12)


@settings(max_examples=60, deadline=None)
@given(some_run())
def test_kano_for_any_friction(case):
    """I1 for drawn S, J, signals and first positions."""
    u, S, J, y0 = case
    np.testing.assert_allclose(run(u, S, J, y0), kano(u, S, J, y0), atol=1e-9)


@settings(max_examples=60, deadline=None)
@given(some_run())
def test_odd_symmetry(case):
    """I11: the mirrored command moves the stem in the mirror."""
    u, S, J, y0 = case
    np.testing.assert_allclose(run(-u, S, J, -y0), -run(u, S, J, y0), atol=1e-9)


@settings(max_examples=60, deadline=None)
@given(some_run())
def test_scale(case):
    """I12: doubling command, S, J and first position doubles the stem's way."""
    u, S, J, y0 = case
    np.testing.assert_allclose(run(2 * u, 2 * S, 2 * J, 2 * y0), 2 * run(u, S, J, y0), atol=1e-9)


@settings(max_examples=60, deadline=None)
@given(some_run(), st.sampled_from([-32.0, 16.0]))
def test_translation(case, by):
    """I13: a shifted command shifts the stem."""
    u, S, J, y0 = case
    expected = run(u, S, J, y0) + by
    np.testing.assert_allclose(run(u + by, S, J, y0 + by), expected, atol=1e-9)


@settings(max_examples=60, deadline=None)
@given(some_run(), st.sampled_from([0.0, np.inf]))
def test_bound(case, restick):
    """I14: the stem is never further from its command than the breakaway level."""
    u, S, J, y0 = case
    assert np.max(np.abs(u - run(u, S, J, y0, restick=restick))) <= 0.5 * (S + J) + 1e-9


@settings(max_examples=60, deadline=None)
@given(some_run(), st.floats(-0.9, 0.9))
def test_asymmetric_levels_are_a_shift(case, share):
    """I15: friction that differs by direction is the symmetric element on a shifted command."""
    u, S, J, _ = case
    shift = share * 0.5 * (S + J)
    expected = asymmetric(u, S, J, shift, u[0] - shift)
    np.testing.assert_allclose(run(u - shift, S, J, u[0] - shift), expected, atol=1e-9)


@everywhere
@for_pairs
def test_dead_time_is_a_shift(name, S, J):
    """I18: a dead time of three samples delays the stem by three samples and changes nothing."""
    u = SIGNALS[name]
    late = run(u, S, J, u[0], dt=0.5, dead_time_s=1.5)
    np.testing.assert_allclose(late[3:], run(u, S, J, u[0], dt=0.5)[:-3], atol=1e-9)
    np.testing.assert_array_equal(late[:3], u[0])


def test_dead_time_between_samples():
    """A dead time of 1.25 samples is the straight line between the two commands around it."""
    u = SIGNALS["random walk"]
    between = np.concatenate(([u[0]], 0.75 * u[:-1] + 0.25 * np.concatenate((u[:1], u[:-2]))))
    np.testing.assert_allclose(
        run(u, 3.0123, 1.0071, u[0], dead_time_s=1.25),
        run(between, 3.0123, 1.0071, u[0]),
        atol=1e-9,
    )


@everywhere
@for_pairs
def test_neutral_actuator(name, S, J):
    """No dead time, no lag and a speed limit that is never reached leave the canonical element."""
    u = SIGNALS[name]
    neutral = run(u, S, J, u[0], dead_time_s=0.0, lag=(0.0, 0.0), rate=(1e6, 1e6))
    np.testing.assert_allclose(neutral, kano(u, S, J, u[0]), atol=1e-9)


@pytest.mark.parametrize("dt", [0.05, 1.0, 60.0])
def test_lag_is_the_exact_exponential(dt):
    """A lag follows a step as 1 - exp(-t/tau) at any sampling, with its own tau each way."""
    n, up, down = 200, 3.0, 8.0
    u = np.concatenate(([0.0], np.full(n, 10.0), np.zeros(n)))
    y = run(u, 0.0, 0.0, 0.0, dt=dt, lag=(up, down))
    t = np.arange(1, n + 1) * dt
    np.testing.assert_allclose(y[1 : n + 1], 10.0 * (1.0 - np.exp(-t / up)), atol=1e-9)
    np.testing.assert_allclose(y[n + 1 :], y[n] * np.exp(-t / down), atol=1e-9)


def test_rate_limit_is_a_straight_line():
    """A speed limit follows a step along a line, at its own speed each way."""
    u = np.concatenate(([0.0], np.full(20, 10.0), np.zeros(20)))
    y = run(u, 0.0, 0.0, 0.0, dt=0.5, rate=(4.0, 1.0))
    np.testing.assert_allclose(y[1:7], [2.0, 4.0, 6.0, 8.0, 10.0, 10.0])
    np.testing.assert_allclose(y[21:24], [9.5, 9.0, 8.5])


def test_held_command_stops_the_stem_only_where_told():
    """A repeated command costs the canonical stem a further J, and nothing when only turns stop."""
    u = np.array([50.0, 54.0, 55.0, 55.0, 55.5, 56.0])
    assert run(u, 5.0, 2.0, 50.0)[-2] == 53.5
    np.testing.assert_allclose(run(u, 5.0, 2.0, 50.0, restick=-1e-9)[-2:], [54.0, 54.5])


def test_restart_forgets_the_past():
    """At a restart the stem is where it was measured, and no command from before it counts."""
    u = np.concatenate((np.full(10, 20.0), np.full(10, 70.0)))
    mv = np.concatenate((np.full(10, 20.0), np.full(10, 71.0)))
    marks = np.zeros(20, dtype=np.uint8)
    marks[[0, 10]] = kernel.START
    out = np.empty(20)
    kernel.simulate(u, mv, marks, 1.0, chosen(5.0, 2.0, dead_time_s=4.0, lag=(9.0, 9.0)), out)
    np.testing.assert_array_equal(out, mv)


def test_restart_keeps_the_stem_within_the_stick_band():
    """A measured start further from the command than breakaway allows is put at the band's edge."""
    assert run(np.full(3, 50.0), 5.0, 2.0, 80.0).tolist() == [53.5] * 3


def test_resync_moves_a_resting_stem_only():
    """A resynchronisation puts a stuck stem where it was measured and leaves a moving one alone."""
    u = np.concatenate((np.full(5, 50.0), 50.0 + np.arange(1.0, 11.0)))
    mv = np.full(15, 51.0)
    marks = np.zeros(15, dtype=np.uint8)
    marks[0] = kernel.START
    marks[[3, 12]] = kernel.RESYNC
    mv[0] = 50.0
    out = np.empty(15)
    kernel.simulate(u, mv, marks, 1.0, chosen(5.0, 2.0), out)
    np.testing.assert_array_equal(out[:3], 50.0)
    np.testing.assert_array_equal(out[3:5], 51.0)
    np.testing.assert_allclose(out[9:], u[9:] - 1.5)


def drawn_problem(seed, m=7):
    """Command, position, marks, blocks and candidates as a fit would hand them over."""
    rng = np.random.default_rng(seed)
    n = 300
    u = 50.0 + np.cumsum(rng.standard_normal(n))
    mv = u + rng.standard_normal(n)
    marks = np.zeros(n, dtype=np.uint8)
    marks[[0, 120]] = kernel.START
    marks[[60, 180, 240]] = kernel.RESYNC
    block = np.arange(n) * 5 // n
    block[rng.random(n) < 0.2] = -1
    candidates = np.array(
        [
            chosen(
                rng.uniform(0, 8),
                rng.uniform(0, 8),
                dead_time_s=rng.uniform(0, 5),
                lag=rng.uniform(0, 5, 2),
                rate=rng.uniform(0.5, 9, 2),
                restick=rng.choice([-1e-9, 0.0, 0.5, np.inf]),
            )
            for _ in range(m)
        ]
    )
    candidates[:, kernel.ZERO] = rng.uniform(-2, 2, m)
    candidates[:, kernel.GAIN] = rng.uniform(0.5, 2, m)
    return u, mv, marks, block, candidates


def counted_losses(function, case, delta=0.7, dt=0.8):
    u, mv, marks, block, candidates = case
    losses, counts = np.empty((len(candidates), 5)), np.empty(5)
    function(u, mv, marks, block, dt, delta, candidates, losses, counts)
    return losses, counts


@pytest.mark.parametrize(("seed", "m"), [*enumerate((7, 1, 16, 17, 40)), (5, 7)])
def test_block_losses_are_the_loss_of_the_free_run(seed, m):
    """The loss kernel gives, block by block, the Cauchy loss of what ``simulate`` gives."""
    case = u, mv, marks, block, candidates = drawn_problem(seed, m)
    if seed == 5:  # the command as it is, which needs no look back
        candidates[:, kernel.DEAD_TIME_S] = 0.0
    losses, counts = counted_losses(kernel.block_losses, case)
    np.testing.assert_array_equal(counts, [np.sum(block == b) for b in range(5)])
    out = np.empty(u.size)
    for candidate, result in zip(candidates, losses, strict=True):
        kernel.simulate(u, mv, marks, 0.8, candidate, out)
        each = 0.7**2 * np.log1p(((mv - out) / 0.7) ** 2)
        np.testing.assert_allclose(result, [each[block == b].sum() for b in range(5)], rtol=1e-9)


def test_the_loss_of_a_candidate_does_not_depend_on_the_others():
    """Candidates go side by side; what one costs does not depend on which others go with it."""
    u, mv, marks, block, candidates = drawn_problem(6, 21)
    together, _ = counted_losses(kernel.block_losses, (u, mv, marks, block, candidates))
    alone = [
        counted_losses(kernel.block_losses, (u, mv, marks, block, candidates[[i]]))[0][0]
        for i in range(21)
    ]
    np.testing.assert_array_equal(together, alone)


def test_samples_outside_the_blocks_add_no_loss():
    """Losses of some blocks are those that all blocks would have; the others are 0."""
    u, mv, marks, block, candidates = drawn_problem(7)
    complete, _ = counted_losses(kernel.block_losses, (u, mv, marks, block, candidates))
    some = np.where(np.isin(block, (0, 2)), block, -1)
    part, counts = counted_losses(kernel.block_losses, (u, mv, marks, some, candidates))
    np.testing.assert_allclose(part[:, [0, 2]], complete[:, [0, 2]], rtol=1e-12)
    assert not part[:, [1, 3, 4]].any()
    assert not counts[[1, 3, 4]].any()


def test_block_losses_survive_huge_residuals():
    """A position that is off by 1e60 % costs a large finite loss, not infinity."""
    u, mv, marks, block, candidates = drawn_problem(1)
    losses, _ = counted_losses(kernel.block_losses, (u, mv + 1e60, marks, block, candidates))
    assert np.isfinite(losses).all()


@pytest.mark.parametrize("seed", range(3))
def test_compiled_is_interpreted(seed):
    """The compiled kernels give what the same Python gives uncompiled."""
    case = u, mv, marks, _, candidates = drawn_problem(seed)
    plain, compiled = np.empty(u.size), np.empty(u.size)
    for candidate in candidates:
        inspect.unwrap(kernel.simulate)(u, mv, marks, 0.8, candidate, plain)
        kernel.simulate(u, mv, marks, 0.8, candidate, compiled)
        np.testing.assert_allclose(compiled, plain, rtol=1e-12)
    np.testing.assert_allclose(
        counted_losses(kernel.block_losses, case)[0],
        counted_losses(inspect.unwrap(kernel.block_losses), case)[0],
        rtol=1e-9,
    )
