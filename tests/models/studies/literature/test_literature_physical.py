"""Force balances against a fixed-step integration, against the elements, and against themselves."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from stemwatch.models.studies.literature.canonical import CANONICAL
from stemwatch.models.studies.literature.model import values_of
from stemwatch.models.studies.literature.physical import bristle, coulomb
from stemwatch.models.studies.literature.physical.body import Packing, ValveBody
from stemwatch.models.studies.literature.physical.bristle import bristle_constants
from stemwatch.models.studies.literature.physical.classical import classical
from stemwatch.models.studies.literature.physical.coulomb import coulomb_constants
from stemwatch.models.studies.literature.physical.dahl import dahl
from stemwatch.models.studies.literature.physical.karnopp import karnopp
from stemwatch.models.studies.literature.physical.lugre import lugre
from stemwatch.models.studies.literature.physical.mueller import MUELLER
from stemwatch.models.studies.literature.physical.published import (
    PUBLISHED,
    SET_A,
    SET_B,
    SET_C,
    ParameterSet,
)
from stemwatch.models.studies.literature.physical.shared_parameters import TOLERANCE_PERCENT

# A light valve with a clear jump: S of 20 %, J of 4 %, hardly damped beyond what it takes.
LIGHT_BODY = SET_B.body.bench_set()
SPAN_N = LIGHT_BODY.pressure_span_n
LIGHT = ParameterSet(
    name="light",
    body=LIGHT_BODY,
    packing=Packing(
        static_n=0.12 * SPAN_N,
        kinetic_n=0.08 * SPAN_N,
        viscous_ns_per_m=1500.0,
        stribeck_m_per_s=1e-5,
    ),
    provenance="made up",
    assumed="everything",
)


def on_bench(published):
    """A published set on pressures that fit its stroke."""
    return replace(published, body=published.body.bench_set())


def band_percent(body, packing):
    """S = 100 (Fs + Fc)/Fspan, where OP moves faster than the Stribeck speed before it turns."""
    return 100.0 * (packing.static_n + packing.kinetic_n) / body.pressure_span_n


def creeping_band_percent(body, packing):
    """S = 200 Fs/Fspan on slower ramps with Fv/k above 0.3 s: the stem creeps, and J is 0."""
    return 200.0 * packing.static_n / body.pressure_span_n


def jump_percent(body, packing):
    """J = 100 (Fs - Fc)/Fspan at a damping ratio between 0.9 and 20."""
    return 100.0 * (packing.static_n - packing.kinetic_n) / body.pressure_span_n


def damping_ratio(body, packing):
    """zeta = Fv/(2 sqrt(m k))."""
    return packing.viscous_ns_per_m / (2.0 * math.sqrt(body.mass_kg * body.spring_n_per_m))


def slip_time_s(body, packing):
    """Fv/k: the time constant of a slip that the drag governs."""
    return packing.viscous_ns_per_m / body.spring_n_per_m


def sliding_offset_percent(body, packing, speed_percent_per_s):
    """u - y of a stem that slides upward at a steady speed: (level(v) + Fv v)/Fspan."""
    v = 0.01 * speed_percent_per_s * body.stroke_m
    drop = math.exp(-((v / packing.stribeck_m_per_s) ** 2))
    level = packing.kinetic_n + (packing.static_n - packing.kinetic_n) * drop
    return 100.0 * (level + packing.viscous_ns_per_m * v) / body.pressure_span_n


def zigzag(seconds, interval_s, swing=40.0, period_s=40.0):
    t = np.arange(0.0, seconds, interval_s)
    return 50.0 + swing * (np.abs((t / period_s) % 2.0 - 1.0) - 0.5)


def run(model, op, interval_s, y0=None, **named):
    start = float(op[0]) if y0 is None else y0
    return model.simulate(op, values_of(model, **named), interval_s, start)


def fixed_step_karnopp(op, interval_s, valve, y0, step_s=1e-4, band=1e-6):
    """Karnopp's model by a rule of fixed step, implicit in the viscous drag."""
    b, p = valve.body, valve.packing
    x, v, y = 0.01 * y0 * b.stroke_m, 0.0, [y0]
    inner = round(interval_s / step_s)
    at_zero, per_percent = b.area_m2 * b.pressure_low_pa - b.preload_n, b.pressure_span_n / 100.0
    for before, now in pairwise(op):
        for i in range(inner):
            u = before + (now - before) * (i + 1) / inner
            force = at_zero + per_percent * u - b.spring_n_per_m * x
            if abs(v) <= band and abs(force) <= p.static_n:
                v = 0.0
            else:
                side = math.copysign(1.0, force if abs(v) <= band else v)
                drop = (p.static_n - p.kinetic_n) * math.exp(-((v / p.stribeck_m_per_s) ** 2))
                net = force - side * (p.kinetic_n + drop)
                new = v + step_s / b.mass_kg * net
                new /= 1.0 + step_s * p.viscous_ns_per_m / b.mass_kg
                v = 0.0 if abs(v) > band and new * v < 0.0 else new
            x += v * step_s
        y.append(100.0 * x / b.stroke_m)
    return np.array(y)


def fixed_step_lugre(op, interval_s, valve, y0, step_s=2e-5):
    """LuGre's model by a rule of fixed step, implicit in the bristle."""
    b, p = valve.body, valve.packing
    x, v, y = 0.01 * y0 * b.stroke_m, 0.0, [y0]
    at_zero, per_percent = b.area_m2 * b.pressure_low_pa - b.preload_n, b.pressure_span_n / 100.0
    z = (at_zero + per_percent * op[0] - b.spring_n_per_m * x) / p.bristle_n_per_m
    inner = round(interval_s / step_s)
    for before, now in pairwise(op):
        for i in range(inner):
            u = before + (now - before) * (i + 1) / inner
            drop = (p.static_n - p.kinetic_n) * math.exp(-((v / p.stribeck_m_per_s) ** 2))
            g = (p.kinetic_n + drop) / p.bristle_n_per_m
            z = (z + step_s * v) / (1.0 + step_s * abs(v) / g)
            force = at_zero + per_percent * u - b.spring_n_per_m * x - p.bristle_n_per_m * z
            force += p.bristle_ns_per_m * abs(v) * z / g
            drag = p.viscous_ns_per_m + p.bristle_ns_per_m
            v = (v + step_s / b.mass_kg * force) / (1.0 + step_s * drag / b.mass_kg)
            x += v * step_s
        y.append(100.0 * x / b.stroke_m)
    return np.array(y)


@pytest.mark.long
@pytest.mark.parametrize("valve", [on_bench(SET_B), on_bench(SET_C), LIGHT], ids=lambda v: v.name)
def test_karnopp_is_the_fixed_step_integration(valve):
    """The adaptive integration and one of 0.1 ms steps give the same stem within 0.05 %."""
    op = zigzag(60.0, 0.5)
    process = run(karnopp(valve), op, 0.5)
    expected = fixed_step_karnopp(op, 0.5, valve, float(op[0]))
    assert np.max(np.abs(process - expected)) < 0.05


@pytest.mark.long
def test_lugre_is_the_fixed_step_integration():
    """The adaptive integration and one of 0.02 ms steps give the same stem within 0.05 %."""
    valve = on_bench(SET_B)
    op = zigzag(16.0, 0.5, period_s=6.0)
    process = run(lugre(valve), op, 0.5)
    expected = fixed_step_lugre(op, 0.5, valve, float(op[0]))
    assert np.max(np.abs(process - expected)) < 0.05


@pytest.mark.parametrize(
    ("valve", "make"),
    [
        # The heavy valve sticks with the model that takes a tenth of the time of the others.
        pytest.param(valve, make, marks=[pytest.mark.long] if slow else [])
        for valve, slow_ones in ((on_bench(SET_B), (classical, lugre)), (LIGHT, ()))
        for make in (classical, karnopp, lugre, dahl)
        for slow in [make in slow_ones]
    ],
)
def test_a_finer_tolerance_changes_nothing_that_is_seen(make, valve):
    """The usual tolerance is within 0.05 % of the truth, and a finer one is nearer still."""
    op = zigzag(120.0, 1.0)
    usual, fine, finest = (
        run(make(valve, tolerance_percent=t), op, 1.0) for t in (TOLERANCE_PERCENT, 1e-6, 1e-7)
    )
    of_usual, of_fine = (float(np.max(np.abs(y - finest))) for y in (usual, fine))
    assert of_usual < 0.05
    assert of_fine < 0.4 * of_usual


@pytest.mark.parametrize("make", [classical, karnopp])
def test_a_light_valve_is_the_element(make):
    """Coulomb friction with little drag is the canonical element with S = (Fs + Fc)/Fspan and
    J = (Fs - Fc)/Fspan, but for the samples within a slip."""
    op = zigzag(400.0, 1.0)
    element = CANONICAL.simulate(op, np.array([20.0, 4.0]), 1.0, float(op[0]))
    apart = np.abs(run(make(LIGHT), op, 1.0) - element)
    assert np.quantile(apart[40:], 0.9) < 0.1


def test_classical_and_karnopp_agree():
    """A band of a millionth of a metre per second is no more than a way to find rest."""
    op = zigzag(200.0, 1.0)
    for valve in (on_bench(SET_A), on_bench(SET_B), LIGHT):
        result, expected = run(karnopp(valve), op, 1.0), run(classical(valve), op, 1.0)
        assert np.max(np.abs(result - expected)) < 0.05


def test_dahl_has_no_jump():
    """Dahl's stem breaks away without a slip: no step is much larger than the command's."""
    op = zigzag(400.0, 0.5)
    y = run(dahl(LIGHT), op, 0.5, kinetic_n=0.1 * SPAN_N)
    assert np.max(np.abs(np.diff(y))) < 1.05 * np.max(np.abs(np.diff(op)))
    jumps = run(karnopp(LIGHT), op, 0.5)
    assert np.max(np.abs(np.diff(jumps))) > 5.0 * np.max(np.abs(np.diff(op)))


def test_lugre_creeps_under_a_dithering_command_and_karnopp_does_not():
    """The artefact of presliding: a stem that ought to rest drifts with every cycle."""
    k = np.arange(2000)
    op = 50.0 + 4.0 + 3.0 * np.sin(k)
    valve = on_bench(SET_B)
    drift = run(lugre(valve), op, 1.0, y0=50.0)
    assert drift[-1] - 50.0 > 0.2
    assert np.ptp(run(karnopp(valve), op, 1.0, y0=50.0)) < 1e-9


def test_the_stem_slides_where_the_force_balance_says():
    """Set b on a ramp of 0.7 %/s slides 12.86 % of its pressure span behind its equilibrium."""
    op = np.arange(20.0, 95.0, 0.07)
    y = run(karnopp(SET_B), op, 0.1, y0=10.0)
    body = SET_B.body
    equilibrium = (op - body.preload_percent) * body.pressure_span_n / body.spring_span_n
    behind = (equilibrium - y)[-1] * body.spring_span_n / body.pressure_span_n
    assert behind == pytest.approx(12.86, abs=0.02)
    assert sliding_offset_percent(body, SET_B.packing, 0.7) == pytest.approx(12.86, abs=0.01)


def test_a_stop_holds_the_stem_until_friction_is_overcome():
    """At 100 % the command has to come back by fs from where it holds the stem (A7)."""
    op = np.concatenate((np.linspace(60.0, 120.0, 121), np.linspace(120.0, 80.0, 161)))
    fs = 100.0 * values_of(MUELLER)[0] / SET_B.body.bench_set().pressure_span_n
    y = run(MUELLER, op, 1.0, air_lag_s=0.0)
    assert y.max() == pytest.approx(100.0)
    leaves = 121 + int(np.argmax(y[121:] < 100.0 - 1e-6))
    assert op[leaves] == pytest.approx(100.0 - fs, abs=0.6)


def test_a_flow_force_is_an_error_of_span():
    """I17 for the force balance: with Fo the stem goes as the softer valve's by k/(k + Fo/stroke)
    once friction, drag and inertia are scaled alike."""
    op = zigzag(200.0, 1.0)
    share = 0.1
    flow = share * SET_B.body.spring_span_n
    fast = {"air_lag_s": 0.0, "viscous_ns_per_m": 5000.0}
    with_flow = run(MUELLER, op, 1.0, y0=float(op[0]) / (1 + share), flow_force_n=flow, **fast)
    without = run(MUELLER, op, 1.0, **fast)
    assert np.quantile(np.abs((1 + share) * with_flow - without), 0.95) < 0.15


@pytest.mark.parametrize("lag_s", [0.3, 2.0, 10.0])
def test_the_air_follows_a_ramp_exactly(lag_s):
    """A first-order lag trails a ramp by T times its slope, at any interval."""
    t = np.arange(0.0, 100.0, 1.5)
    out = np.empty(t.size)
    coulomb.air_lag(2.0 * t, 1.5, lag_s, out)
    np.testing.assert_allclose(out, 2.0 * t - 2.0 * lag_s * (1.0 - np.exp(-t / lag_s)), atol=1e-9)


def test_without_air_lag_the_pressure_is_the_command():
    """A lag of nothing changes nothing."""
    op, out = zigzag(50.0, 1.0), np.empty(50)
    coulomb.air_lag(op, 1.0, 0.0, out)
    np.testing.assert_array_equal(out, op)


def test_compiled_is_interpreted(monkeypatch):
    """The kernels give the same compiled and as plain Python."""
    op, valve = zigzag(20.0, 1.0, period_s=5.0), LIGHT
    steady = coulomb_constants(valve.body, valve.packing, 1e-6, 1e-3)
    bristles = bristle_constants(valve.body, valve.packing, 1e-2)
    cases = [
        (coulomb, "run_coulomb", ("_euler", "_step", "_rests_for", "_interval"), steady),
        (bristle, "run_bristle", ("_euler", "_interval"), bristles),
    ]
    for module, name, inner, c in cases:
        out, plain = np.empty(op.size), np.empty(op.size)
        compiled = getattr(module, name)
        compiled(op, 1.0, valve.body.stroke_m, float(op[0]), c, out)
        for function in inner:
            monkeypatch.setattr(module, function, getattr(module, function).py_func)
        compiled.py_func(op, 1.0, valve.body.stroke_m, float(op[0]), c, plain)
        np.testing.assert_allclose(out, plain, atol=1e-6)
        assert np.ptp(out) > 5.0


# Formulas of S and J in newtons, against the table of published parameter sets.


def test_set_a_gives_the_published_band_and_jump():
    """S of 58.69 % and J of 5.34 % for the nominal valve, on a ramp faster than Stribeck's."""
    assert band_percent(SET_A.body, SET_A.packing) == pytest.approx(58.69, abs=0.005)
    assert jump_percent(SET_A.body, SET_A.packing) == pytest.approx(5.34, abs=0.005)
    assert damping_ratio(SET_A.body, SET_A.packing) == pytest.approx(1.15, abs=0.01)


def test_set_b_creeps_on_a_slow_ramp():
    """2 Fs/Fspan is the S that was published with set b."""
    S = creeping_band_percent(SET_B.body, SET_B.packing)
    assert S == pytest.approx(SET_B.published_S_percent, abs=1e-3)
    assert slip_time_s(SET_B.body, SET_B.packing) == pytest.approx(0.594, abs=5e-4)
    assert slip_time_s(SET_C.body, SET_C.packing) == pytest.approx(0.341, abs=5e-4)


def test_set_b_contradicts_itself():
    """The published J is Fs - Fc although the published S is 2 Fs."""
    packing, span = SET_B.packing, SET_B.body.pressure_span_n
    difference = 100.0 * (packing.static_n - packing.kinetic_n) / span
    assert difference == pytest.approx(SET_B.published_J_percent, abs=1e-3)


def test_the_preload_of_set_b_is_the_published_one():
    """D = (Finit - Sa Pmin)/Fspan is 11.4947 %."""
    assert SET_B.body.preload_percent == pytest.approx(SET_B.published_D_percent, abs=1e-3)
    assert SET_B.body.bench_set().preload_percent == pytest.approx(0.0, abs=1e-9)


def band_and_jump(valve, ramp=1.0, interval_s=0.05):
    """S and J read from the simulated stem: travel of OP from reversal to slip, and the rise of a
    slip after a stop on the way up."""
    up = np.arange(0.0, 130.0, ramp * interval_s) - 30.0
    down = up[-1] - np.arange(0.0, 90.0, ramp * interval_s)
    y = run(karnopp(valve), np.concatenate((up, down)), interval_s, y0=0.0)
    moved = np.abs(y - y[up.size - 1]) > 0.02
    moved[: up.size + 5] = False
    S = up[-1] - down[int(np.argmax(moved)) - up.size]
    held = np.concatenate((up, np.full(200, up[-1]), up[-1] + np.arange(0.0, 20.0, 0.05)))
    repeated = run(karnopp(valve), held, interval_s, y0=0.0)[up.size + 199 :]
    slip = int(np.argmax(np.diff(repeated) > 0.01))
    return float(S), float(
        repeated[slip + 1 + round(0.3 / interval_s)] - repeated[slip] - 0.3 * ramp
    )


@pytest.mark.parametrize("kinetic_share", [0.6, 0.8333])
def test_simulated_band_and_jump_are_those_of_the_formula(kinetic_share):
    """The nominal valve, and one with a lower kinetic level: the stem shows the S and J said."""
    packing = replace(SET_A.packing, kinetic_n=kinetic_share * SET_A.packing.static_n)
    valve = replace(SET_A, packing=packing)
    S, J = band_and_jump(valve)
    assert pytest.approx(band_percent(valve.body, packing), abs=0.15) == S
    assert pytest.approx(jump_percent(valve.body, packing), abs=0.15) == J


def test_an_underdamped_slip_swings_past():
    """The lower limit of the formula is real: with a tenth of critical drag J grows by more
    than half."""
    valve = replace(LIGHT, packing=replace(LIGHT.packing, viscous_ns_per_m=100.0))
    _, J = band_and_jump(valve)
    assert damping_ratio(valve.body, valve.packing) < 0.1
    assert J > 1.5 * 4.0


def test_a_body_and_a_packing_check_themselves():
    """Each impossible nameplate is refused with what was expected."""
    good = {
        "name": "v",
        "mass_kg": 1.0,
        "spring_n_per_m": 1e5,
        "area_m2": 0.05,
        "stroke_m": 0.03,
        "preload_n": 0.0,
        "pressure_low_pa": 2e4,
        "pressure_high_pa": 1e5,
    }
    with pytest.raises(ValueError, match="v: mass_kg must be positive: 0"):
        ValveBody(**(good | {"mass_kg": 0.0}))
    with pytest.raises(ValueError, match="v: expected pressure_low_pa < pressure_high_pa"):
        ValveBody(**(good | {"pressure_high_pa": 1e4}))
    levels = {"static_n": 5.0, "kinetic_n": 4.0, "viscous_ns_per_m": 1.0, "stribeck_m_per_s": 1e-3}
    with pytest.raises(ValueError, match="expected 0 <= kinetic_n <= static_n"):
        Packing(**(levels | {"kinetic_n": 6.0}))
    with pytest.raises(ValueError, match="must not be negative"):
        Packing(**(levels | {"viscous_ns_per_m": -1.0}))
    with pytest.raises(ValueError, match="must be positive"):
        Packing(**(levels | {"stribeck_m_per_s": 0.0}))


def test_every_published_set_says_where_it_is_from():
    """No number stands without its provenance and what was assumed beside it."""
    assert [s.name for s in PUBLISHED] == ["a", "b", "c"]
    assert all(("memory" in s.provenance) or ("published code" in s.provenance) for s in PUBLISHED)
    assert all(s.assumed for s in PUBLISHED)
