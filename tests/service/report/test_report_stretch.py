"""The stretch on which a valve's plots open: typical, held out, and there sample by sample."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stemwatch.models.estimate import Estimate
from stemwatch.models.record_checks.data_quality import DataQuality
from stemwatch.models.recording import Recording, Role, Signal
from stemwatch.models.screening_result import Screening, Traces
from stemwatch.models.verdict import Verdict
from stemwatch.service.report.charts.thinning import POINTS
from stemwatch.service.report.charts.traces import unpacked
from stemwatch.service.report.charts.typical_stretch import typical_stretch
from stemwatch.service.report.charts.valve_charts import chart_of

CYCLE = 40


def cycling(samples: int = 7200, heldout: int | None = 4800, error=0.1, **signals) -> Screening:
    """A triangle of OP of one cycle in 40 samples; the model misses MV by ``error`` (n,) or one."""
    phase = np.arange(samples) % CYCLE
    op = 50.0 + 4.0 * np.abs(phase - CYCLE / 2) / (CYCLE / 2)
    mv = op + 0.5
    roles = {Role.OP: op, Role.MV: mv} | {Role(name): item for name, item in signals.items()}
    unknown = Estimate.unknown("made up", "%")
    return Screening(
        valve="FV-1",
        verdict=Verdict.STICKY,
        reason="made up",
        advice="none",
        shape=None,
        severity=50.0,
        confidence=0.9,
        S=unknown,
        J=unknown,
        residuals={},
        quality=DataQuality(grade="A"),
        indicators={},
        traces=Traces(stiction=mv - error, heldout_from=heldout),
        recording=Recording(
            valve="FV-1",
            signals={role: Signal.good(item, role.value) for role, item in roles.items()},
            interval_s=0.5,
        ),
    )


def turns(op: np.ndarray) -> int:
    slope = np.sign(np.diff(op))
    return int(np.count_nonzero(np.diff(slope[slope != 0])))


def test_the_stretch_holds_eight_reversals_of_the_held_out_part():
    """Four cycles with a little before and after, all of it where no model was fitted."""
    valve = cycling()
    stretch = typical_stretch(valve)
    assert stretch is not None
    assert stretch.first >= 4800
    assert turns(valve.recording.op.values[stretch.first : stretch.last]) == 8
    assert 3.5 * CYCLE < stretch.last - stretch.first < 4.5 * CYCLE
    assert "8 reversals of OP in the held-out part" in stretch.why


def test_the_stretch_is_neither_the_best_nor_the_worst():
    """Where the model is good, then ordinary, then bad, the ordinary third is chosen and said."""
    error = np.full(7200, 0.1)
    error[5600:6400] = 0.4
    error[6400:] = 2.0
    stretch = typical_stretch(cycling(error=error))
    assert stretch is not None
    assert 5600 <= stretch.first < stretch.last <= 6400
    assert "misses MV by 0.40 % rmse here, 0.40 % in the middle one of" in stretch.why


def test_with_few_held_out_reversals_the_whole_record_is_searched():
    """Half a cycle held out shows no cycle; the stretch then says nothing of being held out."""
    stretch = typical_stretch(cycling(heldout=7180))
    assert stretch is not None
    assert stretch.last <= 7180
    assert "held-out" not in stretch.why


def test_a_stretch_avoids_what_is_missing():
    """Candidates with more than a fifth of MV missing are not typical of anything."""
    mv = 50.5 + np.zeros(7200)
    mv[4800:7000] = np.nan
    stretch = typical_stretch(cycling(mv=mv))
    assert stretch is not None
    part = mv[stretch.first : stretch.last]
    assert np.isfinite(part).mean() >= 0.8


def test_without_a_model_the_swing_of_op_says_what_is_typical():
    """An undetermined valve has a stretch too, chosen by OP, where OP cycles."""
    valve = replace(cycling(), traces=Traces())
    stretch = typical_stretch(valve)
    assert stretch is not None
    assert "OP swings over 4.0 % here, 4.0 % in the middle one of" in stretch.why


def test_the_only_stretch_is_not_called_typical():
    """Five reversals held out leave nothing to compare with, and the page says so."""
    stretch = typical_stretch(cycling(heldout=7200 - 3 * CYCLE + 5))
    assert stretch is not None
    assert stretch.why.startswith("The only stretch with 5 reversals of OP in the held-out part; ")
    assert stretch.name == "A stretch"


@pytest.mark.parametrize(
    "op",
    [np.full(3000, 41.0), np.full(3000, np.nan), np.linspace(20, 80, 3000), np.array([41.0])],
    ids=["still", "missing", "ramp", "one sample"],
)
def test_where_op_does_not_turn_round_the_whole_record_is_shown(op):
    """No reversals, no stretch: closer would tell less."""
    valve = replace(cycling(), traces=Traces())
    signals = {Role.OP: Signal.good(op, "op")}
    valve = replace(valve, recording=replace(valve.recording, signals=signals))
    assert typical_stretch(valve) is None


def test_a_stretch_that_is_most_of_the_record_is_no_stretch():
    """Five reversals in a record of six are the record."""
    assert typical_stretch(cycling(samples=3 * CYCLE, heldout=None)) is None


@settings(max_examples=60, deadline=None)
@given(
    samples=st.integers(1, 300),
    holes=st.sampled_from([0.0, 0.2, 0.9]),
    heldout=st.one_of(st.none(), st.integers(0, 300)),
    seed=st.integers(0, 2**32 - 1),
)
def test_a_stretch_always_lies_in_its_record(samples, holes, heldout, seed):
    """Whatever OP did, the stretch has samples, and all of them are the record's; where OP turns
    round all the time there is one."""
    rng = np.random.default_rng(seed)
    values = np.where(rng.random(samples) < holes, np.nan, rng.uniform(0.0, 100.0, samples))
    signals = {Role.OP: Signal.good(values, "op"), Role.MV: Signal.good(values, "mv")}
    valve = cycling()
    traces = Traces(stiction=values + 1.0, heldout_from=heldout)
    valve = replace(valve, traces=traces, recording=replace(valve.recording, signals=signals))
    stretch = typical_stretch(valve)
    if stretch is not None:
        assert 0 <= stretch.first < stretch.last <= values.size
    else:
        assert samples < 100 or holes > 0.0


def test_every_sample_of_the_stretch_is_in_the_page():
    """The record is thinned; of the stretch each sample of each trace is kept at its time."""
    valve = cycling()
    stretch, chart = typical_stretch(valve), chart_of(valve)
    assert stretch is not None
    assert chart is not None
    assert chart["thinned"] > 1
    expected = np.arange(stretch.first, stretch.last)
    np.testing.assert_array_equal(unpacked(chart["detail"]), expected)
    assert chart["stretch"]["from"] == 0.5 * stretch.first
    assert chart["stretch"]["to"] == 0.5 * (stretch.last - 1)
    mv = chart["panels"][0]["series"][1]
    assert mv["role"] == "mv"
    np.testing.assert_allclose(
        unpacked(mv["detail"]), valve.recording.mv.values[expected], atol=5e-4
    )


def test_a_record_drawn_whole_needs_no_detail():
    """Up to the plots' resolution every sample is there anyway; the stretch is only a window."""
    chart = chart_of(cycling(samples=POINTS, heldout=1000))
    assert chart is not None
    assert chart["thinned"] == 1
    assert chart["detail"] is None
    assert chart["stretch"] is not None


def slow(samples: int, cycle: int) -> Screening:
    """Cycles of many samples, without a held-out part."""
    phase = np.arange(samples) % cycle
    op = 50.0 + 4.0 * np.abs(phase - cycle / 2) / (cycle / 2)
    valve = cycling(samples=samples, heldout=None, op=op, mv=op + 0.5)
    return replace(valve, traces=Traces(stiction=op + 0.4))


def test_a_stretch_of_slow_cycles_is_thinned_to_the_plots_resolution():
    """Cycles of a thousand samples do not fill the page; each kept point is one instant."""
    valve = slow(40_000, 1000)
    chart = chart_of(valve)
    assert chart is not None
    places = unpacked(chart["detail"]).astype(int)
    assert 200 < places.size <= POINTS
    values = unpacked(chart["panels"][0]["series"][0]["detail"])
    np.testing.assert_allclose(values, valve.recording.op.values[places], atol=5e-4)


def test_the_stretch_is_never_drawn_coarser_than_the_record_around_it():
    """Half a record of very slow cycles is a window on the whole record's points."""
    chart = chart_of(slow(40_000, 5000))
    assert chart is not None
    assert chart["stretch"] is not None
    assert chart["detail"] is None
    assert "detail" not in chart["panels"][0]["series"][0]


def test_the_stretch_of_a_model_of_another_length_is_refused_by_name():
    """The message names both lengths rather than failing inside the choice of a stretch."""
    valve = cycling()
    valve = replace(valve, traces=replace(valve.traces, stiction=np.zeros(99)))
    with pytest.raises(ValueError, match=r"expected a trace of 7200 samples, received \(99,\)"):
        chart_of(valve)
