"""Response figures against a step test that is simulated here, sample by sample."""

from dataclasses import replace

import numpy as np
import pytest

from stemwatch.models.estimate import Estimate
from stemwatch.models.health_indicators.response_figures import (
    STEPS_PERCENT,
    StepNumbers,
    StepWay,
    response_figures,
    step_figures,
)
from stemwatch.models.mismatch.findings import (
    Effect,
    EffectEvidence,
    Finding,
    HeldOutFit,
    Mismatch,
    ResidualMap,
    Stiction,
)
from stemwatch.models.mismatch.open_question import OpenQuestion, RivalModel
from stemwatch.models.recording import Provenance
from stemwatch.models.screening.screen import failed
from stemwatch.models.screening_result import Indicator, RecordingFacts
from stemwatch.models.verdict import Verdict

FINE_S = 0.02


def percent(value, width=0.2):
    return Estimate(value=value, low=value - width, high=value + width, unit="%")


def judged(S, J, *, effects=(), question=None, indicators=()):
    """A screening with S and J, and a mismatch that named ``effects``."""
    stiction = Stiction(S=S, J=J)
    mismatch = Mismatch(
        finding=Finding.NAMED if effects else Finding.NONE,
        sentence="",
        naive=stiction,
        restated=stiction,
        effects=tuple(effects),
        record_effects=(),
        not_testable=(),
        heldout=HeldOutFit(),
        before=ResidualMap(),
        after=ResidualMap(),
        open_question=question,
    )
    return replace(
        failed("FV-1", "not yet.", "", Provenance(source="test")),
        verdict=Verdict.STICKY,
        S=S,
        J=J,
        mismatch=mismatch,
        indicators={indicator.name: indicator for indicator in indicators},
    )


def effect(slug, **parameters):
    return Effect(
        slug=slug,
        members=(slug,),
        sentence="",
        where="",
        check="",
        decide="",
        parameters=parameters,
        evidence=EffectEvidence(mean=0.1, t=5.0, share=0.5),
    )


def figures_by(figures, step, way, *, rising=True):
    (result,) = [
        item
        for item in figures.steps
        if (item.step_percent, item.way, item.rising) == (step, way, rising)
    ]
    return result


def step_test(S, J, theta, tau, rate, step, way):
    """Gain, Td and T86 of a step after a stroke upwards: Karnopp's two levels, by Euler's rule."""
    sticks, slides = (S + J) / 2, (S - J) / 2
    p, x, moving, d = 0.0, 0.0, False, 1.0
    rise = np.linspace(0.0, 20.0, int(20.0 / min(rate, 1.0) / FINE_S))
    sign = 1.0 if way is StepWay.SAME else -1.0
    after = np.full(int(40.0 / FINE_S), 20.0 + sign * step)
    op = np.concatenate((rise, np.full(after.size, 20.0), after))
    begins = rise.size + after.size
    positions = []
    for u in op:  # a delay in front of it moves everything by itself
        move = (u - p) * (1 - np.exp(-FINE_S / tau)) if tau > 0 else u - p
        move = float(np.clip(move, -rate * FINE_S, rate * FINE_S))
        p += move
        if moving and move * d <= 1e-7:
            moving = False
        if abs(p - x) > sticks + 1e-9:
            moving, d = True, float(np.sign(p - x))
        if moving:
            x = p - d * slides
        positions.append(x)
    moved = sign * (np.array(positions) - positions[begins - 1])[begins:]
    if moved[-1] <= 1e-6:
        return None
    gain = moved[-1] / step
    return (
        gain,
        theta + FINE_S * np.argmax(moved > 1e-6),
        theta + FINE_S * np.argmax(moved >= 0.865 * moved[-1]),
    )


@pytest.mark.parametrize("way", list(StepWay))
@pytest.mark.parametrize(
    ("S", "J", "theta", "tau", "rate"),
    [
        (3.0, 1.1, 0.5, 2.0, np.inf),
        (4.0, 4.0, 0.0, 1.0, np.inf),
        (2.0, 0.0, 1.0, 3.0, 1.5),
        (1.5, 2.5, 0.2, 0.5, 2.0),
        (3.0, 1.0, 0.0, 0.0, 2.0),
    ],
)
def test_the_formula_gives_what_a_simulated_step_test_shows(S, J, theta, tau, rate, way):
    """Gain, Td and T86 of every step, and which steps do not move the stem."""
    numbers = StepNumbers(*(np.array([item]) for item in (S, J, theta, tau, rate)))
    for step in STEPS_PERCENT:
        result = step_test(S, J, theta, tau, rate, step, way)
        figures = step_figures(numbers, step, way, rising=True)
        if result is None:
            assert figures.moves == 0.0
            assert figures.dead_time.value is None
            assert "does not move" in (figures.dead_time.reason or "")
            continue
        gain, dead_time, t86 = result
        assert figures.travel_gain.value == pytest.approx(gain, abs=0.01)
        assert figures.dead_time.value == pytest.approx(dead_time, abs=0.05)
        assert figures.t86.value == pytest.approx(t86, abs=0.05)


def test_dead_band_is_S_and_resolution_is_J_with_their_intervals():
    """And a step between them moves the stem one way only."""
    screening = judged(percent(3.0), percent(1.0))
    figures = response_figures(screening)
    assert (figures.dead_band, figures.resolution) == (screening.S, screening.J)
    small, large = (figures_by(figures, step, StepWay.REVERSED) for step in (2.0, 5.0))
    assert small.moves == 0.0
    assert large.moves == 1.0
    assert large.travel_gain.value == pytest.approx(1 - 2.0 / 5.0)
    assert large.travel_gain.low < 0.6 < large.travel_gain.high
    assert figures_by(figures, 2.0, StepWay.SAME).travel_gain.value == 1.0
    assert figures.both_ways_alike


def test_a_step_near_the_dead_band_moves_the_stem_with_a_probability():
    """S of 4.5 to 5.5 % and a step of 5 %."""
    figures = response_figures(judged(percent(5.0, 0.5), percent(1.0)))
    assert 0.4 < figures_by(figures, 5.0, StepWay.REVERSED).moves < 0.6


def test_named_lag_and_delay_are_in_the_times_with_their_uncertainty():
    """Lag and delay of the effects, not those of the fit without them."""
    lag = Estimate(value=2.0, low=1.5, high=2.5, unit="s")
    delay = Estimate(value=0.5, low=0.4, high=0.6, unit="s")
    effects = [effect("actuator_lag", tau=lag), effect("dead_time", theta=delay)]
    figures = response_figures(judged(percent(3.0), percent(1.0), effects=effects))
    result = figures_by(figures, 10.0, StepWay.SAME)
    assert result.dead_time.value == pytest.approx(0.5 + 2.0 * np.log(10 / 9))
    assert result.t86.value == pytest.approx(0.5 + 2.0 * np.log(1 / 0.135), rel=1e-6)
    assert result.t86.low < 3.7 < result.t86.value < 5.3 < result.t86.high
    assert not figures.simulated
    assert not figures.left_out


def test_slow_one_way_only_shows_that_way():
    """A speed limit of the rising position alone."""
    rates = {
        "rate_rising": Estimate(value=1.0, low=0.9, high=1.1, unit="%/s"),
        "rate_falling": Estimate(value=100.0, unit="%/s"),
    }
    figures = response_figures(
        judged(percent(1.0), percent(0.5), effects=[effect("asymmetric_rate_limit", **rates)])
    )
    assert not figures.both_ways_alike
    assert figures_by(figures, 10.0, StepWay.SAME).t86.value == pytest.approx(8.65)
    assert figures_by(figures, 10.0, StepWay.SAME, rising=False).t86.value < 1e-6


def test_without_named_effects_the_fit_of_S_and_J_gives_the_times():
    """The indicators of the fit hold its lags."""
    lag = Indicator(name="lag_rising_s", value=2.0, unit="s", meaning="")
    figures = response_figures(judged(percent(3.0), percent(1.0), indicators=[lag]))
    result = figures_by(figures, 10.0, StepWay.SAME)
    assert result.dead_time.value == pytest.approx(2.0 * np.log(10 / 9))


def published(**terms):
    base = (3.0, 1.1 / 3, 0.0, 0.0, 0.0, 0.0)
    model = RivalModel(slug="", base=(base, base), terms={k: (v, v) for k, v in terms.items()})
    return OpenQuestion(published=model, interval=0.1, unit_s=1.0, scatter=0.0)


@pytest.mark.parametrize("way", list(StepWay))
def test_steps_that_are_run_agree_with_the_formula_where_it_holds(way):
    """A lag, once in the formula and once run on the stored model."""
    tau = Estimate(value=2.0, unit="s")
    by_formula = response_figures(
        judged(percent(3.0, 0), percent(1.1, 0), effects=[effect("actuator_lag", tau=tau)])
    )
    # The same model, named as if it were beyond the formula.
    run = response_figures(
        judged(
            percent(3.0, 0),
            percent(1.1, 0),
            effects=[effect("viscous_drag", tau_v=tau)],
            question=published(actuator_lag=(2.0,)),
        )
    )
    assert run.simulated == ("viscous_drag",)
    for step in STEPS_PERCENT:
        expected, result = (figures_by(item, step, way) for item in (by_formula, run))
        assert result.moves == expected.moves
        if expected.moves:
            assert result.travel_gain.value == pytest.approx(expected.travel_gain.value, abs=0.01)
            assert result.dead_time.value == pytest.approx(expected.dead_time.value, abs=0.15)
            assert result.t86.value == pytest.approx(expected.t86.value, abs=0.15)


def chain_step_test(step, way, *, drag=0.0, ring=None, rate=np.inf, S=3.0, J=1.1):
    """Gain, Td, T86 and overshoot in percent by Newton's rules in fine steps: a positioner
    ``p'' = wn^2 (u - p) - 2 zeta wn p'``, a speed limit, and a stem with
    ``drag x' = |p - x| - (S - J)/2``, which stands below 0.01 % a second."""
    dt, sticks, slides = 0.01, (S + J) / 2, (S - J) / 2
    sign = 1.0 if way is StepWay.SAME else -1.0
    rise = np.linspace(0.0, 15.0, int(40.0 / dt))
    op = np.concatenate((rise, np.full(int(40.0 / dt), 15.0), np.full(6000, 15.0 + sign * step)))
    rung = speed = p = x = 0.0
    moving, d, positions = False, 1.0, []
    for u in op:
        if ring is None:
            rung = u
        else:
            wn, zeta = ring
            speed += dt * (wn**2 * (u - rung) - 2.0 * zeta * wn * speed)
            rung += dt * speed
        p += float(np.clip(rung - p, -rate * dt, rate * dt))
        if abs(p - x) > sticks:
            moving, d = True, float(np.sign(p - x))
        gap = d * (p - x) - slides
        if moving and gap > max(0.01 * drag, 1e-9):
            x += d * gap * (1.0 if drag == 0.0 else 1.0 - np.exp(-dt / drag))
        else:
            moving = False
        positions.append(x)
    moved = sign * (np.array(positions[-6000:]) - positions[-6001])
    final = moved[-1]
    if final < 0.02 * step:
        return None
    return (
        final / step,
        dt * np.argmax(moved > 0.02 * step),
        dt * np.argmax(moved >= 0.865 * final),
        100.0 * (moved.max() - final) / final,
    )


SIMULATED = [
    ("viscous_drag", (2.0,), {"drag": 2.0}),
    ("underdamped_positioner", (1.5, 0.3), {"ring": (1.5, 0.3)}),
    ("rate_limit", (0.5,), {"rate": 2.0}),
]


@pytest.mark.parametrize(
    ("slug", "numbers", "physics", "way"),
    [
        # Each effect by one way in the short run, and each way.
        pytest.param(*case, way, marks=[] if (k + n) % 2 == 0 else [pytest.mark.long])
        for k, case in enumerate(SIMULATED)
        for n, way in enumerate(StepWay)
    ],
)
def test_steps_that_are_run_are_those_of_a_simulated_step_test(slug, numbers, physics, way):
    """Drag, a ringing positioner and a speed limit, on every step that moves the stem."""
    shown = "viscous_drag" if slug == "rate_limit" else slug  # beyond the formula, so that it runs
    screening = judged(
        percent(3.0, 0),
        percent(1.1, 0),
        effects=[effect(shown)],
        question=published(**{slug: numbers}),
    )
    figures = response_figures(screening)
    assert figures.simulated == (shown,)
    for step in STEPS_PERCENT:
        result = figures_by(figures, step, way)
        expected = chain_step_test(step, way, **physics)
        if expected is None:
            assert result.moves == 0.0
            continue
        gain, dead_time, t86, overshoot = expected
        assert result.travel_gain.value == pytest.approx(gain, abs=0.03)
        assert result.dead_time.value == pytest.approx(dead_time, abs=0.2)
        assert result.t86.value == pytest.approx(t86, abs=0.2)
        assert result.overshoot.value == pytest.approx(overshoot, abs=4.0)


def test_a_ringing_positioner_overshoots():
    """Physics beyond the formula shows in the figures."""
    question = published(underdamped_positioner=(1.5, 0.3))
    wn = Estimate(value=1.5, unit="rad/s")
    zeta = Estimate(value=0.3, unit="")
    screening = judged(
        percent(3.0, 0),
        percent(1.0, 0),
        effects=[effect("underdamped_positioner", wn=wn, zeta=zeta)],
        question=question,
    )
    assert figures_by(response_figures(screening), 10.0, StepWay.SAME).overshoot.value > 5.0


def test_physics_that_no_stored_model_has_is_said_to_be_left_out():
    """As of a screening that an earlier version stored."""
    drag = effect("viscous_drag", tau_v=Estimate(value=2.0, unit="s"))
    figures = response_figures(judged(percent(3.0), percent(1.0), effects=[drag]))
    assert figures.left_out == ("viscous_drag",)
    assert figures.steps


def test_without_S_and_J_there_are_no_figures_and_the_reason_stays():
    """An undetermined valve."""
    figures = response_figures(failed("FV-1", "no position.", "", Provenance(source="test")))
    assert figures.steps == ()
    assert figures.dead_band.reason == "no position."


def test_times_are_uncertain_by_a_sample():
    """Samples every 5 s."""
    recording_facts = RecordingFacts(
        start=None, end=None, interval_s=5.0, samples=100, usable_share=1.0, tags={}
    )
    figures = response_figures(replace(judged(percent(3.0), percent(1.0)), kept=recording_facts))
    result = figures_by(figures, 10.0, StepWay.SAME)
    assert (result.dead_time.value, result.dead_time.high) == (pytest.approx(0, abs=1e-6), 5.0)
