"""The population with hidden effects is what it says: shares, sizes, chance, and excitation."""

import json
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stemwatch.models.studies.simulator import simulate_loop
from stemwatch.models.studies.simulator.defects import AirLine, BodyDefects, PackingDefects, Upsets
from stemwatch.models.studies.simulator.hidden import (
    CONCEALMENTS,
    EFFECTS,
    EXCITED_PERCENT,
    NAMED_SINCE,
    PHYSICS,
    RARE,
    RECORD,
    UNKNOWN,
    HiddenCase,
    draw_effect,
    draw_hidden,
    draw_nulls,
    draw_unknown,
    simulate_hidden,
)
from stemwatch.models.studies.simulator.hidden.catalogue import (
    effect_named,
    go_together,
    with_effect,
)
from stemwatch.models.studies.simulator.truth import effects_of

# What the catalogue lets each number be; sizes are in the unit that their name carries.
_RANGES = {
    "actuator_lag.lag_s": (0.3, 10.0),
    "asymmetric_lag.fill_lag_s": (0.3, 10.0),
    "asymmetric_lag.vent_lag_s": (0.3, 10.0),
    "dead_time.delay_s": (0.5, 8.0),
    "rate_limit.rate_percent_per_s": (0.2, 10.0),
    "asymmetric_rate_limit.fill_percent_per_s": (0.2, 30.0),
    "asymmetric_rate_limit.vent_percent_per_s": (0.2, 30.0),
    "underdamped_positioner.ring_rad_per_s": (0.2, 1.5),
    "underdamped_positioner.damping": (0.1, 0.6),
    "viscous_drag.drag_s": (0.1, 6.0),
    "low_speed_restick.stribeck_percent_per_s": (0.1, 2.0),
    "asymmetric_slip.J_skew": (-0.8, 0.8),
    "position_dependent_friction.height_percent": (0.5, 5.0),
    "position_dependent_friction.width_percent": (2.0, 10.0),
    "growing_stiction.growth": (0.3, 1.5),
    "stem_creep.creep_percent_per_s": (-0.05, 0.05),
    "travel_stop.high_percent": (57.0, 70.0),
    "travel_stop.low_percent": (30.0, 43.0),
    "flow_force.flow_percent": (-8.0, 8.0),
    "lost_motion.play_percent": (0.3, 4.0),
    "zero_shift.zero_percent": (-5.0, 5.0),
    "span_error.span": (0.9, 1.1),
    "sensor_drift.drift_percent": (-5.0, 5.0),
    "supply_sag.share": (0.01, 0.25),
}
_seeds = st.integers(0, 2**20)


def _short(case: HiddenCase) -> HiddenCase:
    """The case on ten minutes, for what does not need the hour."""
    return replace(
        case,
        loop=replace(case.loop, duration_s=600.0),
        plain=replace(case.plain, duration_s=600.0),
    )


def test_a_case_depends_on_its_place_and_the_seed_alone() -> None:
    """The first cases of a longer draw are those of a shorter one, and another seed differs."""
    for draw in (draw_hidden, draw_nulls, draw_unknown):
        few, several = draw(5, 3), draw(9, 3)
        assert few == several[:5]
        assert few != draw(5, 4)
    assert draw_effect("dead_time", 2, 3) == draw_effect("dead_time", 4, 3)[:2]


def test_the_same_case_gives_the_same_record() -> None:
    """Simulating a case twice gives one recording to the bit and one excitation."""
    case = _short(draw_hidden(2, 1)[1])
    (first, run), (second, repeated) = simulate_hidden(case), simulate_hidden(case)
    assert first == second
    for role, signal in run.recording.signals.items():
        np.testing.assert_array_equal(signal.values, repeated.recording.signals[role].values)


def test_the_mixture_is_as_promised() -> None:
    """A fifth nulls, eleven in twenty single, three in twenty pairs, a tenth rare ones, two
    sevenths of them in the catalogue since; every effect, every kind outside it and every
    concealment occurs."""
    cases = draw_hidden(480, 1)
    kinds = Counter("unknown" if c.effects == ("unknown",) else len(c.effects) for c in cases)
    assert {0: 96, 1: 277, 2: 72, "unknown": 35} == kinds
    singles = Counter(c.effects[0] for c in cases if len(c.effects) == 1)
    assert {*EFFECTS, *NAMED_SINCE, "unknown"} == set(singles)
    assert min(singles[slug] for slug in EFFECTS) >= 10
    assert set(UNKNOWN) == {c.hidden[0] for c in cases if c.effects == ("unknown",)}
    assert set(CONCEALMENTS) == {c.concealment for c in cases}
    for slug in PHYSICS:
        assert len({c.concealment for c in cases if c.effects == (slug,)}) > 4


def test_half_of_the_nulls_have_high_scatter() -> None:
    """Every second null scatters by 12 %, the others by 5 to 12 %."""
    for cases in (draw_nulls(40, 2), [c for c in draw_hidden(200, 2) if not c.hidden]):
        scatters = np.array([case.loop.valve.scatter for case in cases])
        assert np.mean(scatters == 0.12) >= 0.5
        assert 0.05 == scatters.min()
        assert scatters.max() <= 0.12


@given(seed=_seeds, concealment=st.sampled_from(CONCEALMENTS))
@settings(max_examples=40, deadline=None)
def test_a_null_hides_nothing(seed: int, concealment: str) -> None:
    """A null is its own plain twin, with small natural lags and no error of the transmitter."""
    for case in draw_nulls(2, seed, concealment):
        loop, valve, seen = case.loop, case.loop.valve, case.loop.transmitters
        assert case.plain == loop
        assert () == case.effects == case.hidden
        assert {} == case.sizes
        assert (AirLine(), BodyDefects(), Upsets()) == (valve.air_line, valve.body, loop.upsets)
        assert PackingDefects(presliding_percent=valve.packing.presliding_percent) == valve.packing
        assert valve.actuator.air_lag_s <= 0.4
        assert valve.actuator.dead_time_s <= 0.3
        assert valve.actuator.viscous_s <= 0.05
        assert 0.0 == valve.positioner_gain
        assert (0.0, 1.0, 0.0) == (seen.position_zero, seen.position_span, seen.position_play)
        assert 2.0 <= valve.S <= 8.0
        assert 0.15 <= valve.J / valve.S <= 0.7


@given(seed=_seeds, slug=st.sampled_from([*EFFECTS, *RARE]))
@settings(max_examples=60, deadline=None)
def test_sizes_lie_in_the_catalogues_ranges(seed: int, slug: str) -> None:
    """Every drawn number is within its range, and the loop is the plain one with just that."""
    case = draw_effect(slug, 1, seed)[0]
    assert case.loop == with_effect(case.plain, slug, case.sizes) != case.plain
    assert case.sizes
    for name, size in case.sizes.items():
        low, high = _RANGES.get(name, (-np.inf, np.inf))
        assert low <= size <= high, name
    friction = case.loop.valve
    heavier = friction.J * (1.0 + abs(friction.packing.J_skew))
    assert heavier < friction.S * (1.0 + 1e-9)


@pytest.mark.parametrize("slug", [*PHYSICS, *NAMED_SINCE, *RECORD])
def test_the_truth_names_what_is_hidden(slug: str) -> None:
    """The truth of the loop lists the hidden slug, and that of its plain twin does not, but for
    the two that every valve has a little of."""
    case = draw_effect(slug, 1, 7)[0]
    assert slug in effects_of(case.loop)
    if slug not in ("actuator_lag", "dead_time"):
        assert slug not in effects_of(case.plain)
    assert "unknown" not in effects_of(case.loop)


def test_an_effect_outside_the_catalogue_is_called_unknown() -> None:
    """The expected answer is "unknown"; the truth keeps the name of the effect."""
    for case in draw_unknown(len(UNKNOWN), 1):
        assert ("unknown",) == case.effects
        assert case.hidden[0] in UNKNOWN
        assert "unknown" in effects_of(case.loop)


def test_pairs_are_of_different_kinds() -> None:
    """No pair is twice the same, and none of one group that would hide each other."""
    pairs = [case.hidden for case in draw_hidden(200, 5) if len(case.hidden) == 2]
    assert 30 == len(pairs)
    assert all(go_together(*pair) for pair in pairs)
    assert not go_together("actuator_lag", "viscous_drag")
    assert not go_together("dead_time", "dead_time")


def test_a_stop_that_is_never_reached_is_not_excited() -> None:
    """The same stop is in the record of a loop that reaches it and not of one that stays away."""
    case = _short(draw_effect("travel_stop", 1, 1)[0])
    far = replace(case.loop, valve=replace(case.loop.valve, body=BodyDefects(high_percent=99.9)))
    out = replace(case, loop=far, sizes={"travel_stop.high_percent": 99.9})
    calm = replace(out, loop=replace(far, setpoints=()), plain=replace(out.plain, setpoints=()))
    assert simulate_hidden(case)[0].excited
    unreached, _ = simulate_hidden(calm)
    assert {"travel_stop": 0.0} == unreached.excitation
    assert not unreached.excited


def test_a_null_is_excited_and_a_case_that_did_not_run_is_not() -> None:
    """A case with nothing hidden counts as excited; one with an effect only after its
    simulation.
    """
    assert draw_nulls(1, 1)[0].excited
    assert not draw_effect("zero_shift", 1, 1)[0].excited


def test_a_zero_shift_moves_the_reading_by_itself() -> None:
    """The excitation of a zero shift is its size, whatever else is hidden beside it."""
    case = _short(draw_effect("zero_shift", 1, 1)[0])
    sizes = case.sizes | {"dead_time.delay_s": 2.0}
    pair = replace(
        case,
        hidden=("zero_shift", "dead_time"),
        sizes=sizes,
        loop=with_effect(case.loop, "dead_time", sizes),
    )
    seen, run = simulate_hidden(pair)
    zero = abs(sizes["zero_shift.zero_percent"])
    assert pytest.approx(zero, rel=1e-6) == seen.excitation["zero_shift"]
    assert seen.excitation["dead_time"] > EXCITED_PERCENT
    assert seen.excited
    assert run.truth.tag == case.loop.tag


@pytest.mark.long
def test_most_of_the_routine_records_show_what_is_hidden() -> None:
    """Of ten routine minutes for each effect of the catalogue, nearly all are excited."""
    matching = [simulate_hidden(_short(draw_effect(slug, 1, 4)[0]))[0] for slug in EFFECTS]
    assert np.mean([case.excited for case in matching]) > 0.8


@pytest.mark.parametrize(
    "concealment",
    [
        pytest.param(name, marks=[] if name in ("quiet", "positioner") else [pytest.mark.long])
        for name in (*CONCEALMENTS, "positioner")
    ],
)
def test_every_loop_makes_the_valve_travel(concealment: str) -> None:
    """Loops with moves travel over 20 %, quiet ones less; all of them slip both ways."""
    for case in draw_nulls(3, 6, concealment):
        stem = simulate_loop(case.loop, case.seed).stem
        moved = np.diff(stem)
        assert (moved > 0.3).sum() > 3
        assert (moved < -0.3).sum() > 3
        assert np.ptp(stem) > (2.0 if concealment in ("quiet", "short") else 20.0)


def test_an_effect_that_does_not_exist_is_refused() -> None:
    """The error lists what there is."""
    with pytest.raises(KeyError, match=r"'gravity'.*actuator_lag.*vibration"):
        effect_named("gravity")


def test_a_case_serialises() -> None:
    """Truth and sizes of a hidden case go through JSON unchanged."""
    case, run = simulate_hidden(_short(draw_effect("asymmetric_rate_limit", 1, 1)[0]))
    assert run.truth.as_json() == json.loads(json.dumps(run.truth.as_json(), allow_nan=False))
    assert case.sizes == json.loads(json.dumps(case.sizes, allow_nan=False))
