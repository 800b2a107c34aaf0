"""Findings that do not stand among all valves of a run: marked once, and no alert comes of them."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from stemwatch.models.estimate import Estimate
from stemwatch.models.mismatch.findings import Effect, EffectEvidence, Finding, Mismatch, Stiction
from stemwatch.models.record_checks.data_quality import DataQuality
from stemwatch.models.recording import Recording, Role, Signal
from stemwatch.models.screening_result import Screening
from stemwatch.models.verdict import Verdict
from stemwatch.service.alerts.evaluate import awaiting_aftermath, evaluate, gathered
from stemwatch.service.alerts.when_over import WINDOWS_BACK
from stemwatch.service.config import Plant
from stemwatch.service.presenter.finding import present_effect
from stemwatch.service.run.finish import hold_back, p_elsewhere
from stemwatch.service.store.alerts.alerts import AlertKind
from stemwatch.service.store.runs.queue import RunToQueue
from stemwatch.service.store.screenings.records import ValveState
from stemwatch.service.store.store import Store
from tests.service.alerts.conftest import plant_of
from tests.service.open_alerts import open_alerts

START = datetime(2026, 3, 2, tzinfo=UTC)
S = Estimate(value=2.0, low=1.8, high=2.2, unit="%")
EFFECT = Effect(
    slug="lost_motion", members=("lost_motion",), sentence="There is play.", where="",
    check="Look.", decide="", parameters={}, evidence=EffectEvidence(mean=0.2, t=5.0, share=0.4),
)  # fmt: skip
BOTH = Stiction(S=S, J=Estimate.unknown("few"))
PLAIN = Mismatch(finding=Finding.NONE, sentence="", naive=BOTH, restated=BOTH)
BLIND = replace(PLAIN, finding=Finding.NOT_TESTABLE)


def named(p_value: float | None) -> Mismatch:
    """Play, as probable as this by chance."""
    return replace(PLAIN, finding=Finding.NAMED, effects=(EFFECT,), p_value=p_value)


def screened(valve: str, hour: int, mismatch: Mismatch | None) -> Screening:
    """A healthy valve's screening of one hour."""
    start = START + timedelta(hours=hour)
    op = Signal.good(np.zeros(60), "OP")
    recording = Recording(valve=valve, signals={Role.OP: op}, interval_s=60.0, start=start)
    return Screening(
        valve=valve, verdict=Verdict.HEALTHY, reason="", advice="Check.", shape=None, severity=5.0,
        confidence=0.9, S=S, J=Estimate.unknown("few"), residuals={},
        quality=DataQuality(grade="A"), indicators={}, recording=recording, mismatch=mismatch,
    )  # fmt: skip


@pytest.fixture
def plant(tmp_path: Path) -> Plant:
    """Twenty valves of one source."""
    text = '[[sources]]\nname = "s"\npath = "*.csv"\n'
    for n in range(20):
        text += f'[[valves]]\nid = "V{n:02}"\nsource = "s"\n[valves.tags.op]\ntag = "OP{n}"\n'
    return plant_of(text, tmp_path)


def run(store: Store, plant: Plant, hour: int, result: dict[str, Mismatch | None]) -> int:
    """A run over all valves; what is not in ``found`` shows nothing beside stiction."""
    number = store.queue.put(RunToQueue(), software_version="1")
    store.queue.claim("w")
    store.queue.plan(number, plant.valves)
    for valve in plant.valves:
        store.save(screened(valve, hour, result.get(valve, PLAIN)), number)
        store.queue.mark(number, valve, ValveState.DONE)
    return number


def test_what_chance_may_have_named_is_marked(either_store: Store, plant: Plant) -> None:
    """Benjamini-Hochberg over all that was tested: 0.001 stands among twenty, 0.04 does not, nor
    what has no p value; the mark says so in words and outlives a second look."""
    store = either_store
    results = {
        "V01": named(0.001),
        "V02": named(0.04),
        "V03": named(None),
        "V04": BLIND,
        "V05": None,
    }
    number = run(store, plant, 0, results)
    tested = hold_back(store, number)
    assert len(tested) == 18
    assert hold_back(store, number) == tested
    remarks = {valve: store.screenings(valve)[0].held_back for valve in plant.valves}
    assert {valve for valve, text in remarks.items() if text} == {"V02", "V03"}
    assert "across 18 valves chance alone may have named this" in remarks["V02"]
    mismatch = store.screenings("V02")[0].mismatch
    assert (mismatch.finding, mismatch.p_value) == (Finding.NAMED, 0.04)
    assert p_elsewhere(tested, [f"V{n:02}" for n in range(2, 20)]) == (None, 0.001)


def test_a_finding_that_comes_to_stand_loses_its_mark(either_store: Store, plant: Plant) -> None:
    """The same window screened again with stronger evidence is judged anew."""
    hold_back(either_store, run(either_store, plant, 0, {"V02": named(0.04)}))
    assert either_store.screenings("V02")[0].held_back
    hold_back(either_store, run(either_store, plant, 0, {"V02": named(0.0001)}))
    assert either_store.screenings("V02")[0].held_back == ""


def test_no_alert_comes_of_what_is_held_back(either_store: Store, plant: Plant) -> None:
    """One window is none, whatever it names; of what windows agree on, that which chance does not
    explain among all valves is an alert, and what it explains is none."""
    store = either_store
    for hour in range(4):
        results = {"V01": named(0.001), "V02": named(0.3)}
        if hour == 2:
            results["V03"] = named(1e-6)
        number = run(store, plant, hour, results)
        hold_back(store, number)
        evaluate(store, plant, number)
        if hour == 0:
            assert open_alerts(store) == []
    (alert,) = open_alerts(store)
    assert (alert.kind, alert.valve) == (AlertKind.MISMATCH, "V01")
    assert alert.text.startswith("V01: There is play. Lost motion: first seen on ")
    assert "confirmed in 4 of 4 windows" in alert.text  # of the newest window
    assert f"{alert.first_step} {alert.then}" == present_effect(EFFECT).check


@pytest.mark.long
def test_many_valves_are_gathered_as_one_by_one(either_store: Store, plant: Plant) -> None:
    """What the rules see of each valve is what the store says of it alone: the last screenings
    newest first, S at the baseline, the ratios, and the words of the newest finding."""
    store = either_store
    for hour in range(10):
        number = run(store, plant, hour, {"V01": named(0.001), "V07": named(0.9)})
        hold_back(store, number)
    window = store.screenings("V03")[5].window
    store.set_baseline("V03", b"x", window=window, reason="healthy")
    store.set_baseline("V04", b"x", window=(None, None), reason="healthy")
    for seen in gathered(store, plant, list(plant.valves)):
        valve = seen.valve.id
        alone = store.screenings(valve, WINDOWS_BACK)
        assert [item.id for item in seen.screenings] == [item.id for item in alone]
        assert [item.window for item in seen.screenings] == [item.window for item in alone]
        assert seen.screenings[0].named is (valve == "V01")
        assert (seen.screenings[0].mismatch is None) is (valve not in ("V01", "V07"))
        assert (seen.at_baseline == S) is (valve == "V03")
    assert [seen.valve.id for seen in gathered(store, plant, ["unknown"])] == ["unknown"]


def test_only_work_that_nothing_was_said_of_is_looked_at(either_store: Store, plant: Plant) -> None:
    """A valve without work, or whose last work was compared already, costs no look of its own."""
    store = either_store
    store.save_valves(plant.valves.values())
    for valve, hour in (("V01", 1), ("V02", 1), ("V02", 3)):
        store.record_maintenance(valve, START + timedelta(hours=hour), "packing", "Ann")
    valves = list(plant.valves)
    assert awaiting_aftermath(store, valves) == ["V01", "V02"]
    store.add_note("V01", START + timedelta(hours=1), "It helped.", "stemwatch")
    store.add_note("V02", START + timedelta(hours=1), "It helped.", "stemwatch")
    store.add_note("V02", START + timedelta(hours=3), "by hand", "Ann")
    assert awaiting_aftermath(store, valves) == ["V02"]
