"""Each term against the equations of the chain, written here independently, and by hand."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stemwatch.models.mismatch.stem_model import stem as stem_number
from stemwatch.models.mismatch.stem_model.stem import Stem, Stems
from stemwatch.models.mismatch.term import ActsOn, RecordingSummary
from stemwatch.models.mismatch.terms import catalogue
from stemwatch.models.recording import Floats
from tests.models.mismatch.fitted_chain import followed

CATALOGUE = catalogue()
COMMAND = sorted(slug for slug, term in CATALOGUE.items() if term.acts_on is ActsOn.COMMAND)
S, J = 4.0123, 1.2071  # no step of the signals divides them
LOOK = RecordingSummary(
    interval_s=1.0,
    duration_s=3600.0,
    unit_s=1.0,
    op_low=25.0,
    op_high=75.0,
    mv_low=26.0,
    mv_high=74.0,
    sigma=0.05,
    S=S,
    J=J,
)


def shaped(slug: str, command: Floats, values: list[float], dt: float = 1.0) -> Floats:
    """The command as a term of the command makes it, started once."""
    marks = np.zeros(command.size, dtype=np.uint8)
    marks[0] = 1
    out = np.empty(command.size)
    CATALOGUE[slug].shape(command, marks, dt, np.array(values), out)
    return out


def simulated(
    op: Floats,
    terms: dict[str, list[float]],
    dt: float = 1.0,
    levels: tuple[float, float] = (S, J),
) -> Floats:
    """MV of the stem with some terms over ``op``, from a reading equal to the command."""
    stem = Stem.neutral(op.size, dt)
    stem.numbers[stem_number.S], stem.numbers[stem_number.J] = levels
    p = op
    for slug, values in terms.items():
        if CATALOGUE[slug].acts_on is ActsOn.COMMAND:
            p = shaped(slug, p, values, dt)
        else:
            CATALOGUE[slug].fill(stem, np.array(values))
    marks = np.zeros(op.size, dtype=np.uint8)
    marks[0] = 1
    never = np.full(op.size, op.size)
    out, _, _ = followed(stem, p, op, marks, (never, never))
    return out


def restless(dt: float = 1.0, samples: int = 1500) -> Floats:
    """A command of ramps, steps, holds and reversals between 20 and 80 %."""
    rng = np.random.default_rng(5)
    pieces, level = [np.full(4, 50.0)], 50.0
    while sum(piece.size for piece in pieces) < samples:
        target = float(rng.uniform(20.0, 80.0))
        slow = rng.random() < 0.6
        ramp = np.linspace(level, target, int(rng.integers(20, 120) if slow else 2))[1:]
        pieces += [ramp, np.full(int(rng.integers(3, 60)), target)]
        level = target
    return np.concatenate(pieces)[:samples]


@dataclass
class Chain:
    """The chain of blocks in plain Python, one sample at a time; all neutral by default.

    ``by_speed``: a moving stem sticks when it is itself too slow, not when its command holds.
    """

    theta: float = 0.0
    tau_up: float = 0.0
    tau_down: float = 0.0
    wn: float = 0.0
    zeta: float = 1.0
    rate_up: float = math.inf
    rate_down: float = math.inf
    sag: float = 0.0
    sag_tau: float = 30.0
    U: float = 0.0
    bow: float = 0.0
    H: float = 0.0
    way: float = 1.0
    a: float = 0.0
    A: float = 0.0
    c: float = 50.0
    w: float = 5.0
    g: float = 0.0
    b_dwell: float = 0.0
    creep: float = 0.0
    tau_v: float = 0.0
    v_c: float = 0.0
    low: float = -math.inf
    high: float = math.inf
    b: float = 0.0
    gain: float = 1.0
    zero: float = 0.0
    D: float = 0.0
    by_speed: bool = False
    air: float = field(default=0.0, init=False)
    velocity: float = field(default=0.0, init=False)
    anchors: list[float] = field(default_factory=list, init=False)

    def actuator(self, p: float, u: float, dt: float) -> float:
        """The force after one sample of the command ``u``."""
        if self.wn > 0.0:
            target = p
            for _ in range(10):
                pull = self.wn**2 * (u - target) - 2.0 * self.zeta * self.wn * self.velocity
                self.velocity += dt / 10.0 * pull
                target += dt / 10.0 * self.velocity
            step = target - p
        else:
            tau = self.tau_up if u > p else self.tau_down
            step = (u - p) * (1.0 - math.exp(-dt / tau) if tau > 0.0 else 1.0)
        return p + min(max(step, -self.rate_down * dt), self.rate_up * dt)

    def sagging(self, rise: float, dt: float) -> float:
        """What the supply lacks after a rise of the force."""
        self.air += self.sag * max(rise, 0.0) - dt * self.air / self.sag_tau
        return self.air

    def levels(self, x: float, F: float, age: float, rest: float) -> tuple[float, float]:
        """Static and sliding friction."""
        grown = 1.0 + self.g * age
        jump = J * grown * (1.0 + math.copysign(self.a, F))
        bump = self.A * math.exp(-(((x - self.c) / self.w) ** 2))
        fs, fd = 0.5 * (S * grown + jump) + bump, 0.5 * (S * grown - jump) + bump
        return fs + self.b_dwell * math.log(1.0 + rest / 5.0), fd

    def force(self, x: float) -> float:
        """The force that depends on the place."""
        share, w = x / 100.0, x / 50.0 - 1.0
        bent = 1.5 * math.sqrt(3.0) * self.bow * (w - w**3)
        return self.U * (4.0 * share * (1.0 - share) - 1.0) - bent

    def settled(self, x: float) -> float:
        """Where a spring with inner friction holds the stem that would stand at ``x`` without."""
        if self.H == 0.0:
            return x
        reaches = [0.25 * self.way, 0.5 * self.way, self.way]
        self.anchors = self.anchors or [x, x, x]
        low, high = x - self.H, x + self.H
        for _ in range(60):
            y = 0.5 * (low + high)
            shares = [(y - a) / r for a, r in zip(self.anchors, reaches, strict=True)]
            held = self.H / 3.0 * sum(min(max(share, -1.0), 1.0) for share in shares)
            low, high = (y, high) if y + held < x else (low, y)
        pairs = zip(self.anchors, reaches, strict=True)
        self.anchors = [min(max(a, y - r), y + r) for a, r in pairs]
        return y

    def run(self, u: Floats, dt: float) -> Floats:
        """(n,) MV, from a reading equal to the command."""
        n, rate = len(u), dt / self.tau_v if self.tau_v > 0.0 else math.inf
        x = z = self.settled((u[0] - self.zero + 0.5 * self.D - 50.0) / self.gain + 50.0)
        p = before = float(u[0])
        moving, d, rest = False, 1.0, 0.0
        complete = int(self.theta / dt)
        part = self.theta / dt - complete
        out = [float(u[0])]
        for k in range(1, n):
            late = (1.0 - part) * u[max(k - complete, 0)] + part * u[max(k - complete - 1, 0)]
            old = p
            p = self.actuator(p, late, dt)
            seen = p - self.sagging(p - old, dt)
            F = seen - x - self.force(x)
            # Spring and force together, over the percent of travel that the stem is in.
            percent = math.floor(x)
            stiffness = 1.0 + self.force(percent + 1.0) - self.force(percent)
            shares = (1.0 - math.exp(-rate * stiffness)) / stiffness
            fs, fd = self.levels(x, F, k / n, rest)
            held = d * (seen - before) <= self.v_c * dt + 1e-9
            if self.by_speed:
                held = shares * (d * F - fd) <= (0.01 * dt if self.tau_v > 0.0 else 1e-9)
            if moving and held:
                moving, rest = False, 0.0
                fs, fd = self.levels(x, F, k / n, rest)
            if not moving and abs(F) > fs:
                moving, d = True, math.copysign(1.0, F)
            elif not moving:
                rest += dt
                x += self.creep * dt
            if moving and d * F > fd:
                x += shares * (F - d * fd)
            x = min(max(x, self.low), self.high)
            y = self.settled(x)
            z = min(max(z, y - 0.5 * self.b), y + 0.5 * self.b)
            out.append(self.gain * (z - 50.0) + 50.0 + self.zero + self.D * (k / n - 0.5))
            before = seen
        return np.array(out)


# slug, coordinates of the term, the same in the words of the chain
EXACT = [
    ("dead_time", [2.3], Chain(theta=2.3)),
    ("actuator_lag", [3.1], Chain(tau_up=3.1, tau_down=3.1)),
    ("asymmetric_lag", [0.8, 4.2], Chain(tau_up=0.8, tau_down=4.2)),
    ("underdamped_positioner", [0.6, 0.25], Chain(wn=0.6, zeta=0.25)),
    ("rate_limit", [1.0 / 0.7], Chain(rate_up=0.7, rate_down=0.7)),
    ("asymmetric_rate_limit", [1.0 / 6.0, 1.0 / 0.9], Chain(rate_up=6.0, rate_down=0.9)),
    ("asymmetric_rate_limit", [0.0, 1.0 / 2.8], Chain(rate_down=2.8)),
    ("supply_sag", [0.3, 40.0], Chain(sag=0.3, sag_tau=40.0)),
    ("asymmetric_slip", [0.6], Chain(a=0.6)),
    ("low_speed_restick", [0.3], Chain(v_c=0.3)),
    ("slip_overshoot", [4.0], Chain(v_c=4.0)),
    ("dwell_dependent_breakaway", [0.4], Chain(b_dwell=0.4)),
    ("stem_creep", [-0.03], Chain(creep=-0.03)),
    ("travel_stop", [38.0, 0.0], Chain(low=38.0)),
    ("travel_stop", [0.0, 39.0], Chain(high=61.0)),
    ("lost_motion", [1.7], Chain(b=1.7)),
    ("sensor_drift", [-1.8], Chain(D=-1.8)),
    ("zero_shift", [1.1], Chain(zero=1.1)),
    ("span_error", [-0.07], Chain(gain=0.93)),
    ("spring_hysteresis", [1.5, 6.0], Chain(H=1.5, way=6.0)),
]
# The speed of the stem decides whether it sticks; a table is linear between its places.
CLOSE = [
    ("growing_stiction", [0.8], Chain(g=0.8, by_speed=True)),
    ("position_dependent_friction", [2.0, 55.0, 6.0], Chain(A=2.0, c=55.0, w=6.0, by_speed=True)),
    ("flow_force", [-4.0], Chain(U=-4.0, by_speed=True)),
    ("bowed_linkage", [-2.5], Chain(bow=-2.5, by_speed=True)),
    ("viscous_drag", [3.5], Chain(tau_v=3.5, by_speed=True)),
]


@pytest.mark.parametrize("dt", [1.0, 0.5])
@pytest.mark.parametrize(("slug", "values", "chain"), EXACT)
def test_the_compiled_term_follows_the_equations_of_the_chain(slug, values, chain, dt):
    """Every sample agrees, and the effect is there to be seen."""
    op = restless()
    mv = simulated(op, {slug: values}, dt)
    np.testing.assert_allclose(mv, Chain(**settings_of(chain)).run(op, dt), atol=1e-6)
    assert np.sqrt(np.mean((mv - simulated(op, {}, dt)) ** 2)) > 0.05


@pytest.mark.parametrize(("slug", "values", "chain"), CLOSE)
def test_a_term_whose_friction_or_speed_varies_follows_the_chain_closely(slug, values, chain):
    """Every sample agrees as well as a table of one percent steps can."""
    op = restless()
    mv = simulated(op, {slug: values})
    np.testing.assert_allclose(mv, Chain(**settings_of(chain)).run(op, 1.0), atol=0.03)
    assert np.sqrt(np.mean((mv - simulated(op, {})) ** 2)) > 0.1


@pytest.mark.parametrize("rise", [-6.0, 8.0])
@pytest.mark.parametrize("drag_s", [0.0, 4.0])
def test_a_force_that_is_linear_in_travel_is_a_gain_of_the_reading(rise, drag_s):
    """Spring and force are one spring of another rate: the stem stops where both hold it, with
    drag later by the time of the stiffer spring."""
    op, stiffness = restless(), 1.0 + rise / 50.0
    drag = {"viscous_drag": [drag_s]} if drag_s else {}
    stiffer = {"viscous_drag": [drag_s / stiffness]} if drag_s else {}
    mv = simulated(op, {**drag, "load_by_position": [rise, 0.0, 0.0]})
    same = simulated(op, {**stiffer, "span_error": [1.0 / stiffness - 1.0]})
    np.testing.assert_allclose(mv, same, atol=0.02 if drag_s else 1e-6)
    assert np.sqrt(np.mean((mv - simulated(op, drag)) ** 2)) > 0.3


STATES = ("air", "velocity", "anchors")


def settings_of(chain: Chain) -> dict[str, float]:
    """A chain's parameters, so that each test runs one without history."""
    return {name: value for name, value in vars(chain).items() if name not in STATES}


@pytest.mark.parametrize("slug", sorted(CATALOGUE))
def test_at_its_neutral_coordinates_a_term_leaves_the_canonical_element_bit_for_bit(slug):
    """All hypotheses contain S and J alone, so that none can lose against it."""
    op = restless()
    neutral = [0.0] * len(CATALOGUE[slug].coordinates(LOOK))
    assert np.array_equal(simulated(op, {slug: neutral}), simulated(op, {}))


@pytest.mark.parametrize("slug", sorted(CATALOGUE))
@settings(max_examples=25, deadline=None)
@given(data=st.data())
def test_any_values_in_range_give_a_finite_run(slug, data):
    """The search may try every corner."""
    limits = CATALOGUE[slug].coordinates(LOOK)
    values = [data.draw(st.floats(c.low, c.high)) for c in limits]
    assert np.all(np.isfinite(simulated(restless(samples=400), {slug: values})))


@pytest.mark.parametrize("slug", COMMAND)
@settings(max_examples=25, deadline=None)
@given(data=st.data())
def test_a_command_term_passes_a_resting_command_and_forgets_what_was_before_a_gap(slug, data):
    """Neither a valve at rest nor data from before a gap may show an effect."""
    limits = CATALOGUE[slug].coordinates(LOOK)
    values = np.array([data.draw(st.floats(c.low, c.high)) for c in limits])
    rest = np.full(50, 37.0)
    assert np.array_equal(shaped(slug, rest, list(values)), rest)
    op = restless(samples=300)
    marks = np.zeros(op.size, dtype=np.uint8)
    marks[[0, 170]] = 1
    marks[[90, 230]] = 2  # where a resting stem is put is nothing to the command
    out = np.empty(op.size)
    CATALOGUE[slug].shape(op, marks, 1.0, values, out)
    np.testing.assert_array_equal(out[170:], shaped(slug, op[170:], list(values)))


def test_terms_that_share_a_table_add_to_it_and_clear_empties_it():
    """Two laws of friction or force can be found together."""
    stems = Stems.neutral(1, 100, 1.0)
    (stem,) = stems.each
    for index in (40.0, 60.0):
        CATALOGUE["position_dependent_friction"].fill(stem, np.array([1.5, index, 3.0]))
    CATALOGUE["flow_force"].fill(stem, np.array([2.0]))
    CATALOGUE["dwell_dependent_breakaway"].fill(stem, np.array([0.5]))
    at_40, at_60 = (int(index - stem_number.PLACE_LOW) for index in (40.0, 60.0))
    assert stem.friction[at_40] == pytest.approx(1.5)
    assert stem.friction[at_60] == pytest.approx(1.5)
    assert stem.force[int(100.0 - stem_number.PLACE_LOW)] == pytest.approx(-2.0)
    assert stem.breakaway[5] == pytest.approx(0.5 * math.log(2.0))
    stems.clear(1)
    assert not stem.friction.any()
    assert not stem.force.any()
    assert not stem.breakaway.any()


def test_the_reading_s_terms_add_to_what_the_base_already_has():
    """Zero and gain are free in every hypothesis."""
    stem = Stem.neutral(10, 1.0)
    stem.numbers[stem_number.ZERO], stem.numbers[stem_number.GAIN] = 0.5, 1.05
    CATALOGUE["zero_shift"].fill(stem, np.array([1.0]))
    CATALOGUE["span_error"].fill(stem, np.array([-0.1]))
    assert stem.numbers[stem_number.ZERO] == pytest.approx(1.5)
    assert stem.numbers[stem_number.GAIN] == pytest.approx(0.95)


def test_without_a_speed_of_its_own_the_restick_term_keeps_that_of_the_recording():
    """A coarse command needs another rule, and the neutral term must not undo it."""
    stem = Stem.neutral(10, 1.0)
    stem.numbers[stem_number.RESTICK] = -1.0
    CATALOGUE["low_speed_restick"].fill(stem, np.array([0.0]))
    assert stem.numbers[stem_number.RESTICK] == -1.0


def test_the_step_response_of_each_command_term_is_as_computed_by_hand():
    """A step of 10 % from 40 %, after one second each."""
    step = np.array([40.0] + [50.0] * 8)
    share = 1.0 - math.exp(-0.5)
    assert shaped("actuator_lag", step, [2.0])[1] == pytest.approx(40.0 + 10.0 * share)
    assert shaped("asymmetric_lag", step, [2.0, 0.0])[1] == pytest.approx(40.0 + 10.0 * share)
    assert shaped("asymmetric_lag", step, [0.0, 2.0])[1] == 50.0
    np.testing.assert_allclose(shaped("dead_time", step, [1.25])[:4], [40.0, 40.0, 47.5, 50.0])
    np.testing.assert_allclose(shaped("rate_limit", step, [0.25])[:4], [40.0, 44.0, 48.0, 50.0])
    np.testing.assert_allclose(shaped("asymmetric_rate_limit", step, [0.0, 9.0]), step)
    sagged = shaped("supply_sag", step, [0.2, 10.0])
    np.testing.assert_allclose(sagged[1:4], [48.0, 48.2, 48.38])
    np.testing.assert_array_equal(shaped("supply_sag", step, [-0.2, 10.0]), step)
    np.testing.assert_allclose(shaped("supply_sag", step[::-1].copy(), [-0.2, 10.0])[-1:], [42.0])


def test_the_positioner_overshoots_by_its_damping_and_rings_with_its_period():
    """The textbook's second order, whatever the sampling."""
    wn, zeta = 0.5, 0.2
    for dt in (0.5, 1.0, 2.0):
        step = np.full(int(200 / dt), 50.0)
        step[0] = 40.0
        p = shaped("underdamped_positioner", step, [wn, zeta], dt)
        root = math.sqrt(1.0 - zeta * zeta)
        assert p.max() == pytest.approx(50.0 + 10.0 * math.exp(-math.pi * zeta / root), abs=0.7)
        assert dt * int(np.argmax(p)) == pytest.approx(math.pi / (wn * root), abs=dt + 0.2)
        assert p[-1] == pytest.approx(50.0, abs=0.01)


def test_a_dragging_stem_goes_on_after_the_command_has_stopped_and_a_lag_delays_the_start():
    """Drag and lag differ in the instant of the breakaway."""
    ramp = np.concatenate([np.full(5, 40.0), 40.0 + 0.25 * np.arange(1, 41), np.full(60, 50.0)])
    base = simulated(ramp, {})
    drag = simulated(ramp, {"viscous_drag": [4.0]})
    lag = simulated(ramp, {"actuator_lag": [4.0]})
    starts = [int(np.argmax(np.abs(run - 40.0) > 1e-6)) for run in (base, drag, lag)]
    assert starts[1] == starts[0]
    assert starts[2] >= starts[0] + 3
    assert drag[44] < drag[50] - 0.2
    assert drag[-1] == pytest.approx(base[-1], abs=0.1)


def test_play_takes_from_the_jump_after_a_reversal_and_not_after_a_restart():
    """The only trace by which play differs from a smaller J."""
    play = 0.8
    up = np.concatenate([np.full(3, 50.0), 50.0 + 0.05 * np.arange(1, 161), np.full(20, 58.0)])
    repeated = 58.0 + 0.05 * np.arange(1, 101)
    down = repeated[-1] - 0.05 * np.arange(1, 201)
    op = np.concatenate([up, repeated, np.full(20, repeated[-1]), down])
    steps = np.abs(np.diff(simulated(op, {"lost_motion": [play]})))
    restart = steps[up.size : up.size + repeated.size].max()
    reversal = steps[up.size + repeated.size :].max()
    assert restart == pytest.approx(J, abs=0.06)
    assert reversal == pytest.approx(J - play, abs=0.06)
