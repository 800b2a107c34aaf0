"""From recordings to verdicts: one valve's failure is never another's."""

from __future__ import annotations

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stemwatch.models.estimate import Estimate
from stemwatch.models.mismatch.findings import Finding, Stiction
from stemwatch.models.narx.example import NarxExample
from stemwatch.models.narx.network import NarxNetwork
from stemwatch.models.narx.training import train
from stemwatch.models.recording import Provenance, Recording, Role, Signal
from stemwatch.models.screening.published_stiction import lag_is_doubtful
from stemwatch.models.screening.screen import Case, Options, failed, screen
from stemwatch.models.screening_result import Screening
from stemwatch.models.studies.simulator import PlantLoop, SimulatedValve, simulate_loop
from stemwatch.models.studies.simulator.loop import Load, LoadKind
from stemwatch.models.verdict import Verdict
from stemwatch.models.without_position.suspicion import Suspicion, suspect, trained_judge
from tests.models.half_an_hour import half_an_hour

QUICK = Options(narx=False)


def plant(S=5.0, J=2.0, lag_s=0.1, dead_time_s=0.0, seed=1) -> Recording:
    return half_an_hour(S, J, lag_s, dead_time_s, seed).recording


def network_of(recording: Recording) -> NarxNetwork:
    return train([NarxExample.of(recording, 1080)])[0].network


def recorded(op, mv=None, *, interval_s=1.0, valve="V") -> Recording:
    signals = {Role.OP: Signal.good(np.asarray(op, dtype=float), "V.OP")}
    if mv is not None:
        signals[Role.MV] = Signal.good(np.asarray(mv, dtype=float), "V.ZT")
    return Recording(valve=valve, signals=signals, interval_s=interval_s)


def quick(*recordings) -> list[Screening]:
    return screen([Case(recording=recording) for recording in recordings], QUICK)


def test_an_op_that_hardly_moves_is_no_ground_for_the_process_either():
    """One page would else say that sticking would not show, and that it would have shown."""
    quiet = PlantLoop(
        valve=SimulatedValve(S=0.3, J=0.0),
        setpoints=((0.0, 51.3),),
        loads=(Load(kind=LoadKind.COLOURED, size=0.05, time_s=30.0),),
        duration_s=3600.0,
    )
    recording = simulate_loop(quiet, 3).recording
    assert suspect(recording, trained_judge()).verdict is Suspicion.NO_SIGN
    (result,) = quick(recording)
    assert "a sticking stem would not show" in result.reason
    beside = result.without_position
    assert beside is not None
    assert beside.verdict is Suspicion.CANNOT_TELL
    assert "a sticking stem would not show" in beside.reason
    assert beside.advice == result.advice


def consistent(screening):
    """What every screening must be, whatever it was made of."""
    for estimate in (screening.S, screening.J):
        assert (estimate.value is None) != (estimate.reason is None)
        if estimate.value is not None:
            assert estimate.low <= estimate.value <= estimate.high
    numbers = {
        indicator.name: (indicator.value, indicator.low, indicator.high)
        for indicator in screening.indicators.values()
    }
    numbers["S"] = (screening.S.value, screening.S.low, screening.S.high)
    numbers["J"] = (screening.J.value, screening.J.low, screening.J.high)
    numbers["more"] = (screening.severity, screening.confidence, screening.seconds)
    for name, residual in screening.residuals.items():
        if residual is not None:
            numbers[name] = (residual.rmse, residual.normalised, residual.one_step)
    json.dumps(numbers, allow_nan=False)
    assert {"stiction", "narx", "baseline"} == set(screening.residuals)
    assert screening.quality.grade in "ABCD"
    assert 0.0 <= screening.severity <= 100.0
    assert (screening.confidence is None) == (screening.verdict is Verdict.UNDETERMINED)
    for sentence in (screening.reason, screening.advice, *screening.still_seen):
        assert sentence.endswith(".")
        assert not any(word in sentence.split() for word in ("None", "nan", "inf"))
    assert "broke down" not in screening.reason


def test_no_cases():
    """Nothing to screen gives nothing."""
    assert [] == screen([])


def test_sticky_and_healthy():
    """A sticking valve is called sticky with its S and J, a healthy slow one is not."""
    sticky, healthy = quick(plant(), plant(0.3, 0.0, 2.0, 1.0))
    consistent(sticky)
    consistent(healthy)
    assert Verdict.STICKY is sticky.verdict
    assert sticky.S.low <= 5.0 <= sticky.S.high
    assert Verdict.HEALTHY is healthy.verdict
    assert sticky.severity > healthy.severity


def test_traces_lie_on_the_clock():
    """The simulated positions have the recording's length, and the held-out part begins in it."""
    result = quick(plant())[0]
    assert len(result.recording) == result.traces.stiction.size
    assert result.traces.narx is None
    assert 0 < result.traces.heldout_from < len(result.recording)
    assert result.residuals["stiction"].rmse < 1.0


@pytest.mark.long
def test_a_screening_does_not_depend_on_the_other_cases():
    """Each valve gets the same result alone and among others, in the order of the cases."""
    recordings = [plant(), recorded([50.0]), plant(0.3, 0.0, 2.0, 1.0)]
    together = quick(*recordings)
    alone = [quick(recording)[0] for recording in recordings]
    assert [a.verdict for a in alone] == [t.verdict for t in together]
    assert [str(a.S) for a in alone] == [str(t.S) for t in together]


def test_a_valve_that_crashes_does_not_stop_the_others():
    """An error in one valve's science is that valve's result, with its kind and what to do."""
    unlike = Case(recording=plant(), baseline="no network at all")
    first, second = screen([unlike, Case(recording=plant())], QUICK)
    assert Verdict.UNDETERMINED is first.verdict
    assert "broke down on this recording (AttributeError" in first.reason
    assert "the other valves are not affected" in first.advice
    assert first.recording is plant()
    assert Verdict.STICKY is second.verdict


def test_unreadable_source():
    """A source that could not be read becomes a screening with the reader's sentence."""
    item = failed("FV-1", "no such file.", "Check the path.", Provenance(source="x.csv"))
    consistent(item)
    assert "Cannot tell: no such file." == item.reason
    assert (None, None) == item.window
    assert 0.0 == item.finite_share()


def test_no_position_still_says_something():
    """Without a position there is no verdict, and what was seen is told."""
    result = quick(recorded(plant().op.values))[0]
    consistent(result)
    assert Verdict.UNDETERMINED is result.verdict
    assert "there is no valve position" in result.reason
    assert result.S.reason == result.J.reason
    assert len(result.still_seen) >= 2


@pytest.mark.parametrize(
    ("S", "J", "verdict"),
    [
        (5.0, 2.0, Verdict.STICKY),
        pytest.param(0.3, 0.0, Verdict.HEALTHY, marks=pytest.mark.long),
    ],
)
def test_a_reversed_position_is_read_the_right_way_round(S, J, verdict):
    """A position that counts the other way gives the verdict of one that does not."""
    base = plant(S, J)
    mv = 100.0 - base.signals[Role.MV].values
    (result,) = quick(recorded(base.op.values, mv))
    assert verdict is result.verdict
    assert result.S.low <= S <= result.S.high


@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(seed, marks=pytest.mark.long) for seed in (1, 2, 3))]
)
def test_slow_healthy_valves_are_never_called_sticky(seed):
    """Lags and dead times of seconds, without friction to speak of, are never called sticky."""
    result = quick(plant(0.3, 0.05, 1.0 + seed, 0.5 * seed, seed))[0]
    consistent(result)
    assert Verdict.STICKY is not result.verdict


@pytest.mark.long
def test_baseline_is_compared():
    """The baseline network follows its own valve, and no longer the valve that began to stick."""
    healthy = plant(0.3, 0.0, 0.5)
    network = network_of(healthy)
    note = "Baseline of May."
    same, worse = screen(
        [
            Case(recording=plant(0.3, 0.0, 0.5, seed=2), baseline=network, baseline_note=note),
            Case(recording=plant(5.0, 2.0, 0.5, seed=2), baseline=network, baseline_note=note),
        ],
        QUICK,
    )
    consistent(same)
    consistent(worse)
    assert Verdict.HEALTHY is same.verdict
    assert same.baseline_note.startswith(note)
    ratio = [item.indicators["baseline_ratio"].value for item in (same, worse)]
    assert ratio[1] > 3.0 * ratio[0]
    assert worse.residuals["baseline"].rmse > same.residuals["baseline"].rmse


def test_baseline_of_another_interval_is_not_compared():
    """A baseline that cannot be compared costs nothing but the comparison, and says why."""
    network = replace(network_of(plant(0.3, 0.0, 0.5)), interval_s=5.0)
    result = screen([Case(recording=plant(), baseline=network, baseline_note="May.")], QUICK)[0]
    consistent(result)
    assert Verdict.STICKY is result.verdict
    assert result.residuals["baseline"] is None
    assert "May. Not compared: the baseline network was trained at" in result.baseline_note


def test_narx_gives_residual_trace_and_network():
    """With the network on, its residual, its trace and itself are part of the screening."""
    result = screen([Case(recording=plant())])[0]
    consistent(result)
    assert result.network is not None
    assert result.residuals["narx"].one_step <= result.residuals["narx"].rmse
    assert len(result.recording) == result.traces.narx.size


parts = st.sampled_from(["constant", "ramp", "walk", "sine", "noise", "huge", "nan", "holed", "op"])


@st.composite
def any_signal(draw, n, op=None):
    kind = draw(parts)
    result = np.random.default_rng(draw(st.integers(0, 9)))
    t = np.arange(float(n))
    values = {
        "constant": np.full(n, draw(st.sampled_from([0.0, 50.0, 3.5e-44, -7.0]))),
        "ramp": t / 10.0,
        "walk": 50.0 + np.cumsum(result.standard_normal(n)),
        "sine": 50.0 + 10.0 * np.sin(t / draw(st.sampled_from([0.5, 5.0, 50.0]))),
        "noise": 50.0 + result.standard_normal(n),
        "huge": result.standard_normal(n) * 10.0 ** draw(st.sampled_from([3, 30, 300])),
        "nan": np.full(n, np.nan),
        "holed": np.where(result.random(n) < 0.2, np.nan, 50.0 + np.sin(t / 9.0) * 8.0),
        "op": t if op is None else op + 0.1 * result.standard_normal(n),
    }[kind]
    if draw(st.booleans()) and n > 3:
        values = values.copy()
        values[draw(st.integers(0, n - 1))] = draw(st.sampled_from([np.nan, 0.0, 1e300, -1e300]))
    return values


@st.composite
def any_recording(draw):
    n = draw(st.sampled_from([0, 1, 2, 3, 17, 63, 250, 700]))
    op = draw(any_signal(n))
    mv = draw(st.none() | any_signal(n, op))
    return recorded(op, mv, interval_s=draw(st.sampled_from([0.05, 1.0, 60.0])))


@settings(max_examples=120, deadline=None)
@given(any_recording())
def test_any_recording_gives_a_finite_screening(recording):
    """Whatever a recording holds, the screening is consistent, finite and without a breakdown."""
    consistent(quick(recording)[0])


@pytest.mark.long
@pytest.mark.recordings
def test_a_real_rate_limited_valve_is_not_sticky(recordings):
    """S and J alone read 8 % and more out of a healthy valve that closes slowly; the verdict does
    not fall for it."""
    frame = pd.read_csv(recordings / "damadics" / "lublin_actuator3_one_hour.csv")
    result = quick(recorded(frame["LC74_20CV_pct"], frame["LC74_20X_pct"], valve="LC74_20"))[0]
    consistent(result)
    assert result.indicators["naive_S_percent"].value > 8.0
    assert result.S.value < 2.0
    assert Verdict.STICKY is not result.verdict


@pytest.mark.long
def test_the_scans_of_both_tags_stand_among_the_decisions():
    """A position that is scanned slowly is said beside OP's own scan, and nothing of it else."""
    base = plant()
    mv = base.signals[Role.MV].values[np.arange(len(base)) // 3 * 3]
    slow = replace(base, signals={**base.signals, Role.MV: Signal.good(mv, "ZT")})
    plain, scanned = quick(base, slow)
    sentences = [decision for decision in scanned.provenance.decisions if "scan" in decision]
    assert sentences == ["OP changes every 1 s, the position every 3 s: each has its own scan."]
    assert not any("scan" in decision for decision in plain.provenance.decisions)


@pytest.mark.parametrize("lag_s", [0.1, 1.0, 3.0])
def test_a_position_that_moves_first_is_doubted_where_no_controller_tells(lag_s):
    """OP and position of a healthy valve exchanged, without PV: an OP that is stored late looks
    so as well. No sure verdict, and nothing is named that a command cannot have."""
    recording = plant(S=0.3, J=0.0, lag_s=lag_s)
    exchanged = recorded(recording.signals[Role.MV].values, recording.op.values)
    (screening,) = screen([Case(recording=exchanged)], Options(narx=False))
    assert (screening.verdict, screening.confidence) == (Verdict.HEALTHY, 0.5)
    assert "before OP" in screening.reason
    assert screening.mismatch is not None
    assert not screening.mismatch.effects


def test_a_dead_band_on_ramps_of_one_speed_is_no_lag():
    """On ramps of one speed a lag of some seconds can stand for most of a dead band."""
    seconds = np.arange(1800.0)
    op = 50.0 + 15.25 * 2.0 / np.pi * np.arcsin(np.sin(2.0 * np.pi * seconds / 183.4))
    stem, pressure, position = np.empty(op.size), op[0], op[0]
    for k, command in enumerate(np.concatenate((op[:1], op[:-1]))):  # a sample late
        pressure += (command - pressure) * (1.0 - np.exp(-1.0 / 0.4))
        position = min(max(position, pressure - 2.0), pressure + 2.0)
        stem[k] = position
    (valve,) = quick(recorded(op, stem + 0.04 * np.random.default_rng(4).standard_normal(op.size)))
    assert valve.verdict is Verdict.STICKY
    assert valve.S.low <= 4.0 <= valve.S.high


@pytest.mark.parametrize("breakaways", [None, object()])
def test_a_lag_that_the_whole_record_does_not_need_is_doubted(breakaways):
    """S of a fit with a lag contradicts that of the explained record: the lag is doubted, also
    where S was read from breakaways with it."""
    near, far = (
        Stiction(
            S=Estimate(value=S, low=S - 0.4, high=S + 0.4, unit="%"),
            J=Estimate(value=0.5, low=0.0, high=1.0, unit="%"),
        )
        for S in (1.5, 4.0)
    )
    fit = SimpleNamespace(hypothesis="both", breakaways=breakaways)
    for restated, doubted in ((near, False), (far, True)):
        explained = SimpleNamespace(finding=Finding.NONE, restated=restated)
        valve = SimpleNamespace(fit=fit, archive=None)
        assert lag_is_doubtful(valve, explained, near.S, near.J) is doubted
