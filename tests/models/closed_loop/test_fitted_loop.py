"""A loop whose parts are known is identified, simulated, and predicted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stemwatch.models.closed_loop import kernel
from stemwatch.models.closed_loop.controller_law import controller_law
from stemwatch.models.closed_loop.fitted_loop import FittedValve, Knocker, fit_loop
from stemwatch.models.closed_loop.process_model import process_model
from stemwatch.models.closed_loop.what_if import REPAIRED, LoopChange, figures_of, predict
from stemwatch.models.estimate import Estimate
from stemwatch.models.recording import ProcessRange, Recording, Role, Signal
from stemwatch.models.stickslip import kernel as element

N = 3600


def plant(
    S: float, J: float, *, integrates: bool = False, seed: int = 5, noise: float = 0.02
) -> dict[str, np.ndarray]:
    """A PI loop written down here, sample by sample: gain 1.5, lag 20 s, delay 4 s (or an
    integral), a coloured load at its input, and the canonical element as its valve."""
    rng = np.random.default_rng(seed)
    op, x, pv = np.zeros(N), np.zeros(N), np.zeros(N)
    sp = np.where(np.arange(N) < 1800, 50.0, 53.0)
    load = level = load_now = 0.0
    stem, way, moving = 50.0, 1.0, False
    integral, before = 50.0, 50.0
    gain, reset = (0.8, 25.0) if not integrates else (1.2, 90.0)
    for k in range(N):
        pv[k] = 50.0 + level + noise * rng.standard_normal()
        integral += gain / reset * (sp[k] - pv[k])
        op[k] = integral + gain * (sp[k] - pv[k])
        step, before = op[k] - before, op[k]
        if not (moving and way * step > 0.0):
            moving = abs(op[k] - stem) > 0.5 * (S + J)
            way = np.sign(op[k] - stem) if moving else way
        stem = op[k] - way * 0.5 * (S - J) if moving else stem
        x[k] = stem
        load = 0.98 * load + 0.05 * rng.standard_normal()
        load_now = x[max(k - 4, 0)] - 50.0 + load
        level += 0.01 * load_now if integrates else (1.5 * load_now - level) / 20.0
    return {"op": op, "mv": x, "pv": pv, "sp": sp}


def recording(signals: dict[str, np.ndarray]) -> Recording:
    """The columns as a recording at 1 s."""
    return Recording(
        valve="FIC-1",
        signals={Role(name): Signal.good(values, name) for name, values in signals.items()},
        interval_s=1.0,
    )


def test_the_controllers_law_is_read_off_the_recording() -> None:
    """Gain and reset time of the PI law are found, and no law where an operator moves OP."""
    made = plant(5.0, 2.0)
    law = controller_law(made["op"], made["pv"], made["sp"])
    assert not isinstance(law, str)
    assert law.gain == pytest.approx(0.8, rel=0.02)
    assert law.reset_s(1.0) == pytest.approx(25.0, rel=0.02)
    walked = np.cumsum(np.random.default_rng(1).standard_normal(N))
    assert "may be in manual" in str(controller_law(walked, made["pv"], made["sp"]))


@pytest.mark.parametrize("integrates", [False, True])
def test_the_process_is_found_inside_a_closed_loop(integrates: bool) -> None:
    """Although the load moves the valve through the controller, the process is found without
    bias.
    """
    made = plant(5.0, 2.0, integrates=integrates)
    found = process_model(made["mv"], made["pv"])
    assert not isinstance(found, str)
    if integrates:
        slope = found.gain if found.integrates else found.gain / found.lag
        assert slope == pytest.approx(0.01, rel=0.1)
    else:
        assert found.gain == pytest.approx(1.5, rel=0.1)
        assert found.lag == pytest.approx(20.0, rel=0.1)
    assert found.delay == pytest.approx(4.0, abs=1.0)
    assert "cannot be told" in str(process_model(made["mv"], np.sin(np.arange(N) ** 1.5)))


def test_the_loop_kernel_moves_the_stem_as_the_fit_kernel_does() -> None:
    """The kernel's own copy of the stick-slip element gives the positions of the fit's kernel."""
    made = plant(5.0, 2.0)
    loop = fit_loop(recording(made), FittedValve(S=5.0, J=2.0, lag_up_s=1.5, lag_down_s=3.0))
    assert not isinstance(loop, str)
    run = loop.run()
    q = np.zeros(element.N_PARAMETERS)
    q[element.S], q[element.J], q[element.GAIN] = 5.0, 2.0, 1.0
    q[element.LAG_UP_S], q[element.LAG_DOWN_S] = 1.5, 3.0
    q[element.RATE_UP] = q[element.RATE_DOWN] = 1e6
    start = np.zeros(N, dtype=np.uint8)
    start[0] = element.START
    out = np.empty(N)
    zero = float(np.mean(made["mv"]) - np.mean(made["op"]))
    element.simulate(run.op, run.x - zero, start, 1.0, q, out)
    assert np.abs(out[200:] - (run.x - zero)[200:]).max() < 1e-9


def test_the_process_model_reproduces_the_pv_of_the_closed_loop() -> None:
    """Driven by the position of the closed loop, the process model gives the loop's PV."""
    loop = fit_loop(recording(plant(5.0, 2.0)), FittedValve(S=5.0, J=2.0))
    assert not isinstance(loop, str)
    run, process = loop.run(), loop.process
    answer = np.empty(N)
    kernel.process_answer(run.x, process.lag, process.second_lag, process.delay, False, answer)
    again = process.gain * answer + process.disturbance
    assert np.abs(again - run.pv).max() < 1e-9


@pytest.mark.parametrize("integrates", [False, True])
def test_a_repair_is_predicted_within_its_interval(integrates: bool) -> None:
    """The same plant with a valve that does not stick lies within the interval of the
    prediction.
    """
    loop = fit_loop(recording(plant(5.0, 2.0, integrates=integrates)), FittedValve(S=5.0, J=2.0))
    assert not isinstance(loop, str)
    good = plant(0.0, 0.0, integrates=integrates)
    truth = figures_of(
        replace(loop.recorded, op=good["op"], x=good["mv"], pv=good["pv"], sp=good["sp"])
    )
    told = predict(loop, REPAIRED)
    error = told.predicted["error_std"]
    assert error.low <= truth.error_std <= error.high
    fall = told.fall("error_std", squared=True)
    real = 100.0 * (1.0 - (truth.error_std / told.recorded.error_std) ** 2)
    assert fall.low <= real <= fall.high
    assert fall.high - fall.low < 40.0
    assert predict(loop, LoopChange()).as_it_is.error_std == pytest.approx(
        told.recorded.error_std, rel=0.2
    )


def test_a_knocker_moves_the_stem_and_saves_nothing_for_a_good_valve() -> None:
    """The pulses of a knocker add travel."""
    loop = fit_loop(recording(plant(5.0, 2.0)), FittedValve(S=5.0, J=2.0))
    assert not isinstance(loop, str)
    told = predict(loop, LoopChange(knocker=Knocker(height=5.0, every_s=10.0, for_s=2.0)))
    assert told.predicted["travel_per_hour"].value > 3.0 * told.recorded.travel_per_hour


def test_time_on_target_needs_a_band() -> None:
    """Without a target band it is unknown, with a reason."""
    loop = fit_loop(recording(plant(5.0, 2.0)), FittedValve(S=5.0, J=2.0))
    assert not isinstance(loop, str)
    assert predict(loop, REPAIRED).saved("off_target").value is None
    saved = predict(loop, REPAIRED, target_band=0.5).saved("off_target")
    assert 0.0 < saved.value <= 100.0


def test_a_loop_that_cannot_be_simulated_has_a_reason() -> None:
    """Without a position, too short, in manual, and with a valve whose S is not known."""
    made = plant(5.0, 2.0)
    valve = FittedValve(S=5.0, J=2.0)
    without = {name: values for name, values in made.items() if name != "mv"}
    assert "the position was not recorded" in str(fit_loop(recording(without), valve))
    short = {name: values[:200] for name, values in made.items()}
    assert "200 samples" in str(fit_loop(recording(short), valve))
    holes = dict(made, pv=np.where(np.arange(N) % 250 < 10, np.nan, made["pv"]))
    assert "240 samples" in str(fit_loop(recording(holes), valve))
    wrong = dict(made, mv=100.0 - made["mv"])
    assert "do not answer" in str(fit_loop(recording(wrong), valve))
    unknown = Estimate.unknown("it never moved", "%")
    assert "S is not known: it never moved" in str(FittedValve.of(unknown, unknown, {}))


def test_holes_of_a_few_samples_are_bridged() -> None:
    """Three missing samples here and there do not end the stretch."""
    made = plant(5.0, 2.0)
    pv = made["pv"].copy()
    pv[500::400] = np.nan
    loop = fit_loop(recording(dict(made, pv=pv)), FittedValve(S=5.0, J=2.0))
    assert not isinstance(loop, str)
    assert loop.recorded.pv.size == N


def test_pv_is_in_its_own_unit() -> None:
    """Errors are in engineering units, also where the archive keeps percent of the range."""
    made = plant(5.0, 2.0)
    whole = recording(made)
    span = ProcessRange(low=0.0, high=16.0, unit="bar")
    in_bar = {
        role: replace(signal, range=span) if role in (Role.PV, Role.SP) else signal
        for role, signal in whole.signals.items()
    }
    loop = fit_loop(replace(whole, signals=in_bar), FittedValve(S=5.0, J=2.0))
    plain = fit_loop(whole, FittedValve(S=5.0, J=2.0))
    assert not isinstance(loop, str)
    assert not isinstance(plain, str)
    assert loop.unit == "bar"
    assert loop.process.gain == pytest.approx(0.16 * plain.process.gain, rel=1e-3)
    only_pv = {**in_bar, Role.SP: whole.signals[Role.SP]}
    said = fit_loop(replace(whole, signals=only_pv), FittedValve(S=5.0, J=2.0))
    assert said == "the set point is in % and PV in bar"


def test_each_drawn_loop_has_its_own_breakaway_levels() -> None:
    """The fitted loop has breakaways of one level; each draw has scattering levels of its own."""
    made = plant(5.0, 2.0)
    known = {"breakaway_scatter_percent": 10.0, "position_noise_percent": 0.2}
    S, J = (Estimate(value=one, unit="%") for one in (5.0, 2.0))
    valve = FittedValve.of(S, J, known)
    assert not isinstance(valve, str)
    assert (valve.scatter, valve.noise) == (0.1, 0.2)
    loop = fit_loop(recording(made), valve)
    assert not isinstance(loop, str)
    assert loop.breakaways.tolist() == [1.0]
    levels = loop.draw_alternative(np.random.default_rng(1)).breakaways
    assert np.std(levels) == pytest.approx(0.1, rel=0.1)
    scattered, even = replace(loop, breakaways=levels).run(), loop.run()
    assert np.max(np.abs(scattered.x - even.x)) > 1.0
    assert replace(loop, breakaways=np.ones(7)).run().x.tolist() == even.x.tolist()


def test_noise_of_the_reading_does_not_count_as_travel() -> None:
    """For a stem at rest, and for one that moves beyond the noise."""
    loop = fit_loop(recording(plant(5.0, 2.0)), FittedValve(S=5.0, J=2.0))
    assert not isinstance(loop, str)
    noise = 0.2 * np.random.default_rng(2).standard_normal(N)
    standing = replace(loop.recorded, x=50.0 + noise)
    counted = figures_of(standing).travel_per_hour
    assert figures_of(standing, noise=0.2).travel_per_hour < 0.1 * counted
    moved = replace(loop.recorded, x=loop.recorded.x + noise)
    truth = figures_of(loop.recorded).turns_per_hour
    assert figures_of(moved).turns_per_hour > 10.0 * truth
    assert truth <= figures_of(moved, noise=0.2).turns_per_hour < 2.0 * truth


def test_the_hidden_air_lag_takes_effect_when_friction_is_removed() -> None:
    """It is zero while the valve sticks as before, and complete once it is repaired; a lag that was
    found does not change.
    """
    sticking = FittedValve(S=4.0, J=1.0, hidden_lag_s=2.0)
    assert LoopChange(gain_times=0.5).valve(sticking) == sticking
    half, repaired = LoopChange(S=2.0).valve(sticking), REPAIRED.valve(sticking)
    assert (half.lag_up_s, half.lag_down_s) == (1.0, 1.0)
    assert (repaired.lag_up_s, repaired.lag_down_s) == (2.0, 2.0)
    slow = replace(sticking, lag_up_s=0.7, lag_down_s=0.4)
    assert (REPAIRED.valve(slow).lag_up_s, REPAIRED.valve(slow).lag_down_s) == (0.7, 0.4)


def test_a_repaired_valve_travels_less_with_slow_air() -> None:
    """A slow actuator passes less of the noise of PV; the uncertainty is in the interval."""
    loop = fit_loop(recording(plant(5.0, 2.0, noise=0.4)), FittedValve(S=5.0, J=2.0))
    assert not isinstance(loop, str)
    slow, quick = (
        figures_of(loop.run(REPAIRED.valve(replace(loop.valve, hidden_lag_s=lag))))
        for lag in (5.0, 0.1)
    )
    assert slow.travel_per_hour < 0.5 * quick.travel_per_hour
    assert slow.error_std == pytest.approx(quick.error_std, rel=0.1)
    foretold = predict(loop, REPAIRED).predicted["travel_per_hour"]
    assert 2.0 * foretold.low < foretold.high
    assert foretold.high > 0.9 * quick.travel_per_hour


def test_intervals_for_another_tuning_are_wider_than_for_a_repair() -> None:
    """The interval is at least a tenth of the recorded deviation either way."""
    loop = fit_loop(recording(plant(5.0, 2.0)), FittedValve(S=5.0, J=2.0))
    assert not isinstance(loop, str)
    for change, least in ((LoopChange(gain_times=0.5), 0.1), (LoopChange(S=2.0), 0.05)):
        foretold = predict(loop, change)
        end = foretold.predicted["error_std"]
        assert end.high - end.value >= least * foretold.recorded.error_std * (1.0 - 1e-9)
