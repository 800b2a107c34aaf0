"""S and J from the breakaways themselves."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from stemwatch.models.recording import Role, Signal
from stemwatch.models.stickslip import parameters
from stemwatch.models.stickslip.breakaways import (
    FEWEST,
    LEAST_J,
    OF_A_PLACE,
    Breakaways,
    _mean_of_sides,
    breakaways,
)
from stemwatch.models.stickslip.fit import fit_stickslip
from stemwatch.models.stickslip.fitted_slips import _begun_at_slips
from stemwatch.models.stickslip.interval import bootstrap, interval
from stemwatch.models.stickslip.parameters import S_and_J
from stemwatch.models.stickslip.problem import make_problem
from stemwatch.models.stickslip.search import SearchResult
from stemwatch.models.studies.simulator import draw_healthy, draw_sticky, simulate_loop
from stemwatch.models.studies.simulator.defects import PackingDefects
from stemwatch.models.studies.simulator.hidden import draw_nulls
from stemwatch.service.studies.robustness import draw_valves, recorded
from tests.models.stick_slip_element import stick_slip

SCATTER = 0.12


@cache
def sticking(place: int, scatter: float = SCATTER):
    """A valve of the force-balance plant and what was recorded of it."""
    case = draw_nulls(6, 8282, "routine")[place]
    S = 4.0 + 0.5 * place
    valve = replace(case.loop.valve, S=S, J=2.0, scatter=scatter, packing=PackingDefects())
    return valve, simulate_loop(replace(case.loop, valve=valve), case.seed).recording


@pytest.mark.parametrize("place", range(6))
def test_S_and_J_are_those_of_the_mean_breakaway(place):
    """Breakaways scatter, and S and J of a run with one level are too small by several percent."""
    valve, recording = sticking(place)
    fit = fit_stickslip(recording)
    assert fit.breakaways is not None
    level, kinetic = 0.5 * (valve.S + valve.J), 0.5 * (valve.S - valve.J)
    assert fit.breakaways.level == pytest.approx(level, abs=0.08 * level)
    assert fit.breakaways.kinetic == pytest.approx(kinetic, abs=0.15)
    assert (fit.S, fit.J) == (fit.breakaways.S, fit.breakaways.J)


def test_breakaways_are_nearer_to_the_truth_than_the_best_free_run():
    """This is the reason for reading the breakaways."""
    errors = []
    for index in range(6):
        valve, recording = sticking(index)
        fit = fit_stickslip(recording)
        run = S_and_J(fit.candidate)
        true = (valve.S, valve.J)
        errors.append([np.abs(np.subtract(pair, true)).sum() for pair in ((fit.S, fit.J), run)])
    answer, cheapest = np.median(errors, axis=0)
    assert answer < 0.6 * cheapest


@pytest.mark.parametrize("scatter", [0.04, 0.12])
def test_the_scatter_of_the_breakaways_is_estimated(scatter):
    """As a share of the level."""
    _, recording = sticking(2, scatter)
    result = fit_stickslip(recording).breakaways
    assert result.scatter == pytest.approx(scatter, rel=0.4)


def test_the_interval_is_that_of_the_breakaways():
    """It narrows as their number grows, and holds the estimate."""
    _, recording = sticking(1)
    fit = fit_stickslip(recording)
    half = fit_stickslip(recording.part(0, len(recording) // 4))
    widths = []
    for item in (fit, half):
        low, high = interval(bootstrap(item).S, item.S)
        assert low <= item.S <= high
        widths.append(high - low)
    assert half.breakaways.count < fit.breakaways.count
    assert widths[0] < widths[1]


@pytest.mark.long
def test_a_stem_of_bristles_that_hardly_jumps_keeps_its_J_in_the_interval():
    """It creeps with its command before it slips, so that J is read half as large again."""
    (valve,) = [valve for valve in draw_valves(8, 5151) if valve.sticking][6:7]
    fit = fit_stickslip(recorded(valve))
    low, high = interval(bootstrap(fit).J, fit.J)
    assert fit.J > 1.3 * valve.J
    assert low <= valve.J <= high


def test_levels_are_less_certain_where_slips_are_small_or_near_the_resolution():
    """Of one reading: a jump of 0.5 % more than one of 1.5 %, and one that hardly exceeds a step of
    the recorder; steps much smaller than it change nothing where the stem rests at many places."""
    _, recording = sticking(1)
    seen = fit_stickslip(recording).breakaways

    def spread(seen: Breakaways) -> float:
        return float(np.std(seen.draws(300, np.random.default_rng(1))[1]))

    level, kinetic = seen.level, seen.level - 0.5
    tried = tuple(replace(one, level=level, kinetic=kinetic) for one in seen.tried)
    small = replace(seen, level=level, kinetic=kinetic, tried=tried)
    large = replace(small, kinetic=level - 1.5)
    assert spread(small) > spread(large)
    assert spread(replace(seen, step=0.1, places=200)) == pytest.approx(spread(seen), rel=1e-3)
    assert spread(replace(seen, step=seen.J)) > 1.2 * spread(seen)
    assert spread(replace(seen, step=0.4 * seen.J)) > 1.2 * spread(seen)


def test_few_places_of_rest_leave_the_rounding_of_a_jump_but_not_of_S():
    """A place is rounded the same way from both sides, so the rounding changes J and not S."""
    _, recording = sticking(1)
    seen = fit_stickslip(recording).breakaways
    step = 0.2 * seen.J

    def spreads(seen: Breakaways) -> list[float]:
        return [float(np.std(drawn)) for drawn in seen.draws(3000, np.random.default_rng(1))]

    fine, coarse = spreads(seen), spreads(replace(seen, step=step, places=1))
    assert coarse[0] == pytest.approx(fine[0], rel=0.05)
    assert coarse[1] == pytest.approx(np.hypot(fine[1], OF_A_PLACE * step), rel=0.05)
    assert spreads(replace(seen, step=step, places=100))[1] < coarse[1]


def test_the_interval_of_J_includes_an_undetectable_jump():
    """For a dead band without a jump, J may be as large as a jump that looks like creep, but not
    larger.
    """
    _, recording = sticking(0)
    fit = fit_stickslip(recording)
    candidate = fit.candidate.copy()
    candidate[parameters.RATIO] = 0.0
    low, high = interval(bootstrap(replace(fit, candidate=candidate, breakaways=None)).J, 0.0)
    assert low == 0.0
    assert high >= 0.9 * LEAST_J


def test_a_healthy_valve_has_none():
    """A stem that follows its command does not break away."""
    loops = [loop for loop in draw_healthy(12, 8283) if "quiet" not in loop.story][:4]
    for index, loop in enumerate(loops):
        assert fit_stickslip(simulate_loop(loop, index).recording).breakaways is None


def test_too_small_a_jump_is_no_evidence():
    """Below ``LEAST_J`` a slip cannot be told from a stem that creeps on."""
    valve, recording = sticking(0)
    problem = make_problem(recording)
    assert breakaways(problem, 1.0, 0.0, valve.S, 0.9 * LEAST_J) is None
    seen = breakaways(problem, 1.0, 0.0, valve.S, valve.J)
    assert isinstance(seen, Breakaways)
    assert seen.count >= FEWEST


def test_a_level_far_from_the_fitted_one_is_not_the_elements():
    """The onsets then have another cause."""
    valve, recording = sticking(0)
    assert breakaways(make_problem(recording), 1.0, 0.0, 3.0 * valve.S, valve.J) is None


def begun(loss_share: float, S_share: float, ratio: float | None = None):
    """What a search begun at the slips makes of a fit with this share of the true S, with J this
    ``ratio`` of it, and with a loss that is this share of the best run's."""
    valve, recording = sticking(2)
    fit = fit_stickslip(recording)
    every_block = np.ones(fit.evaluator.problem.n_blocks, dtype=bool)
    best = float(fit.evaluator.loss(every_block)(fit.candidate[None, :])[0])
    other = fit.candidate.copy()
    other[parameters.S_PERCENT] = S_share * valve.S
    if ratio is not None:
        other[parameters.RATIO] = ratio
    return (
        valve,
        other,
        _begun_at_slips(fit.evaluator, every_block, SearchResult(other, loss_share * best)),
    )


@pytest.mark.parametrize(("S_share", "ratio"), [(0.5, None), (2.0, 0.9)])
def test_slips_decide_between_two_fits_that_are_about_as_good(S_share, ratio):
    """A search may end at half of S, or at a jump larger than any that is seen."""
    valve, _, (fitted, slips, unneeded) = begun(0.95, S_share, ratio)
    assert slips is not None
    assert unneeded is None
    assert (slips.S, slips.J) == pytest.approx((valve.S, valve.J), abs=0.4)
    assert S_and_J(fitted.candidate)[0] == pytest.approx(valve.S, abs=0.6)


def test_slips_do_not_decide_against_a_fit_that_is_much_better():
    """Nor are they asked where their level is the fitted one."""
    _, other, (fitted, slips, unneeded) = begun(0.5, 0.5)
    assert (slips, unneeded) == (None, None)
    assert fitted.candidate is other
    assert begun(1.0, 1.0)[2][1] is None


def test_a_jump_that_is_hardly_seen_may_be_that_of_the_fit():
    """Of slips about as large as the noise only the larger ones are seen."""
    valve, recording = sticking(0)
    seen = breakaways(make_problem(recording), 1.0, 0.0, valve.S, 0.5 * valve.J)
    assert seen.fitted_J == 0.5 * valve.J

    def low_end(least_seen):
        draws = replace(seen, least_seen=least_seen).draws(300, np.random.default_rng(3))[1]
        return interval(draws, seen.J)[0]

    assert low_end(seen.J / 1.6) == low_end(0.0)
    assert low_end(seen.J / 1.4) < low_end(0.0) - 0.3


@pytest.mark.parametrize(("gain", "zero"), [(-1.0, 100.0), (2.0, -30.0), (1.0, 3.0)])
def test_the_readings_span_and_zero_change_nothing(gain, zero):
    """S and J are in percent of OP whatever the reading's span, zero or sense."""
    valve, recording = sticking(3)
    plain = breakaways(make_problem(recording), 1.0, 0.0, valve.S, valve.J)
    mv = Signal.good(gain * recording.mv.values + zero, "MV")
    read = replace(recording, signals={**recording.signals, Role.MV: mv})
    other = breakaways(make_problem(read), gain, zero, valve.S, valve.J)
    assert (other.S, other.J) == pytest.approx((plain.S, plain.J), abs=0.05)


@pytest.mark.parametrize(("degree", "wrong"), [(1, "slope"), (3, "bend"), (3, "nothing")])
def test_slips_correct_an_estimated_curve(degree, wrong):
    """A curve that is a little off moves S; slips at many places tell the one from the other."""
    errors = []
    for where in range(6):
        valve, recording = sticking(where)
        op = recording.op.values
        low, high = np.percentile(op, (0.5, 99.5))
        place = 2.0 * (op - low) / (high - low) - 1.0
        # Of the same ends for the bend, so that S in percent of OP is the same.
        off, slope = {
            "slope": (0.03 * (op - 50.0), 1.03),
            "bend": (1.5 * (place**3 - place), 1.0),
            "nothing": (np.zeros(op.size), 1.0),
        }[wrong]
        right = breakaways(make_problem(recording), 1.0, 0.0, valve.S, valve.J)
        signals = {**recording.signals, Role.OP: Signal.good(op + off, "OP")}
        problem = make_problem(replace(recording, signals=signals))
        seen = [
            breakaways(replace(problem, unsure_degree=unsure), 1.0, 0.0, valve.S, valve.J)
            for unsure in (0, degree)
        ]
        errors.append([abs(item.S - slope * right.S) for item in seen])
        low, high = interval(seen[1].draws(300, np.random.default_rng(3))[0], seen[1].S)
        assert low <= slope * valve.S <= high
    without, with_curve = np.median(errors, axis=0)
    assert with_curve < (0.06 if wrong == "nothing" else 0.4 * without)


@given(
    degree=st.sampled_from([0, 1, 3]),
    seed=st.integers(0, 2**32 - 1),
    samples=st.integers(30, 800),
    fitted=st.just((4.0, 2.0)) | st.tuples(st.floats(0.0, 20.0), st.floats(0.0, 20.0)),
    moves=st.sampled_from(["with OP", "in small steps", "in large steps", "in slips"]),
)
@example(degree=0, seed=0, samples=800, fitted=(4.0, 2.0), moves="in slips")
def test_any_record_gives_finite_numbers_or_none(degree, seed, samples, fitted, moves):
    """Whatever moves, the answer is finite numbers or none; where the stem slips as the fit says,
    numbers."""
    rng = np.random.default_rng(seed)
    op = 50.0 + np.cumsum(rng.normal(0.0, 0.5, samples))
    if moves == "in slips":
        op = 50.0 + 20.0 * np.sin(0.1 * np.arange(samples))
        mv = stick_slip(op, 4.0, 2.0) + rng.normal(0.0, 0.02, samples)
    elif moves == "with OP":
        mv = op + rng.normal(0.0, 0.2, samples)
    else:
        step = 0.5 if moves == "in small steps" else 10.0
        mv = step * np.round(op / step)
    recording = replace(
        sticking(0)[1],
        signals={Role.OP: Signal.good(op, "OP"), Role.MV: Signal.good(mv, "MV")},
    )
    problem = replace(make_problem(recording), unsure_degree=degree)
    result = breakaways(problem, 1.0, 0.0, *fitted)
    if result is not None:
        drawn = result.draws(50, rng)
        assert np.isfinite((result.S, result.J, result.scatter)).all()
        assert np.isfinite(drawn).all()
    else:
        assert (moves, samples, fitted) != ("in slips", 800, (4.0, 2.0))


def test_values_of_one_direction_in_two_groups_are_kept():
    """Its values all lie as far from their median, and none of them is left out for it."""
    values = np.array([1.0, 1.0, 1.0, 9.0, 9.0, 9.0, *np.full(20, 4.0)])
    side = np.where(np.arange(values.size) < 6, -1.0, 1.0)
    mean, spread, error, kept = _mean_of_sides(values, side)
    assert kept.all()
    assert mean == pytest.approx(4.5)
    assert np.isfinite([spread, error]).all()


@pytest.mark.parametrize(("interval_s", "read"), [(1.0, True), (0.1, False)])
def test_slips_that_take_longer_than_a_sample_are_left_to_the_fit(interval_s, read):
    """At 10 Hz the first sample of a slip is two thirds of it: J was 3.3 % and S 8.4 %."""
    loop = draw_sticky(2, 7171)[1]
    archive = replace(loop.archive, interval_s=interval_s)
    duration_s = 700.0 if interval_s < 1.0 else 3600.0
    fast = simulate_loop(replace(loop, duration_s=duration_s, archive=archive), 7_171_001).recording
    fit = fit_stickslip(replace(fast, interval_s=1.0))
    assert (fit.breakaways is not None) == read
    assert loop.valve.J == pytest.approx(fit.J, abs=0.2)
    assert loop.valve.S == pytest.approx(fit.S, abs=0.6)
