"""The whole record shows effects that no trajectory does, and names nothing where nothing is."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from stemwatch.models.mismatch.acceptance.accepted_hypothesis import named_effects
from stemwatch.models.mismatch.explain import explain
from stemwatch.models.mismatch.findings import Finding, Mismatch
from stemwatch.models.mismatch.likelihood.likelihood_evidence import LEAST_GAIN
from stemwatch.models.mismatch.likelihood.maximum_likelihood import RecordLikelihood
from stemwatch.models.mismatch.measurement.record_effects import measured_record
from stemwatch.models.mismatch.prepared_recording import prepare, problem_of
from stemwatch.models.mismatch.search.compared_by_likelihood import STARTS, _spread
from stemwatch.models.mismatch.search.named_by_likelihood import strongest_by_likelihood
from stemwatch.models.mismatch.terms import catalogue
from stemwatch.models.preparation.own_clock import on_own_clock
from stemwatch.models.studies.simulator.hidden import draw_effect, draw_hidden, draw_nulls
from tests.models.mismatch.fitted_chain import (
    candidate,
    evaluator_of,
    hypothesis,
    simulated_by_chain,
)


def test_a_climb_ends_at_what_is_true() -> None:
    """S, J and noise from a start that is off."""
    recording = simulated_by_chain(S=5.0, J=1.5)
    evaluator = evaluator_of(recording)
    likelihood, layout = RecordLikelihood(evaluator), evaluator.layout(hypothesis())
    start = np.append(candidate(layout, 4.4, 1.2), likelihood.first_of_record)
    found = likelihood.maximised(layout, [start])
    S, J = found.candidate[0], found.candidate[0] * found.candidate[1]
    assert pytest.approx(5.0, abs=0.15) == S
    assert pytest.approx(1.5, abs=0.15) == J
    assert np.exp(found.of_record[0]) == pytest.approx(0.05, rel=0.5)


def test_a_richer_hypothesis_at_its_neutral_values_is_as_likely() -> None:
    """What a term gains is its own."""
    recording = simulated_by_chain()
    evaluator = evaluator_of(recording)
    likelihood = RecordLikelihood(evaluator)
    simple, rich = evaluator.layout(hypothesis()), evaluator.layout(hypothesis("lost_motion"))
    alone = likelihood.at(simple, np.append(candidate(simple), likelihood.first_of_record))
    beside = likelihood.at(rich, np.append(candidate(rich), likelihood.first_of_record))
    assert beside.total == pytest.approx(alone.total, abs=1e-9)


@cache
def hidden_delay():
    """A quarter of an hour whose trajectories show nothing, and what is said of it."""
    run = draw_effect("dead_time", 14, 4064, "short")[13].simulated()
    return run, explain(run.recording)


def test_what_no_trajectory_shows_the_record_as_a_whole_does() -> None:
    """A dead time of a few seconds, with S and J that hold, and the evidence in words."""
    run, mismatch = hidden_delay()
    assert [effect.slug for effect in mismatch.effects] == ["dead_time"]
    evidence = mismatch.effects[0].evidence
    assert evidence.likelihood_gain > LEAST_GAIN
    assert evidence.strength >= 1.0
    assert "more likely with this effect" in evidence.note
    S = mismatch.restated.S
    assert S.low <= run.truth.S <= S.high
    assert abs(mismatch.restated.S.value - run.truth.S) < abs(mismatch.naive.S.value - run.truth.S)


def test_what_is_named_predicts_unseen_samples_better() -> None:
    """By the free run that is shown."""
    _, mismatch = hidden_delay()
    assert mismatch.heldout.improves


def test_with_nothing_hidden_nothing_is_named() -> None:
    """By the same search."""
    run = draw_nulls(7, 4064)[6].simulated()
    mismatch = explain(run.recording)
    assert mismatch.effects == ()
    assert mismatch.finding is Finding.NONE


@pytest.mark.parametrize(
    "case",
    [
        pytest.param(lambda: draw_nulls(89, 4063)[88], id="4063-88"),
        pytest.param(lambda: draw_hidden(211, 2136)[210], id="2136-210", marks=pytest.mark.long),
    ],
)
def test_a_size_that_the_record_does_not_tell_from_a_harmless_one_is_not_named(case) -> None:
    """Air that takes 0.14 and 0.19 s: in coarse steps a few samples after quick moves make a lag of
    0.8 s more likely by 260 and 610, but one below 0.7 s as likely over the blocks."""
    run = case().simulated()
    assert explain(run.recording).effects == ()


def explained(seed: int, number: int) -> Mismatch:
    """What is said of a valve of the proof's draw."""
    run = draw_hidden(number + 1, seed)[number].simulated()
    return explain(run.recording)


def named_on_drawn(seed: int, number: int) -> set[tuple[str, ...]]:
    """The effects that are named on a valve of the proof's draw."""
    return {effect.members for effect in explained(seed, number).effects}


@pytest.mark.long
def test_a_limit_of_one_way_is_not_taken_for_one_of_both() -> None:
    """Begun from the limit both ways, which its own search had not come near to."""
    assert named_on_drawn(2116, 225) == {("asymmetric_rate_limit",)}


@pytest.mark.long
def test_a_limit_of_both_ways_is_no_limit_of_one() -> None:
    """Where only one fast move tells them apart, both are said."""
    (members,) = named_on_drawn(2116, 136)
    assert members[0] == "rate_limit"


@pytest.mark.long
def test_what_trajectories_dropped_may_still_be_shown() -> None:
    """A force by the flow, too small a part of what a free run misses in noise."""
    assert named_on_drawn(2114, 158) == {("flow_force", "bowed_linkage")}


@pytest.mark.long
def test_friction_at_a_place_is_shown_by_the_whole_record() -> None:
    """In noise, where no trajectory shows it."""
    run = draw_effect("position_dependent_friction", 9, 4063, "noisy")[8].simulated()
    (effect,) = explain(run.recording).effects
    assert effect.members == ("position_dependent_friction",)
    assert effect.evidence.likelihood_gain > LEAST_GAIN


def test_a_term_is_begun_from_other_s_and_j_as_well() -> None:
    """All its sizes beside the S and J that were fitted, and some of them beside each other S and
    J, of which two neighbours have no size in common.
    """
    sizes, others = 6, 5
    rows = np.array([(S, size) for S in range(1 + others) for size in range(sizes)], dtype=float)
    begun = _spread(rows, sizes)
    assert np.array_equal(begun[:sizes], rows[:sizes])
    for S in range(1, 1 + others):
        here, before = (set(begun[begun[:, 0] == each, 1]) for each in (S, S - 1))
        assert 0 < len(here) < sizes
        assert S == 1 or not here & before
    assert len(begun) <= STARTS + sizes


@pytest.mark.long
@pytest.mark.parametrize(("seed", "number"), [(2124, 72), (2127, 204)])
def test_play_is_begun_where_the_reading_comes_to_rest(seed: int, number: int) -> None:
    """About as wide as a slip is high: S and J alone end far from the true ones then."""
    assert named_on_drawn(seed, number) == {("lost_motion",)}


@pytest.mark.parametrize("number", [53, 71])
def test_the_record_without_play_is_searched_where_the_reading_rests_as_with_it(
    number: int,
) -> None:
    """Nothing is hidden; S and J alone had ended at another level, and play made up for that."""
    recording = on_own_clock(draw_nulls(number + 1, 4064)[number].simulated().recording)
    measured = measured_record(recording)
    case = prepare(recording, measured, None, problem_of(recording, measured))
    play = catalogue()["lost_motion"]
    assert strongest_by_likelihood(named_effects(case, {}), [play]) < 1.0


@pytest.mark.long
def test_what_no_trajectory_shows_none_must_show_on_unseen_samples() -> None:
    """A lag in a quiet loop, where the free run is as near without it."""
    assert named_on_drawn(2119, 218) == {("actuator_lag",)}


@pytest.mark.long
def test_breakaways_that_scatter_most_do_not_hide_a_name() -> None:
    """A lag of one way of a stem whose breakaways scatter by 0.12; a sag is as likely."""
    (members,) = named_on_drawn(2119, 264)
    assert members[0] == "asymmetric_lag"


@pytest.mark.long
def test_a_stem_that_is_too_slow_to_arrive_is_behind_no_curve() -> None:
    """A limit of 0.5 %/s for a quarter of an hour, which looks like a curve from OP to stroke."""
    assert named_on_drawn(2119, 136) == {("rate_limit",)}


@pytest.mark.long
def test_a_stem_at_its_stop_is_behind_no_curve() -> None:
    """The reading drifts as well; a curve that is flat at one end leaves more of both."""
    assert named_on_drawn(4090, 897) == {("travel_stop",), ("sensor_drift",)}


@pytest.mark.long
def test_the_likelihood_is_asked_again_beside_what_it_has_shown() -> None:
    """A positioner that rings, in noise, beside friction at a place that no trajectory shows."""
    both = {("position_dependent_friction",), ("underdamped_positioner",)}
    assert named_on_drawn(4090, 71) == both


@pytest.mark.long
def test_a_dead_time_beside_a_stem_that_sticks_again_is_no_uneven_reading() -> None:
    """Its small slips come early or late by chance, as readings of uneven age do. A lag is as good
    as the dead time there, and an overshoot as that stem.
    """
    late = ("actuator_lag", "asymmetric_lag", "dead_time")
    assert named_on_drawn(4090, 857) == {late, ("slip_overshoot", "low_speed_restick")}


@pytest.mark.long
def test_slips_of_one_way_that_are_too_small_to_see_are_compared() -> None:
    """The stem moves as often the other way, and slips there."""
    run = draw_hidden(366, 2119)[365].simulated()
    refused = {untestable.slug for untestable in explain(run.recording).not_testable}
    assert "asymmetric_slip" not in refused


@pytest.mark.long
@pytest.mark.parametrize(
    ("number", "both"),
    [
        # A stop in few places, and a creep that the likelihood shows beside it.
        (223, {"travel_stop", "stem_creep"}),
        # The force was refused: trajectories were compared with those that were fitted to them.
        (237, {"flow_force", "stem_creep"}),
        # A stem that sticks again did not stand while the drift beside it was not named.
        (131, {"sensor_drift", "low_speed_restick"}),
    ],
)
def test_a_second_effect_stands_beside_one_that_the_likelihood_shows(
    number: int, both: set[str]
) -> None:
    """Both are in the answer, each in a class of its own, and nothing else."""
    named = named_on_drawn(2119, number)
    assert len(named) == len(both)
    assert all(any(slug in members for members in named) for slug in both)


@pytest.mark.long
def test_two_fits_that_contradict_are_no_doubt_where_the_record_as_a_whole_has_none() -> None:
    """S and J alone miss slips and end at twice the true S; the likelihood follows them all."""
    run = draw_hidden(81, 2116)[80].simulated()
    mismatch = explain(run.recording)
    assert mismatch.finding is Finding.NONE
    assert mismatch.naive.S.value > 2.0 * run.truth.S
    assert mismatch.restated.S.value == pytest.approx(run.truth.S, abs=0.1)
    assert mismatch.restated.J.value == pytest.approx(run.truth.J, abs=0.1)
