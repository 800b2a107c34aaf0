"""The curve from OP to stroke: found where there is one, so that S and J are the valve's own."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given as for_all
from hypothesis import strategies as st

from stemwatch.models.estimate import Estimate
from stemwatch.models.mismatch.explain import explain
from stemwatch.models.mismatch.findings import Mismatch
from stemwatch.models.mismatch.refined_curve import refined
from stemwatch.models.recording import Recording, Role, Signal
from stemwatch.models.screening.prepared_command import prepare_command
from stemwatch.models.screening.screen import Case, Options, screen
from stemwatch.models.screening_result import Screening
from stemwatch.models.stickslip.curve_signs import curve_suspected, slope_of_means
from stemwatch.models.stickslip.find_stroke_curve import find_stroke_curve, stroke_curve_of
from stemwatch.models.stickslip.fit import fit_stickslip
from stemwatch.models.stickslip.stroke_curve import (
    KnownCurve,
    StrokeCurve,
    curve_of_points,
    in_travel,
    points_of,
)
from stemwatch.models.studies.simulator import Actuator, PlantLoop, SimulatedValve, simulate_loop
from stemwatch.models.studies.simulator.defects import PackingDefects
from stemwatch.models.studies.simulator.draws import draw_healthy, draw_sticky
from stemwatch.models.studies.simulator.hidden import draw_nulls
from stemwatch.models.studies.simulator.loop import Load, LoadKind
from stemwatch.models.verdict import Verdict
from stemwatch.service.studies.robustness import draw_valves, recorded

QUICK = Options(narx=False)
MOVES = ((10.0, 38.0), (300.0, 60.0), (600.0, 45.0), (900.0, 66.0), (1200.0, 40.0), (1500.0, 55.0))
STICKING, HEALTHY = (5.0, 1.5), (0.4, 0.1)


@cache
def plain(S: float, J: float) -> Recording:
    """Half an hour of a flow loop whose set point moves the valve over a third of its stroke."""
    loop = PlantLoop(
        valve=SimulatedValve(S=S, J=J, actuator=Actuator(air_lag_s=0.2)),
        setpoints=MOVES,
        loads=(Load(kind=LoadKind.COLOURED, size=1.0, time_s=20.0),),
        duration_s=1800.0,
    )
    return simulate_loop(loop, 3).recording


def changed(recording: Recording, *, op=lambda v: v, mv=lambda v: v) -> Recording:
    """The same valve as another plant would have stored it."""
    signals = dict(recording.signals)
    for role, change in ((Role.OP, op), (Role.MV, mv)):
        signals[role] = replace(signals[role], values=change(signals[role].values))
    return replace(recording, signals=signals)


def equal_percentage(travel):
    """OP of a positioner that turns OP into an equal percentage of 1:40."""
    return 100.0 * np.log1p(np.clip(travel, 0.0, 100.0) / 100.0 * 39.0) / np.log(40.0)


def stuck(command, S: float, J: float):
    """Position of a stem that lets go (S + J)/2 from its command and stays (S - J)/2 behind it."""
    place, mv = command[0], np.empty(command.size)
    for k, expected in enumerate(command):
        if abs(expected - place) > 0.5 * (S + J):
            place = expected - np.sign(expected - place) * 0.5 * (S - J)
        mv[k] = place
    return mv


WAYS = {
    "upper half of a split range": {"op": lambda v: 50.0 + v / 2.0},
    "lower half of a split range": {"op": lambda v: v / 2.0},
    "twice the travel about the middle": {"op": lambda v: 50.0 + (v - 50.0) / 2.0},
    "equal percentage": {"op": equal_percentage},
    "quick opening": {"op": lambda v: np.clip(v, 0.0, 100.0) ** 2 / 100.0},
    "counting the other way": {"mv": lambda v: 100.0 - v},
    "other way on half of OP": {"op": lambda v: 100.0 - v / 2.0},
}


SHORT = ("equal percentage", "counting the other way")
ways = pytest.mark.parametrize(
    "way", [way if way in SHORT else pytest.param(way, marks=pytest.mark.long) for way in WAYS]
)


@cache
def stored(way: str, S: float, J: float) -> Recording:
    return changed(plain(S, J), **WAYS[way])


@cache
def curve_of(way: str, S: float, J: float) -> StrokeCurve:
    curve = find_stroke_curve(stored(way, S, J))
    assert curve is not None
    return curve


@cache
def screened_on_half_of_op() -> Screening:
    """What is said of the sticking valve whose OP is the upper half of a split range."""
    (result,) = screen([Case(recording=stored("upper half of a split range", *STICKING))], QUICK)
    return result


@cache
def plainly_explained(valve: tuple[float, float]) -> Mismatch:
    return explain(plain(*valve))


def named(mismatch: Mismatch) -> set[str]:
    return {effect.slug for effect in mismatch.effects}


def named_besides(mismatch: Mismatch, plain: Mismatch) -> set[str]:
    """What is named of a recording and cannot be what was named of the ``plain`` one: none of those
    it is not told from was."""
    return {effect.slug for effect in mismatch.effects if not {*effect.members} & named(plain)}


@ways
@pytest.mark.parametrize("valve", [STICKING, HEALTHY], ids=["sticking", "healthy"])
def test_the_command_behind_op_is_found(way, valve):
    """In percent of travel, OP becomes what it was before it was changed.

    Except for a shift by a part of the stick band, which each fit can compensate.
    """
    recording = stored(way, *valve)
    truth = plain(*valve).op.values
    if way == "counting the other way":
        truth = 100.0 - truth
    off = curve_of(way, *valve).command(recording.op.values) - truth
    assert off.std() < 0.5
    assert abs(off.mean()) < 1.0


def test_half_of_op_is_found_about_the_middle_of_its_range():
    """There the position is nowhere far from OP, and wide sticking lets them go together less."""
    rng = np.random.default_rng(4)
    clock = np.arange(3600.0)
    slow = np.interp(clock, np.linspace(0.0, 3600.0, 13), 5.0 * rng.standard_normal(13))
    travel = 50.0 + slow + 5.5 * np.sin(2.0 * np.pi * clock / 70.0)
    mv = stuck(travel, S=7.0, J=2.0)
    signals = {Role.OP: Signal.good(travel, "OP"), Role.MV: Signal.good(mv, "MV")}
    plain_op = Recording(valve="V", signals=signals, interval_s=1.0)
    half = changed(plain_op, op=lambda v: 25.0 + v / 2.0)
    assert slope_of_means(half) is None
    assert curve_suspected(half)
    assert not curve_suspected(plain_op)


def with_bristles(place: int) -> Recording:
    """An hour of a sticking valve of the plant whose packing gives before it lets go."""
    case = draw_nulls(place + 1, 2109, "routine")[place]
    packing = PackingDefects(presliding_percent=0.002)
    loop = replace(case.loop, valve=replace(case.loop.valve, packing=packing))
    return simulate_loop(loop, case.seed).recording


def used_slopes(curve: StrokeCurve, travel_of) -> tuple[float, float]:
    """The slope over the part of OP that was used: that of the curve and the true one."""
    begin, _, end, _ = curve.ends
    low, high = travel_of(np.array([begin, end])).tolist()
    return curve.slope, (high - low) / (end - begin)


@pytest.mark.long
def test_the_slips_tell_a_bend_where_free_runs_miss_too_many_of_them():
    """Through a straight line, which the free runs leave possible, S of this valve was 8.7 % and
    its slope a fifth too steep; read through the bend its breakaways agree much better."""
    curve = find_stroke_curve(changed(with_bristles(18), op=equal_percentage))
    assert curve is not None
    assert curve.bend_percent > 4.0
    found, true = used_slopes(curve, lambda op: 100.0 * np.expm1(op / 100.0 * np.log(40.0)) / 39.0)
    assert found == pytest.approx(true, rel=0.08)


@pytest.mark.long
def test_a_bent_curve_is_not_taken_for_a_late_clock():
    """Read as a straight line this OP seemed 3.8 s late, and once that was taken away, behind the
    curve, the stem 3.8 s: a dead time. An OP that is 5 s late behind a curve still is."""
    stored = changed(with_bristles(8), op=lambda v: 10.0 * np.sqrt(v.clip(0.0)))
    assert prepare_command(stored, None).late_s == 0.0
    late = changed(stored, op=lambda v: np.concatenate((np.full(5, v[0]), v[:-5])))
    assert prepare_command(late, None).late_s == pytest.approx(5.0, abs=0.5)


@pytest.mark.long
def test_a_correction_does_not_bend_the_curve_away_where_the_stem_hardly_moves():
    """OP was seldom below 50 % here. There the last correction had turned the curve upwards."""
    curve = find_stroke_curve(changed(with_bristles(41), op=lambda v: 10.0 * np.sqrt(v.clip(0.0))))
    assert curve is not None
    found, true = used_slopes(curve, lambda op: op**2 / 100.0)
    assert found == pytest.approx(true, rel=0.08)


@pytest.mark.long
def test_near_the_foot_of_a_square_root_a_healthy_valve_does_not_seem_to_stick():
    """No polynomial of OP is as steep as it begins: read through a straight line instead, this
    stem of S 0.4 % had an S of 7 and a J of 9 % of travel, and was called sticky."""
    healthy = [valve for valve in draw_valves(5, 6161) if not valve.sticking][2]
    plain = recorded(healthy)
    lower = 28.0 - float(np.median(plain.op.values))
    stored = changed(
        plain,
        op=lambda op: np.clip(op + lower, 0.0, 100.0) ** 2 / 100.0,
        mv=lambda mv: mv + lower,
    )
    curve = find_stroke_curve(stored)
    assert curve is not None
    fit = fit_stickslip(in_travel(stored, curve), curve.unsure_degree)
    assert fit.S < 1.0
    assert curve.bend_percent > 8.0
    for op, travel, off in ((4.0, 20.0, 2.5), (9.0, 30.0, 0.7), (16.0, 40.0, 0.7)):
        assert float(curve.command(np.array([op]))[0]) == pytest.approx(travel, abs=off)


def test_the_curve_extends_over_the_peaks_of_op():
    """Beyond the bulk of OP the curve goes on: peaks of OP decide when a stem lets go."""
    truth = plain(*STICKING).op.values.copy()
    truth[900:903] += 6.0
    recording = changed(plain(*STICKING), op=lambda v: equal_percentage(truth))
    curve = find_stroke_curve(recording)
    off = curve.command(recording.op.values) - truth
    assert np.abs(off - np.median(off))[895:910].max() < 1.0


def test_the_slope_is_that_over_the_part_of_op_that_was_used():
    """A curve over all of OP is steep here and flat there; S is meant where OP was."""
    curve = StrokeCurve(op=(0.0, 50.0, 100.0), travel=(0.0, 20.0, 100.0), used=(60.0, 80.0))
    assert curve.slope == pytest.approx(1.6)
    assert curve.zero == pytest.approx(-60.0)
    assert curve.bend_percent == pytest.approx(0.0)
    assert "OP 60 to 80 % brings the position from 36 to 68 %" in curve.sentence()
    still = replace(curve, op=(0.0, 90.0, 100.0), travel=(0.0, 0.0, 100.0))
    assert still.slope == pytest.approx(1.0)  # where it does not move, the whole curve speaks


@ways
def test_the_sticking_is_that_of_the_plain_recording(way):
    """S and J in percent of travel are the same however OP was stored."""
    naive = fit_stickslip(plain(*STICKING))
    fit = fit_stickslip(in_travel(stored(way, *STICKING), curve_of(way, *STICKING)))
    assert fit.S == pytest.approx(naive.S, abs=0.35)
    assert fit.J == pytest.approx(naive.J, abs=0.4)


@pytest.mark.long
@ways
def test_verdicts_survive_how_op_was_stored(way):
    """A healthy valve stays healthy, a sticking one sticks, and no more is named than before."""
    healthy, sticking = screen(
        [Case(recording=stored(way, *valve)) for valve in (HEALTHY, STICKING)], QUICK
    )
    assert healthy.verdict is Verdict.HEALTHY
    assert sticking.verdict is Verdict.STICKY
    assert named_besides(healthy.mismatch, plainly_explained(HEALTHY)) == set()
    assert named_besides(sticking.mismatch, plainly_explained(STICKING)) == set()


def test_S_and_J_are_in_percent_of_op():
    """On half of OP the same sticking is half as wide in OP, and the interval holds it."""
    result = screened_on_half_of_op()
    assert result.S.low <= 2.5 <= result.S.high
    assert result.J.low <= 0.75 <= result.J.high
    assert result.S.high - result.S.low < 1.0


def test_a_reversed_position_is_said_to_be_read_the_other_way_round():
    """One that rises with OP has no such sentence."""
    assert "read the other way round" in curve_of("counting the other way", *STICKING).sentence()
    assert "the other way round" not in curve_of("equal percentage", *STICKING).sentence()


def test_a_split_range_is_said_in_one_sentence():
    """The curve is told where the recording's decisions are, with what strokes the valve."""
    result = screened_on_half_of_op()
    (text,) = [s for s in result.provenance.decisions if "stroked" in s]
    assert "nearly linear: as if OP 50 to 100 % stroked 0 to 100 %" in text
    assert result.mismatch.sentence.startswith(text)
    assert result.mismatch.stroke_curve is not None


def test_a_position_that_is_in_millimetres_is_asked_for_its_unit():
    """No OP of 262 % strokes a valve; one that begins elsewhere is no other unit."""
    values = np.array([20.0, 70.0])
    in_mm = StrokeCurve(op=tuple(values), travel=tuple(0.381 * values))
    assert "so to 38 at 100 %" in in_mm.sentence()
    assert "degrees or mm" in in_mm.sentence()
    from_20 = StrokeCurve(op=tuple(values), travel=tuple(20.0 + 0.381 * values))
    assert "as if OP" in from_20.sentence()


def test_a_bend_is_said_with_its_size():
    """An equal percentage is no straight line, and the sentence says how far it is off one."""
    text = curve_of("equal percentage", *STICKING).sentence()
    assert "bent by up to" in text
    assert "as if" not in text


@pytest.mark.parametrize(
    ("healthy", "sticking"), [(6, 4), pytest.param(18, 12, marks=pytest.mark.long)]
)
def test_no_curve_is_looked_for_where_op_is_percent_of_travel(healthy, sticking):
    """Healthy and sticking valves of all kinds, stored as they are, keep the plain reading."""
    loops = [*draw_healthy(healthy, 90), *draw_sticky(sticking, 90)]
    suspects = [
        loop.tag
        for index, loop in enumerate(loops)
        if curve_suspected(simulate_loop(replace(loop, duration_s=1800.0), index).recording)
    ]
    assert suspects == []


def test_zero_and_span_of_a_transmitter_are_no_curve():
    """A shift of 2 % and a span error of 10 % stay what they are: findings of their own."""
    shifted = changed(plain(*STICKING), mv=lambda v: 1.1 * (v - 50.0) + 52.0)
    assert find_stroke_curve(shifted) is None


def test_explain_finds_the_curve_by_itself():
    """Asked without a screening, it reads the command through the same curve."""
    recording = stored("equal percentage", *STICKING)
    found = curve_of("equal percentage", *STICKING)
    assert explain(recording).stroke_curve == refined(recording, found)


def test_explain_refuses_zero_and_span_where_a_curve_holds_them():
    """Zero and span are part of the fitted curve and cannot be findings; the reason says so."""
    explanation = explain(stored("upper half of a split range", *STICKING))
    refused = {item.slug: item.reason for item in explanation.not_testable}
    assert "curve from OP to stroke" in refused["zero_shift"]
    assert "curve from OP to stroke" in refused["span_error"]


def test_a_position_against_op_that_no_curve_follows_is_refused():
    """Noise with a negative correlation to the command is not a reversed valve."""
    rng = np.random.default_rng(5)
    recording = plain(*STICKING)
    op = recording.op.values
    noise = np.convolve(rng.standard_normal(op.size + 300), np.ones(301) / 301, "valid")
    mixed = 50.0 - 0.5 * (op - op.mean()) + 200.0 * noise
    position = Signal.good(np.clip(mixed, 0.0, 100.0), "OTHER.ZT")
    signals = {**recording.signals, Role.MV: position}
    (result,) = screen([Case(recording=replace(recording, signals=signals))], QUICK)
    assert result.verdict is Verdict.UNDETERMINED


def test_means_give_the_slope_only_where_op_was_in_several_places():
    """A loop that cycles in one place does not show how far OP strokes the valve."""
    time = np.arange(1800.0)
    cycle = 50.0 + 3.0 * np.sin(time / 20.0)
    signals = {Role.OP: Signal.good(cycle, "V.OP"), Role.MV: Signal.good(cycle, "V.ZT")}
    still = Recording(valve="V", signals=signals, interval_s=1.0)
    assert slope_of_means(still) is None
    split = slope_of_means(stored("upper half of a split range", *HEALTHY))
    assert split == pytest.approx(2.0, abs=0.05)


def test_where_the_slope_is_unknown_the_interval_of_J_is_wider():
    """S in percent of OP stands to a tenth; J may be half or twice as large."""
    curve = StrokeCurve(op=(70.0, 75.0), travel=(40.0, 50.0), slope_known=False)
    jump = Estimate(value=4.0, low=3.0, high=5.0, unit="%")
    stated = curve.in_op(jump)
    assert (stated.value, stated.low, stated.high) == pytest.approx((2.0, 1.5 / 1.1, 2.5 * 1.1))
    known = replace(curve, slope_known=True)
    assert known.in_op(jump) == Estimate(value=2.0, low=1.5, high=2.5, unit="%")
    assert curve.in_op(jump, is_jump=True) == Estimate(value=2.0, low=0.75, high=5.0, unit="%")
    assert "slope is not known" in curve.sentence()


def test_an_unknown_estimate_keeps_its_reason_through_the_curve():
    """What is not known in percent of travel is not known in percent of OP."""
    unknown = Estimate.unknown("it never moved", unit="%")
    assert StrokeCurve(op=(0.0, 50.0), travel=(0.0, 100.0)).in_op(unknown) is unknown


EQUAL = "equal percentage"


@cache
def of_window(way: str, known: KnownCurve | None) -> tuple[StrokeCurve | None, str]:
    return stroke_curve_of(stored(way, *STICKING), known)


def still(way: str) -> Recording:
    """A window in which OP hardly moves and the stem rests."""
    complete = stored(way, *STICKING)
    mean = float(np.mean(complete.op.values))
    return changed(
        complete, op=lambda v: mean + 0.2 * (v - mean), mv=lambda v: np.full(v.size, 55.0)
    )


def test_the_next_window_starts_from_the_curve_that_was_found_before():
    """The same valve once more: nearly the same curve, and nothing to remark."""
    before = curve_of(EQUAL, *STICKING)
    result, change = of_window(EQUAL, KnownCurve(before))
    assert change == ""
    assert result.remark == ""
    places = np.linspace(*before.used, 20)
    np.testing.assert_allclose(result.command(places), before.command(places), atol=1.0)


def test_a_window_that_moves_too_little_takes_the_earlier_curve_and_says_so():
    """Where the new window cannot tell a curve of its own."""
    before = curve_of(EQUAL, *STICKING)
    result, change = stroke_curve_of(still(EQUAL), KnownCurve(before))
    assert change == ""
    assert result.op == before.op
    assert "found before is used" in result.sentence()


def test_a_curve_that_changed_is_said_with_what_to_ask():
    """A valve that was moved from the lower to the upper half of a split range."""
    before = curve_of("lower half of a split range", *STICKING)
    result, change = of_window("upper half of a split range", KnownCurve(before))
    assert result.slope == pytest.approx(2.0, abs=0.1)
    assert "not the curve of the window before" in change
    assert change in result.sentence()


def test_a_plain_valve_that_becomes_a_split_range_is_said_and_back():
    """From percent for percent to a curve and back; both are changes that people made."""
    _, change = of_window("upper half of a split range", KnownCurve(None))
    assert "percent for percent of travel; now it is not" in change
    before = curve_of("upper half of a split range", *STICKING)
    result, change = stroke_curve_of(plain(*STICKING), KnownCurve(before))
    assert result is None
    assert "OP is percent for percent of travel now" in change


def test_a_plain_valve_stays_plain_whatever_is_known_to_be_plain():
    """The usual valve, week after week."""
    assert stroke_curve_of(plain(*STICKING), KnownCurve(None)) == (None, "")


def test_a_given_curve_is_used_instead_of_the_estimate():
    """As it stands in the plant file, over the part of OP that the recording used."""
    result = curve_of_points("50:0 100:100")
    answer, change = of_window("upper half of a split range", KnownCurve(result, given=True))
    assert change == ""
    assert (answer.op, answer.travel) == (result.op, result.travel)
    assert answer.slope == pytest.approx(2.0)
    assert "The plant file gives this curve." in answer.sentence()
    assert answer.proposal() == ""
    percent_for_percent = KnownCurve(curve_of_points("0:0 100:100"), given=True)
    assert of_window("upper half of a split range", percent_for_percent) == (None, "")


def test_a_given_curve_that_the_position_does_not_follow_is_said():
    """It is used all the same, because a person gave it."""
    result, change = of_window(
        "lower half of a split range", KnownCurve(curve_of_points("50:0 100:100"), given=True)
    )
    assert result.given
    assert "does not follow the curve" in change


def test_a_change_stands_in_the_reason_of_the_screening():
    """Whoever reads the verdict reads that the positioner was set otherwise."""
    known_curve = KnownCurve(curve_of("lower half of a split range", *STICKING))
    recording = stored("upper half of a split range", *STICKING)
    quick = replace(QUICK, mismatch=False)
    (result,) = screen([Case(recording=recording, known_curve=known_curve)], quick)
    assert result.verdict is Verdict.STICKY
    assert "not the curve of the window before" in result.reason
    assert result.stroke_curve.remark in result.reason


@ways
def test_a_proposed_curve_is_the_one_that_was_found(way):
    """What stands in the proposal, pasted into the plant file, reads the recording as well."""
    result = curve_of(way, *STICKING)
    (points,) = [part for part in result.proposal().split('"') if ":" in part]
    given = curve_of_points(points)
    places = np.linspace(*result.used, 50)
    np.testing.assert_allclose(given.command(places), result.command(places), atol=0.7)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("50:0", "1 points"),
        ("", "0 points"),
        ("0:0 half:50 100:100", "'half:50' is no point"),
        ("50:0 40:30 100:100", "OP 40 after OP 50"),
        ("0:0 50:60 70:40 100:100", "travel 40 after 60"),
        ("0:50 100:50", "does not move the valve"),
        ("0:0 1000:100", "1000, which is no percent"),
    ],
)
def test_points_that_are_no_curve_say_why(text, why):
    """The engineer who typed them mends them without asking."""
    with pytest.raises(ValueError, match=why):
        curve_of_points(text)


def test_a_curve_that_no_plant_file_may_give_is_not_proposed():
    """``inspect --write`` wrote one that ends at 151 % of travel, and no valve of the plant was
    screened."""
    curve = StrokeCurve(op=(0.0, 30.0, 78.0, 97.0), travel=(10.0, 53.0, 95.0, 151.0))
    assert curve.proposal() == ""
    assert "0:10" in StrokeCurve(op=(0.0, 30.0, 78.0), travel=(10.0, 53.0, 95.0)).proposal()


@for_all(
    st.lists(st.integers(-200, 1200), min_size=2, max_size=12, unique=True),
    st.lists(st.integers(0, 60), min_size=12, max_size=12),
    st.booleans(),
)
def test_points_are_read_as_they_were_written(places, steps, rises):
    """Text to curve and back to text, for every monotone curve."""
    travel = np.cumsum([0, *steps[1 : len(places)]]) / 10.0
    if travel[-1] < 0.6 or len(places) > 12:
        return
    travel = travel if rises else 100.0 - travel
    text = " ".join(
        f"{op / 10:g}:{at:g}" for op, at in zip(sorted(places), travel.round(1), strict=True)
    )
    curve = curve_of_points(text)
    if curve is None:
        return
    repeated = curve_of_points(points_of(curve))
    op = np.linspace(curve.op[0], curve.op[-1], 40)
    np.testing.assert_allclose(repeated.command(op), curve.command(op), atol=0.51)
