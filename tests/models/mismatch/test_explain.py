"""From a recording of a force-balance valve to a name, numbers and a better fit, without a crash.

The valves are those of ``models.studies.simulator``, which shares no code with what is fitted here.
"""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from stemwatch.models.mismatch.acceptance_limits import LEAST_OF_A_PAIR, strength
from stemwatch.models.mismatch.explain import explain
from stemwatch.models.mismatch.findings import Finding, Mismatch, TriedOutcome
from stemwatch.models.mismatch.fit import base_coordinate
from stemwatch.models.mismatch.identifiability import NO_POSITION, PHYSICS
from stemwatch.models.mismatch.restated_stiction import of_rivals
from stemwatch.models.mismatch.terms import catalogue
from stemwatch.models.recording import Recording, Role
from stemwatch.models.stickslip.advantage import Advantage
from stemwatch.models.studies.null_scores import null_scores
from stemwatch.models.studies.simulator import simulate_loop
from stemwatch.models.studies.simulator.hidden import (
    draw_effect,
    draw_hidden,
    draw_nulls,
    simulate_hidden,
)
from stemwatch.models.studies.simulator.valve_life import draw_lives
from tests.models.mismatch.fitted_chain import command, recorded, rescaled, simulated_by_chain
from tests.models.stick_slip_element import stick_slip

# Slug, seed of the draw, parameter, its true size as the draw tells it, and how near it must be.
CASES = [
    ("dead_time", 4000, "theta", "delay_s", 0.5),
    pytest.param("dead_time", 4001, "theta", "delay_s", 0.5, marks=pytest.mark.long),
    pytest.param(
        "asymmetric_rate_limit",
        4008,
        "rate_rising",
        "fill_percent_per_s",
        0.05,
        marks=pytest.mark.long,
    ),
    ("travel_stop", 4002, "stop_low", "low_percent", 0.3),
    pytest.param("zero_shift", 4001, "zero", "zero_percent", 0.15, marks=pytest.mark.long),
    pytest.param("growing_stiction", 4000, "growth", "growth", 0.25, marks=pytest.mark.long),
]
# Whose S or J the effect biases by a tenth and more.
BIASED = ("dead_time", "travel_stop", "zero_shift", "growing_stiction")
hidden = pytest.mark.parametrize(("slug", "seed", "name", "size", "within"), CASES)


@cache
def simulated(slug, seed):
    """The recording, the truth of the loop, and the drawn sizes by their short names."""
    case = draw_nulls(1, seed)[0] if slug == "null" else draw_effect(slug, 1, seed)[0]
    case, run = simulate_hidden(case)
    assert case.excited, f"{slug} {seed} hides nothing"
    sizes = {name.split(".")[1]: value for name, value in case.sizes.items()}
    return run.recording, case.loop.valve, sizes


@cache
def explained(slug, seed):
    """What is found in it."""
    return explain(simulated(slug, seed)[0])


def sound(result: Mismatch, samples: int) -> None:
    """What every mismatch must be, whatever the recording held."""
    as_json(result)
    assert result.sentence.strip()
    assert result.seconds >= 0.0
    named = [effect.slug for effect in result.effects]
    refused = {item.slug: item.reason for item in result.not_testable}
    assert (result.finding in (Finding.NAMED, Finding.CANDIDATES)) == bool(named)
    assert not set(named) & set(refused)
    assert all(reason.strip() for reason in refused.values())
    gains = [effect.evidence.mean for effect in result.effects]
    assert sorted(gains, reverse=True) == gains
    for effect in result.effects:
        assert effect.members[0] == effect.slug
        assert set(effect.members) <= set(catalogue())
        assert "{" not in effect.sentence + effect.where + effect.check
        assert effect.parameters
    for answer in (result.naive, result.restated):
        for number in (answer.S, answer.J):
            if number.value is None:
                assert number.reason
            else:
                assert 0.0 <= number.low <= number.value <= number.high
    # What is published predicts unseen data no worse than S and J alone.
    assert result.heldout.improves
    if result.finding is Finding.UNKNOWN:
        assert result.restated == result.naive
    if result.finding is Finding.NOT_TESTABLE:
        assert set(catalogue()) <= set(refused)
        assert None is result.runs
    else:
        assert result.runs.naive.shape == result.runs.extended.shape == (samples,)
        assert np.isfinite(result.runs.naive).all()
        assert np.isfinite(result.runs.extended).all()
        assert 0 <= result.runs.heldout_from < samples
        assert (result.runs.heldout_from == 0) == result.heldout.alternate_blocks


def as_json(result: Mismatch) -> str:
    """Everything but the traces as JSON; a NaN or an infinity in it is an error."""
    return json.dumps(asdict(replace(result, runs=None)), allow_nan=False)


def off(answer, valve):
    """How far S and J lie from the valve's, percent of span."""
    return abs(answer.S.value - valve.S) + abs(answer.J.value - valve.J)


@hidden
def test_what_is_hidden_is_named_with_its_size(slug, seed, name, size, within):
    """The strongest effect is the hidden one, alone or first of its class, and as large."""
    answer, (recording, _, sizes) = explained(slug, seed), simulated(slug, seed)
    sound(answer, len(recording))
    assert slug in answer.effects[0].members
    result = next(effect for effect in answer.effects if slug in effect.members)
    if result.slug == slug:
        value = result.parameters[name].value
        value = value / 100.0 if result.parameters[name].unit == "%" and size == "growth" else value
        assert value == pytest.approx(sizes[size], abs=within)
    assert result.evidence.mean > 0.0
    assert result.evidence.t > 1.0


@pytest.mark.long
@pytest.mark.parametrize(("delay_s", "named"), [(1.0, False), (2.5, True)])
def test_a_delay_of_about_a_sample_is_mentioned_but_not_named(delay_s, named):
    """Late clocks and a dead time cannot be separated, so no physics is said to be left out."""
    answer = explain(simulated_by_chain(dead_time=[delay_s]))
    said = [one for one in answer.record_effects if one.slug == "small_delay"]
    assert ["dead_time"] * named == [effect.slug for effect in answer.effects]
    assert len(said) == (not named)
    for delay in said:
        assert delay.parameters["delay_s"] == pytest.approx(delay_s, abs=0.2)
        assert "clocks of the two tags or a dead time" in delay.sentence
        assert answer.finding is Finding.NONE
        assert answer.p_value is None
        (tried,) = (one for one in answer.tried if one.slug == "dead_time")
        assert tried.outcome is TriedOutcome.TOO_SMALL


@pytest.mark.long
def test_where_free_runs_miss_breakaways_both_models_are_judged_slip_by_slip():
    """In a quiet loop one missed breakaway is an error until the next. What explains the recording
    by far is named all the same, with a fit that grows and is said to be slip by slip."""
    case = draw_effect("growing_stiction", 2, 4075, "quiet")[1]
    run = case.simulated()
    answer = explain(run.recording)
    sound(answer, len(run.recording))
    assert ["growing_stiction"] == [effect.slug for effect in answer.effects]
    assert answer.heldout.slip_by_slip
    assert answer.heldout.fit_extended > 65.0
    assert answer.heldout.gain_low > 0.0
    assert off(answer.restated, case.loop.valve) < off(answer.naive, case.loop.valve)


@pytest.mark.long
def test_what_no_first_part_can_foretell_is_judged_on_alternate_blocks():
    """How a drift that wanders goes on cannot be told from its beginning. Over the blocks between
    those that were fitted it is, and S and J are restated with it."""
    case = draw_hidden(253, 2108)[252]
    run = case.simulated()
    answer = explain(run.recording)
    sound(answer, len(run.recording))
    assert ["sensor_drift"] == [effect.slug for effect in answer.effects]
    assert answer.heldout.alternate_blocks
    assert answer.heldout.fit_extended > 90.0 > answer.heldout.fit_naive
    assert answer.heldout.gain_low > 0.0
    assert off(answer.restated, case.loop.valve) < 0.2 * off(answer.naive, case.loop.valve)


@pytest.mark.long
def test_a_stop_that_acts_in_few_blocks_explains_what_is_left():
    """Where much is left, what removes most of it stands, however few blocks it acts in."""
    case = draw_hidden(70, 2108)[69]
    run = case.simulated()
    answer = explain(run.recording)
    assert ["travel_stop"] == [effect.slug for effect in answer.effects]
    assert off(answer.restated, case.loop.valve) < off(answer.naive, case.loop.valve)


@pytest.mark.long
@pytest.mark.parametrize("place", [13, pytest.param(26, marks=pytest.mark.long)])
def test_noise_that_hides_slips_makes_no_unknown_of_a_plain_valve(place):
    """Fitted slip by slip, S is a fifth to a quarter too small in such noise, and contradicts that
    of free runs; but the free run leaves no more than the noise."""
    case = draw_hidden(27, 2114)[place]
    run = case.simulated()
    assert case.hidden == ()
    assert explain(run.recording).finding is Finding.NONE


@pytest.mark.long
@pytest.mark.parametrize("place", [48, pytest.param(255, marks=pytest.mark.long)])
def test_pushes_by_hand_are_unknown_behind_noise_and_behind_an_archive(place):
    """In noise less is left where nothing is hidden; behind an archive that drew lines, hardly
    anything."""
    case = draw_hidden(256, 2114)[place]
    run = case.simulated()
    assert case.hidden == ("handwheel",)
    assert explain(run.recording).finding is Finding.UNKNOWN


@pytest.mark.long
def test_a_bow_that_a_flow_force_may_have_is_no_bowed_linkage():
    """The force of this plug is largest at 54 % of travel, so that its shape is a little bent."""
    case = draw_effect("flow_force", 12, 4071, "rich")[11]
    run = case.simulated()
    answer = explain(run.recording)
    sound(answer, len(run.recording))
    assert ["flow_force"] == [effect.slug for effect in answer.effects]
    assert off(answer.restated, case.loop.valve) < off(answer.naive, case.loop.valve)


def sticking_through_a_bent_reading(bend: float, seed: int, samples: int = 3600) -> Recording:
    """OP that wanders over 20 to 80 %, Choudhury's element, and a reading that is ``bend`` percent
    off in the middle of the stroke and right at its ends."""
    rng = np.random.default_rng(seed)
    corners = np.arange(0, samples + 150, 150)
    op = np.interp(np.arange(samples), corners, rng.uniform(20.0, 80.0, corners.size))
    stem = stick_slip(op, 4.0, 1.2)
    mv = stem + bend * (1.0 - (stem / 50.0 - 1.0) ** 2) + 0.05 * rng.standard_normal(samples)
    return recorded(op, mv)


@pytest.mark.parametrize(("bend", "seed"), [(5.0, 0), (-5.0, 1)])
def test_a_reading_that_is_bent_and_a_flow_force_are_one_finding(bend, seed):
    """A force that depends on position does the same to the recording, and its mean is no second
    finding."""
    recording = sticking_through_a_bent_reading(bend, seed)
    answer = explain(recording)
    sound(answer, len(recording))
    assert [{"flow_force", "bowed_linkage"}] == [set(one.members) for one in answer.effects]
    assert Finding.CANDIDATES is answer.finding
    assert answer.restated.S.low <= 4.0 <= answer.restated.S.high


@pytest.mark.long
def test_what_is_too_small_on_the_whole_record_is_not_named():
    """A positioner that overshoots by a hundredth of each move was large enough where it was found;
    fitted to all of the record it is how good ones are made."""
    case = draw_nulls(17, 4076, "quiet")[16]
    assert explain(case.simulated().recording).effects == ()


@pytest.mark.long
def test_slip_by_slip_nothing_is_named_in_quiet_loops_that_hide_nothing():
    """The second comparison is no second chance for what is not there."""
    for case in draw_nulls(12, 4075, "quiet"):
        assert explain(case.simulated().recording).effects == ()


@hidden
def test_s_and_j_are_restated_closer_to_the_valve(slug, seed, name, size, within):
    """With the physics accounted for, S and J are near the truth, nearer than S and J alone."""
    result, (_, valve, _) = explained(slug, seed), simulated(slug, seed)
    assert off(result.restated, valve) < 0.12 * (valve.S + valve.J)
    if slug in BIASED and off(result.naive, valve) > 0.1 * (valve.S + valve.J):
        assert off(result.restated, valve) < 0.5 * off(result.naive, valve)


@hidden
def test_the_fit_to_unseen_data_goes_up(slug, seed, name, size, within):
    """On the part that was not fitted, with its interval, against noise."""
    heldout = explained(slug, seed).heldout
    assert heldout.rmse_extended < heldout.rmse_naive
    assert heldout.fit_extended > heldout.fit_naive
    assert heldout.gain_low <= heldout.fit_extended - heldout.fit_naive <= heldout.gain_high
    assert 0.0 < heldout.noise_floor < heldout.rmse_extended


@hidden
def test_what_was_tried_is_kept_with_its_scores(slug, seed, name, size, within):
    """Every effect stands once; what is named gains most, and all together no less than each."""
    result = explained(slug, seed)
    by_slug = {item.slug: item for item in result.tried}
    assert len(by_slug) == len(result.tried)
    assert not set(by_slug) & {item.slug for item in result.not_testable}
    named = {item.slug for item in result.tried if item.outcome is TriedOutcome.NAMED}
    assert named == {effect.slug for effect in result.effects} & set(by_slug)
    for effect in result.effects:
        for other in set(effect.members[1:]) - named:
            assert by_slug[other].outcome is TriedOutcome.AS_GOOD
    if {effect.slug for effect in result.effects} - named:  # an error of the reading
        assert result.together is None
        return
    assert result.together is not None
    assert result.together.mean >= max(by_slug[slug].alone.mean for slug in named) - 0.05
    for item in result.tried:
        if item.outcome is TriedOutcome.ADDS_NOTHING:
            assert item.beside is not None
            assert item.beside.mean < item.alone.mean


@hidden
def test_before_and_after_share_their_cells(slug, seed, name, size, within):
    """The same rows, columns and empty cells: both maps are of the same samples."""
    before, after = explained(slug, seed).before, explained(slug, seed).after
    assert before.travel_edges == after.travel_edges
    assert before.columns == after.columns
    assert [[cell is None for cell in row] for row in before.grid] == [
        [cell is None for cell in row] for row in after.grid
    ]
    assert [(c.facet, c.label, c.samples) for c in before.cells] == [
        (c.facet, c.label, c.samples) for c in after.cells
    ]


@pytest.mark.parametrize(
    "seed", [4001, *(pytest.param(seed, marks=pytest.mark.long) for seed in (4000, 4003))]
)
def test_where_nothing_is_hidden_nothing_is_named(seed):
    """A stick-slip valve with scatter and noise: S and J explain it."""
    result, (recording, valve, _) = explained("null", seed), simulated("null", seed)
    sound(result, len(recording))
    assert Finding.NONE is result.finding
    assert "S and J explain this recording" in result.sentence
    assert off(result.restated, valve) < 0.1 * (valve.S + valve.J)


@pytest.mark.parametrize("seed", [4001, pytest.param(4007, marks=pytest.mark.long)])
def test_what_no_term_explains_is_unknown_with_its_place(seed):
    """A vibration is systematic and not in the catalogue: no name, and a map of what is left."""
    result, (recording, _, _) = explained("vibration", seed), simulated("vibration", seed)
    sound(result, len(recording))
    assert Finding.UNKNOWN is result.finding
    assert () == result.effects
    assert result.before.cells
    assert result.after.cells


def test_the_same_recording_gives_the_same_answer():
    """The result does not depend on chance, time or earlier calls."""
    once = explained("dead_time", 4000)
    explain(simulated("null", 4001)[0].part(0, 900))
    twice = explain(simulated("dead_time", 4000)[0])
    alike = replace(twice, runs=None, seconds=once.seconds)
    assert replace(once, runs=None) == alike
    np.testing.assert_array_equal(once.runs.naive, twice.runs.naive)
    np.testing.assert_array_equal(once.runs.extended, twice.runs.extended)


@pytest.mark.parametrize("value", [1e300, pytest.param(-5_000.0, marks=pytest.mark.long)])
def test_an_impossible_sample_is_left_out_alone(value):
    """A command or a position outside of any percent range counts as missing."""
    part = simulated("null", 4001)[0].part(0, 900)
    op, mv = (part.signals[role].values.copy() for role in (Role.OP, Role.MV))
    op[[0, 200]], mv[500] = value, value
    explanation = explain(recorded(op, mv))
    op[[0, 200]], mv[500] = np.nan, np.nan
    without = explain(recorded(op, mv))
    assert replace(explanation, runs=None, seconds=0.0) == replace(without, runs=None, seconds=0.0)


def test_without_a_position_the_stem_is_not_named():
    """OP, PV and SP alone: not testable, every physical effect with the same reason."""
    recording = simulated("dead_time", 4000)[0]
    signals = {role: item for role, item in recording.signals.items() if role is not Role.MV}
    explanation = explain(replace(recording, signals=signals))
    sound(explanation, len(recording))
    assert Finding.NOT_TESTABLE is explanation.finding
    assert NO_POSITION in explanation.sentence
    assert set(PHYSICS) <= {
        item.slug for item in explanation.not_testable if item.reason == NO_POSITION
    }
    assert explanation.restated.S.reason == NO_POSITION


@pytest.mark.long
@pytest.mark.parametrize(
    "freezes", [(700,), pytest.param((2300,), marks=pytest.mark.long), (700, 2300)]
)
def test_a_frozen_reading_is_no_stiction(freezes):
    """Stretches of seven minutes that repeat one value are a record effect and nothing else."""
    recording, valve, _ = simulated("null", 4001)
    mv = recording.mv.values.copy()
    for first in freezes:
        mv[first : first + 420] = mv[first]
    explanation = explain(rescaled(recording, mv))
    sound(explanation, mv.size)
    assert "frozen_signal" in [record_effect.slug for record_effect in explanation.record_effects]
    assert Finding.NONE is explanation.finding
    assert off(explanation.restated, valve) < 0.1 * (valve.S + valve.J)


def test_a_reading_that_never_changes_is_not_testable():
    """A transmitter that is stuck throughout shows nothing of the stem."""
    explanation = explain(recorded(command(), np.full(command().size, 47.0)))
    assert Finding.NOT_TESTABLE is explanation.finding
    assert explanation.restated.S.value is None


def test_the_network_s_free_run_is_the_ceiling():
    """It is shown with the result and changes nothing else."""
    recording = simulated_by_chain(samples=900)
    plain, under = explain(recording), explain(recording, ceiling=recording.mv.values + 0.1)
    assert None is plain.heldout.rmse_ceiling
    assert 0.1 == pytest.approx(under.heldout.rmse_ceiling)
    assert replace(under.heldout, rmse_ceiling=None) == plain.heldout
    assert under.effects == plain.effects


def test_scores_are_those_of_all_terms_that_could_have_shown():
    """Calibration sees mean and t of each admissible term, none of the base's own, all finite."""
    null = null_scores(simulated("null", 4001)[0])
    result = null.terms
    refused = {item.slug for item in explained("null", 4001).not_testable}
    added = {slug for slug, term in catalogue().items() if not term.in_base}
    assert set(result) == added - refused
    assert all(np.isfinite(pair).all() for pair in result.values())
    assert null.pair < LEAST_OF_A_PAIR
    assert {} == null_scores(recorded(command(), None)).terms


ODD_POSITIONS = {
    "usual": lambda mv, op, rng: mv,
    "constant": lambda mv, op, rng: np.full(op.size, 50.0),
    "reversed": lambda mv, op, rng: 100.0 - mv,
    "integer": lambda mv, op, rng: np.round(mv),
    "huge": lambda mv, op, rng: 1e9 * (mv - 50.0),
    "tiny": lambda mv, op, rng: 1e-7 * mv,
    "the command": lambda mv, op, rng: op,
    "noise": lambda mv, op, rng: 50.0 + 2.0 * rng.standard_normal(op.size),
    "none good": lambda mv, op, rng: np.full(op.size, np.nan),
    "one spike": lambda mv, op, rng: np.where(np.arange(op.size) == op.size // 2, 1e6, mv),
    "holes": lambda mv, op, rng: np.where(np.arange(op.size) // 40 % 4 == 2, np.nan, mv),
}
ODD_COMMANDS = {
    "usual": lambda op, rng: op,
    "constant": lambda op, rng: np.full(op.size, 50.0),
    "square": lambda op, rng: 50.0 + 8.0 * np.sign(np.sin(np.arange(op.size) / 15.0 + 0.1)),
    "integer": lambda op, rng: np.round(op),
    "huge": lambda op, rng: 1e9 * op,
    "holes": lambda op, rng: np.where(rng.random(op.size) < 0.1, np.nan, op),
    "one step": lambda op, rng: np.where(np.arange(op.size) < op.size // 2, 40.0, 60.0),
}


@pytest.mark.long
@given(
    samples=st.sampled_from([1, 3, 80, 250, 420]),
    interval_s=st.sampled_from([0.1, 1.0, 60.0]),
    of_op=st.sampled_from([*ODD_COMMANDS]),
    of_mv=st.sampled_from([*ODD_POSITIONS]),
    seed=st.integers(0, 2**20),
)
@example(samples=420, interval_s=0.1, of_op="huge", of_mv="usual", seed=0)
@example(samples=80, interval_s=0.1, of_op="huge", of_mv="constant", seed=0)
@example(samples=3, interval_s=0.1, of_op="usual", of_mv="usual", seed=0)
@example(samples=80, interval_s=1.0, of_op="usual", of_mv="none good", seed=0)
@settings(max_examples=25, deadline=None)
def test_any_recording_gives_a_consistent_mismatch(samples, interval_s, of_op, of_mv, seed):
    """No recording raises or warns; what is said has numbers with intervals, or reasons."""
    rng = np.random.default_rng(seed)
    op = ODD_COMMANDS[of_op](command()[:samples], rng)
    mv = ODD_POSITIONS[of_mv](
        simulated_by_chain().mv.values[:samples], np.nan_to_num(op, nan=50.0), rng
    )
    explanation = explain(recorded(op, mv, interval_s=interval_s))
    sound(explanation, samples)
    if samples < 50 or "constant" in (of_op, of_mv) or of_mv == "none good":
        assert Finding.NOT_TESTABLE is explanation.finding


@pytest.mark.long
def test_a_reversed_position_is_not_called_a_sticking_valve():
    """A position that falls as OP rises has the S of one that rises, and a sentence says so."""
    recording = simulated_by_chain()
    plain, result = explain(recording), explain(rescaled(recording, 100.0 - recording.mv.values))
    sound(result, len(recording))
    assert result.finding is plain.finding
    assert result.stroke_curve is not None
    assert result.stroke_curve.slope == pytest.approx(-1.0, abs=0.1)
    assert result.sentence.startswith(result.stroke_curve.sentence())
    assert result.restated.S.low <= plain.restated.S.value <= result.restated.S.high


def test_rivals_of_the_last_effect_give_their_S_and_J():
    """The last stage's rivals, each with the middle of its two folds; none without an effect."""

    def score(S, ratio):
        candidates = np.zeros((2, base_coordinate.N_BASE))
        candidates[:, base_coordinate.S_PERCENT] = S
        candidates[:, base_coordinate.RATIO] = ratio
        return SimpleNamespace(fitted=SimpleNamespace(candidates=candidates))

    stage = SimpleNamespace(accepted=(score((8.0, 9.0), 0.3), score((7.0, 8.0), 0.2)))
    named = SimpleNamespace(needed=(SimpleNamespace(stage=stage),))
    ((S, J),) = of_rivals(SimpleNamespace(named=named, effects=("viscous_drag",)))
    assert (S.low, S.high) == (7.5, 7.5)
    assert J.low == J.high == pytest.approx(1.5)
    assert not list(of_rivals(SimpleNamespace(named=named, effects=())))


@pytest.mark.long
@pytest.mark.parametrize(("seed", "valve", "day"), [(5151, 29, 20), (9393, 13, 11)])
def test_a_top_speed_that_few_blocks_of_time_show_is_named(seed, valve, day):
    """A valve that vents at 0.6 %/s is held by it in 3 % of a window of half an hour, and is then 9
    to 23 % from its command."""
    life = draw_lives(valve + 1, 90, seed)[valve]
    seed_of_day = int(np.random.default_rng([life.seed, day, 3]).integers(2**31))
    found = explain(simulate_loop(life.on(day, 1800.0), seed_of_day).recording)
    assert [effect.slug for effect in found.effects] == ["asymmetric_rate_limit"]
    falling = found.effects[0].parameters["rate_falling"]
    assert falling.value == pytest.approx(0.6, rel=0.1)


def test_two_blocks_of_time_name_a_top_speed_and_one_does_not():
    """One block of twenty, however much it gains, names nothing."""
    counts, gains = np.full(20, 87.0), np.zeros(20)
    gains[3] = 2.0
    one = Advantage(0.1, float(0.1 / (gains.std(ddof=1) / np.sqrt(20.0) + 0.01)))
    assert strength(one, counts, "asymmetric_rate_limit") < 1.0
    gains[8] = 2.0
    two = Advantage(0.2, float(0.2 / (gains.std(ddof=1) / np.sqrt(20.0) + 0.01)))
    assert strength(two, counts, "asymmetric_rate_limit") >= 1.0
    assert strength(two, counts, "actuator_lag") < 1.0
