"""The catalogue of terms: names, ranges, starts, material sizes, and sentences."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from stemwatch.models.estimate import Estimate
from stemwatch.models.mismatch.term import ActsOn, RecordingSummary
from stemwatch.models.mismatch.terms import catalogue
from stemwatch.models.preparation.own_clock import SpokenEstimate, estimate_in_seconds

CATALOGUE = catalogue()
everywhere = pytest.mark.parametrize("slug", sorted(CATALOGUE))
LOOK = RecordingSummary(
    interval_s=1.0,
    duration_s=3600.0,
    unit_s=1.0,
    op_low=25.0,
    op_high=75.0,
    mv_low=26.0,
    mv_high=74.0,
    sigma=0.05,
    S=4.0,
    J=1.0,
)
LOOKS = {
    "an hour at 1 s": LOOK,
    "fast": replace(LOOK, interval_s=0.1),
    "slow": replace(LOOK, interval_s=60.0, duration_s=86400.0),
    "quiet": replace(LOOK, op_low=48.0, op_high=50.5, mv_low=48.5, mv_high=50.0),
    "at the ends": replace(LOOK, op_low=-2.0, op_high=103.0, mv_low=0.0, mv_high=100.0),
    "reading far off": replace(LOOK, op_low=10.0, op_high=20.0, mv_low=60.0, mv_high=70.0),
}
PARAMETERS = {
    "actuator_lag": {"tau": "s"},
    "asymmetric_lag": {"tau_rising": "s", "tau_falling": "s"},
    "asymmetric_rate_limit": {"rate_rising": "%/s", "rate_falling": "%/s"},
    "asymmetric_slip": {"ratio": ""},
    "bowed_linkage": {"bow": "%"},
    "spring_hysteresis": {"H": "%", "way": "%"},
    "dead_time": {"theta": "s"},
    "dwell_dependent_breakaway": {"b": "%"},
    "flow_force": {"U": "%"},
    "growing_stiction": {"growth": "%"},
    "load_by_position": {"rise": "%", "bend": "%"},
    "lost_motion": {"b": "%"},
    "low_speed_restick": {"v_c": "%/s"},
    "motor_drive": {"tau": "s", "run_up": "s"},
    "position_dependent_friction": {"A": "%", "place": "%", "width": "%"},
    "presliding": {"c": "%"},
    "rate_limit": {"rate": "%/s"},
    "sensor_drift": {"D": "%", "range": "%"},
    "slip_overshoot": {"v_c": "%/s"},
    "span_error": {"gain": ""},
    "stem_creep": {"creep": "%/s"},
    "supply_sag": {"sag": "%", "recovery": "s"},
    "travel_stop": {"stop_low": "%", "stop_high": "%"},
    "underdamped_positioner": {"wn": "rad/s", "zeta": ""},
    "viscous_drag": {"tau_v": "s"},
    "zero_shift": {"zero": "%"},
}
# slug, coordinates too small for a work order, coordinates that are worth one
MATTERS = [
    ("actuator_lag", [0.3], [1.5]),
    ("asymmetric_lag", [2.0, 2.5], [0.5, 2.5]),
    ("asymmetric_rate_limit", [1 / 14.0, 1 / 12.0], [1 / 14.0, 1 / 2.8]),
    ("asymmetric_rate_limit", [1 / 2.8, 1 / 3.0], [1 / 2.8, 0.0]),
    ("asymmetric_slip", [0.1], [-0.35]),
    ("bowed_linkage", [0.2], [-0.8]),
    ("spring_hysteresis", [0.4, 6.0], [0.7, 6.0]),
    ("dead_time", [0.5], [1.0]),
    ("dwell_dependent_breakaway", [0.05], [0.15]),
    ("flow_force", [1.0], [-2.5]),
    ("growing_stiction", [0.1], [0.4]),
    ("load_by_position", [0.6, 0.0, 0.0], [2.0, 0.0, -3.0]),
    ("lost_motion", [0.1], [0.6]),
    ("low_speed_restick", [0.1], [0.3]),
    ("motor_drive", [20.0, 0.1, 0.0], [20.0, 3.0, 0.0]),
    ("position_dependent_friction", [0.2, 50.0, 5.0], [1.0, 50.0, 5.0]),
    ("presliding", [0.003], [0.02]),
    ("rate_limit", [1 / 20.0], [1 / 1.5]),
    ("sensor_drift", [0.3, 0.0, 0.0, 0.0], [-0.7, 0.0, 0.0, 0.0]),
    ("slip_overshoot", [1.0], [4.0]),
    ("span_error", [0.01], [-0.03]),
    ("stem_creep", [0.002], [-0.01]),
    ("supply_sag", [0.01, 30.0], [-0.2, 30.0]),
    ("travel_stop", [25.0, 0.0], [36.0, 0.0]),
    ("travel_stop", [0.0, 25.0], [0.0, 36.0]),
    ("underdamped_positioner", [0.5, 0.8], [0.5, 0.4]),
    ("viscous_drag", [0.3], [1.5]),
    ("zero_shift", [0.2], [-0.5]),
]


# slug, coordinates of how such a machine is made; all other material sizes are defects
AS_BUILT = [
    ("actuator_lag", [1.5]),
    ("asymmetric_lag", [0.3, 1.5]),
    ("asymmetric_rate_limit", [1 / 15.0, 1 / 2.8]),
    ("bowed_linkage", [1.9]),
    ("dead_time", [2.1]),
    ("flow_force", [1.9]),
    ("load_by_position", [20.0, 0.0, -3.0]),
    ("low_speed_restick", [0.9]),
    ("motor_drive", [20.0, 3.0, 0.0]),
    ("presliding", [0.02]),
    ("rate_limit", [1 / 3.2]),
    ("sensor_drift", [0.2, 1.5, 0.0, 0.0]),
    ("slip_overshoot", [4.0]),
    ("span_error", [-0.039]),
    ("viscous_drag", [1.5]),
    ("zero_shift", [1.9]),
]
DEFECTS = [
    ("actuator_lag", [1.7]),
    ("asymmetric_lag", [0.3, 1.7]),
    ("asymmetric_rate_limit", [0.0, 1 / 1.5]),
    ("bowed_linkage", [-2.1]),
    ("spring_hysteresis", [1.0, 8.0]),
    ("dead_time", [2.3]),
    ("flow_force", [-2.1]),
    ("low_speed_restick", [1.1]),
    ("rate_limit", [1 / 1.5]),
    ("span_error", [-0.041]),
    ("viscous_drag", [1.7]),
    ("zero_shift", [-2.1]),
]


def said(slug: str, values: list[float], spread: float = 0.05) -> str:
    """The sentence of a term whose coordinates are ``values``, with intervals."""
    term = CATALOGUE[slug]
    estimates = {}
    for name, (value, unit) in term.parameters(np.array(values)).items():
        half = spread * abs(value)
        estimates[name] = Estimate(value=value, low=value - half, high=value + half, unit=unit)
    return term.sentence(estimates, "opening", "closing")


def test_the_catalogue_holds_all_physics_of_the_valve():
    """Valves and drives, and the file is named as the effect."""
    assert set(CATALOGUE) == set(PARAMETERS)
    assert all(term.slug == slug for slug, term in CATALOGUE.items())


def test_the_terms_of_the_command_stand_in_the_order_of_the_chain():
    """Dead time, lag, positioner, speed limit, air supply."""
    order = {slug: term.order for slug, term in CATALOGUE.items() if term.acts_on is ActsOn.COMMAND}
    assert order == {
        "dead_time": 10,
        "actuator_lag": 20,
        "asymmetric_lag": 20,
        "underdamped_positioner": 25,
        "rate_limit": 30,
        "asymmetric_rate_limit": 30,
        "supply_sag": 40,
    }


def test_zero_gain_and_re_sticking_are_the_base_s_own_numbers():
    """They are free in every hypothesis."""
    of_base = {slug for slug, term in CATALOGUE.items() if term.in_base}
    assert of_base == {"zero_shift", "span_error", "low_speed_restick", "slip_overshoot"}


def test_the_reading_has_a_zero_and_a_gain():
    """Sticking again is the stem's."""
    reading = {slug for slug, term in CATALOGUE.items() if term.acts_on is ActsOn.READING}
    assert reading == {"zero_shift", "span_error"}


def test_terms_that_do_the_same_name_each_other():
    """A force that depends on position, and a reading that is bent: only their shapes differ."""
    alike = {slug: term.alike for slug, term in CATALOGUE.items() if term.alike}
    assert alike == {"flow_force": ("bowed_linkage",), "bowed_linkage": ("flow_force",)}


def test_a_richer_term_names_the_simpler_ones_that_it_contains():
    """Parsimony prefers these."""
    assert {slug: term.contains for slug, term in CATALOGUE.items() if term.contains} == {
        "asymmetric_lag": ("actuator_lag",),
        "asymmetric_rate_limit": ("rate_limit",),
        "asymmetric_slip": ("zero_shift",),
        "load_by_position": ("flow_force", "span_error"),
        "motor_drive": (
            "viscous_drag",
            "actuator_lag",
            "asymmetric_lag",
            "dead_time",
            "rate_limit",
            "underdamped_positioner",
        ),
        "span_error": ("zero_shift",),
        "underdamped_positioner": ("actuator_lag",),
    }


@everywhere
@pytest.mark.parametrize("name", LOOKS)
def test_starts_are_few_and_lie_within_the_ranges(slug, name):
    """Whatever the sampling and the swing."""
    term, summary = CATALOGUE[slug], LOOKS[name]
    limits = term.coordinates(summary)
    starts = term.starts(summary)
    assert starts.shape[1] == len(limits)
    assert 3 <= starts.shape[0] <= 16
    assert np.unique(starts, axis=0).shape[0] >= 2
    assert np.all(starts >= [c.low - 1e-12 for c in limits])
    assert np.all(starts <= [c.high + 1e-12 for c in limits])
    assert all(c.low < c.high for c in limits)


@everywhere
def test_some_starts_are_material_and_neutral_coordinates_are_not(slug):
    """A search that starts at immaterial sizes only would end there."""
    term = CATALOGUE[slug]
    assert any(term.material(start, LOOK) for start in term.starts(LOOK))
    assert not term.material(np.zeros(len(term.coordinates(LOOK))), LOOK)


@pytest.mark.parametrize(("slug", "small", "large"), MATTERS)
def test_material_sizes_are_separated_from_immaterial_ones(slug, small, large):
    """The sizes hidden in the simulator are material; those of a good valve are not."""
    term = CATALOGUE[slug]
    assert not term.material(np.array(small), LOOK)
    assert term.material(np.array(large), LOOK)


def test_an_effect_that_a_recording_cannot_show_is_immaterial_there():
    """A limit over a small swing, a gain over a small travel, a lag within a sample."""
    quiet, slow = LOOKS["quiet"], LOOKS["slow"]
    assert not CATALOGUE["rate_limit"].material(np.array([1 / 8.0]), quiet)
    assert not CATALOGUE["span_error"].material(np.array([0.05]), quiet)
    assert not CATALOGUE["flow_force"].material(np.array([5.0]), quiet)
    for slug in ("actuator_lag", "viscous_drag", "dead_time"):
        assert not CATALOGUE[slug].material(np.array([20.0]), slow)


@everywhere
def test_the_names_and_units_of_parameters_are_a_contract(slug):
    """They stand in the JSON."""
    term = CATALOGUE[slug]
    for start in term.starts(LOOK):
        result = term.parameters(start)
        assert {name: unit for name, (_, unit) in result.items()} == PARAMETERS[slug]
        assert all(np.isfinite(value) for value, _ in result.values())


@everywhere
def test_a_sentence_is_one_sentence_with_a_number_and_its_interval(slug):
    """For a maintenance engineer: no slug, no placeholder, no missing number."""
    term = CATALOGUE[slug]
    for start in term.starts(LOOK):
        text = said(slug, list(start))
        assert text.endswith(".")
        assert text[0].isupper()
        assert ". " not in text
        assert re.search(r"\d \(-?[\d.]+ to -?[\d.]+\)", text)
        assert "_" not in text
        assert "nan" not in text
        assert "inf" not in text.replace("inform", "")


@everywhere
def test_a_sentence_is_built_without_known_parameters(slug):
    """An interval that cannot be given is said, and stops nothing."""
    parameters = {name: Estimate.unknown("too few moves") for name in PARAMETERS[slug]}
    assert "not known: too few moves" in CATALOGUE[slug].sentence(parameters, "rising", "falling")


@everywhere
def test_advice_names_things_to_look_at_and_a_test(slug):
    """Plain words fit into a sentence; check and decide are whole ones."""
    words = CATALOGUE[slug].words
    assert words.plain[0].islower()
    assert not words.plain.endswith(".")
    for text in (words.check, words.decide):
        assert text[0].isupper()
        assert text.endswith(".")
        assert 80 <= len(text) <= 400
    assert "_" not in words.plain + words.check + words.decide


@pytest.mark.parametrize(
    ("slug", "values", "words"),
    [
        ("actuator_lag", [3.1], "a lag of 3.10 (2.95 to 3.25) s both ways"),
        ("asymmetric_lag", [4.0, 1.0], "by 4.00 (3.80 to 4.20) s when opening but by only 1"),
        ("asymmetric_lag", [1.0, 4.0], "by 4.00 (3.80 to 4.20) s when closing but by only 1"),
        ("asymmetric_lag", [0.0, 4.0], "when closing but follows at once when opening"),
        ("asymmetric_rate_limit", [0.0, 1 / 3], "3.00 (2.85 to 3.15) %/s when closing but is free"),
        ("asymmetric_rate_limit", [1 / 3, 1 / 12], "when opening but reaches 12.0 (11.4 to 12.6)"),
        ("asymmetric_slip", [0.5], "jumps when opening are 3.00 (2.85 to 3.15) times those"),
        ("asymmetric_slip", [-0.5], "jumps when closing are 3.00 (2.86 to 3.16) times those"),
        ("bowed_linkage", [1.0], "1.00 (0.95 to 1.05) % of span too high at 79 % of travel and"),
        ("bowed_linkage", [-1.0], "% of span too high at 21 % of travel and too low at 79 %"),
        ("spring_hysteresis", [1.0, 8.0], "by up to 1.00 (0.95 to 1.05) % of span either way"),
        ("flow_force", [-3.0], "by 3.00 (2.85 to 3.15) % of span more towards opening"),
        ("growing_stiction", [0.8], "grew by 80.0 (76.0 to 84.0) % over the record"),
        ("growing_stiction", [-0.3], "shrank by 30.0 (28.5 to 31.5) % over"),
        ("load_by_position", [4.0, 0.0, 0.0], "by 4.00 (3.80 to 4.20) % of span more towards clos"),
        (
            "motor_drive",
            [9.0, 3.0, 0.0],
            "9.00 (8.55 to 9.45) s and runs up in 3.00 (2.85 to 3.15)",
        ),
        ("position_dependent_friction", [1.5, 50.0, 5.0], "Between 45 and 55 % of travel"),
        ("presliding", [0.02], "follows OP by 0.02"),
        ("rate_limit", [0.5], "no more than 2.00 (1.90 to 2.10) %/s, opening and closing alike"),
        ("sensor_drift", [-1.5, 0.0, 0.0, 0.0], "drifts downwards by 1.50 (1.43 to 1.57) %"),
        ("span_error", [-0.1], "compressed over the stroke: it moves by 0.900 (0.855 to 0.945)"),
        ("stem_creep", [-0.02], "creeps at 0.02 (0.019 to 0.021) %/s, closing,"),
        ("supply_sag", [-0.2, 30.0], "short by 20.0 (19.0 to 21.0) % of the move when closing"),
        ("travel_stop", [0.0, 39.0], "does not rise above 61"),
        ("travel_stop", [38.0, 0.0], "does not fall below 38"),
        ("underdamped_positioner", [0.5, 0.2], "period of 12.8 s and an overshoot of 53 %"),
        ("zero_shift", [-1.0], "reads low by 1.00 (0.95 to 1.05) % of travel"),
    ],
)
def test_numbers_are_said_with_their_direction(slug, values, words):
    """Signs are given in words."""
    assert words in said(slug, values)


def test_an_effect_whose_direction_is_in_doubt_is_said_without_a_negative_size():
    """An interval across zero begins at zero."""
    estimate = Estimate(value=-0.4, low=-1.0, high=0.2, unit="%")
    text = CATALOGUE["sensor_drift"].sentence(
        {"D": estimate, "range": estimate}, "rising", "falling"
    )
    assert "by 0.40 (0.00 to 1.00) %" in text
    ratio = Estimate(value=0.5, low=-0.2, high=0.9)
    text = CATALOGUE["asymmetric_slip"].sentence({"ratio": ratio}, "rising", "falling")
    assert "jumps when falling are 2 times those when rising" in text


def test_one_travel_stop_is_mentioned_alone():
    """The other end of the stroke is not a finding."""
    assert "rise above" not in said("travel_stop", [38.0, 0.0])
    assert "fall below" not in said("travel_stop", [0.0, 39.0])
    assert " and does not rise above 61" in said("travel_stop", [38.0, 39.0])


# A number with a unit of time, as sentences have it, and its seconds.
_SAID = re.compile(r"([\d.e+-]+)(?: \(([\d.e+-]+) to ([\d.e+-]+)\))? (%/)?(ms|rad/s|s|min|h|d)\b")
_SECONDS = {"ms": 1e-3, "s": 1.0, "rad/s": 1.0, "min": 60.0, "h": 3600.0, "d": 86400.0}


def times_said(sentence: str) -> list[float]:
    """Times in seconds, speeds and frequencies by the second, in the order in which they stand."""
    result = []
    for value, low, high, speed, unit in _SAID.findall(sentence):
        factor = 1.0 / _SECONDS[unit] if speed else _SECONDS[unit]
        result += [factor * float(item) for item in (value, low, high) if item]
    return result


@pytest.mark.parametrize("unit_s", [0.001, 0.01, 5.0, 60.0])
@everywhere
def test_parameters_and_sentences_are_in_true_time_units(slug, unit_s):
    """Every time and speed scales with the recording's own unit, whichever unit it is said in."""
    term = CATALOGUE[slug]
    for values in term.starts(LOOK):
        own = {
            name: Estimate(value=value, low=0.9 * value, high=1.1 * value, unit=unit)
            if value >= 0.0
            else Estimate(value=value, low=1.1 * value, high=0.9 * value, unit=unit)
            for name, (value, unit) in term.parameters(values).items()
        }
        for item in own.values():
            power = {"s": 1, "%/s": -1, "rad/s": -1}.get(item.unit, 0)
            assert estimate_in_seconds(item, unit_s).value == pytest.approx(
                item.value * unit_s**power
            )
        plain, other = (
            term.sentence(
                {name: SpokenEstimate.of(item, unit) for name, item in own.items()}, "up", "down"
            )
            for unit in (1.0, unit_s)
        )
        faster = [unit in plain for unit in ("%/s", "rad/s")]
        text = times_said(plain), times_said(other)
        assert len(text[0]) == len(text[1])
        if not any(faster):
            assert text[1] == pytest.approx([unit_s * item for item in text[0]], rel=0.02)
        elif faster[0]:
            assert text[1] == pytest.approx([item / unit_s for item in text[0]], rel=0.02)


@everywhere
def test_each_effect_has_a_test_in_the_field_with_numbers(slug):
    """What to do, and what to expect where the finding is right and where there is nothing to mend;
    the larger the effect, the larger the number that is expected."""
    term = CATALOGUE[slug]
    values = term.starts(LOOK)[-1]
    numbers = {}
    for name, (value, unit) in term.parameters(values).items():
        low, high = sorted((0.9 * value, 1.1 * value))
        numbers[name] = Estimate(value=value, low=low, high=high, unit=unit)
    test = term.field_test(numbers)
    assert re.search(r"[A-Z].*\.$", test.do)
    assert re.search(r"\d", test.do + test.fails)
    assert test.fails != test.passes
    for words in (test.fails, test.passes):
        assert words
        assert not words.endswith(".")
        assert "nan" not in words


def test_the_expected_time_of_a_speed_limit_is_that_of_the_step():
    """At 2.0 %/s a step of 20 % takes 10 s; large actuators are built to take eight."""
    rate = Estimate(value=2.0, low=1.9, high=2.1, unit="%/s")
    test = CATALOGUE["rate_limit"].field_test({"rate": rate})
    assert "step OP by 20 %" in test.do
    assert test.fails.startswith("about 10 s (9.5 to 11)")
    assert test.passes == "within 8 s"


@everywhere
def test_inherent_sizes_are_separated_from_defects(slug: str):
    """A motor's lag, a load, a valve as slow as large ones are allowed to be, and a reading that is
    off, or a plug that flow pushes, by less than a stroke check finds fault with; nothing else."""
    term = CATALOGUE[slug]
    for name, values in AS_BUILT:
        assert name != slug or term.inherent(np.array(values), LOOK)
    worth_work = [(name, large) for name, _, large in MATTERS if name not in dict(AS_BUILT)]
    for name, values in (*worth_work, *DEFECTS):
        assert name != slug or not term.inherent(np.array(values), LOOK)


@pytest.mark.parametrize(
    ("slug", "values"),
    [
        ("actuator_lag", [4.0]),
        ("asymmetric_lag", [4.0, 0.0]),
        ("asymmetric_rate_limit", [0.0, 4.0]),
        ("dead_time", [4.0]),
        ("rate_limit", [4.0]),
        ("viscous_drag", [4.0]),
    ],
)
def test_how_machines_are_built_is_counted_in_true_seconds(slug: str, values: list[float]):
    """Four samples are 0.4 s for a stem sampled ten times a second, and four minutes for one that
    is stored every minute. At one sample a second they are a defect."""
    term, size = CATALOGUE[slug], np.array(values)
    assert not term.inherent(size, LOOK)
    assert term.inherent(size, replace(LOOK, unit_s=0.1))
    assert not term.inherent(size, replace(LOOK, unit_s=60.0))
    within = size / size.max() * 0.3
    assert term.inherent(within, LOOK)
    if slug != "dead_time":  # the clocks of two tags may differ by a sample
        assert not term.inherent(within, replace(LOOK, unit_s=60.0))


@pytest.mark.parametrize(
    ("slug", "usual"),
    [("actuator_lag", 15.0), ("asymmetric_lag", 15.0), ("dead_time", 12.0), ("viscous_drag", 15.0)],
)
def test_delays_of_some_seconds_are_looked_for_where_samples_are_quick(slug: str, usual: float):
    """Eleven seconds are 22 samples at two a second; at a hundred a second no search reaches that
    far, and the usual number of samples holds."""
    term = CATALOGUE[slug]
    for unit_s, longest in ((1.0, usual), (0.5, 2.0 * usual), (0.01, usual), (5.0, usual)):
        summary = replace(LOOK, unit_s=unit_s)
        assert {one.high for one in term.coordinates(summary)} == {longest}
        longest_start = term.starts(summary).max()
        assert longest_start < longest
        assert unit_s != 0.5 or longest_start > 0.6 * longest


@pytest.mark.parametrize(("gain", "perhaps"), [(0.9, True), (0.96, False), (1.1, False)])
def test_a_span_of_90_percent_may_be_degrees(gain, perhaps):
    """A quarter turn in degrees reads 90 at 100 %: the unit comes before a calibration."""
    gains = {"gain": Estimate(value=gain, low=gain - 0.05, high=gain + 0.05, unit="")}
    text = CATALOGUE["span_error"].sentence(gains, "rising", "falling")
    assert ("degrees" in text) is perhaps
