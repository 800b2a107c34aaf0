"""Months of a simulated plant: through the real run, and counted against what happened."""

from __future__ import annotations

import json

import pytest

from stemwatch.models.studies.simulator.valve_life import IN_TURN, Life, draw_lives
from stemwatch.service.executors import InProcess
from stemwatch.service.store.alerts.alerts import AlertKind
from stemwatch.service.studies.alert_trial import AlertPlan, Played, PlayedAlert, play

DAYS = 90
LIVES = tuple(draw_lives(len(IN_TURN), DAYS, 5151))
WEARS = next(life for life in LIVES if life.life is Life.WEARS)
REPAIRED = next(life for life in LIVES if life.life is Life.REPAIRED)
HEALTHY = next(life for life in LIVES if life.life is Life.STEADY)


def alert(life, raised, *, has_cause=True, closed=None, kind=AlertKind.STICKY):
    return PlayedAlert(
        cause=f"{kind.value}:{life.tag}",
        kind=kind,
        valves=(life.tag,),
        raised=raised,
        has_cause=has_cause,
        text="",
        closed=closed,
    )


def played(*alerts):
    return Played(plan=AlertPlan(days=DAYS, valves=len(LIVES)), lives=LIVES, alerts=alerts)


def test_alerts_without_a_cause_are_counted_by_kind_and_per_healthy_month():
    """Months of a worn valve before it wears count as healthy ones."""
    result = played(alert(HEALTHY, 5, has_cause=False), alert(WEARS, 2, has_cause=False))
    assert result.false_by_kind() == {"sticky": 2}
    healthy = sum(not life.has_cause(day) for life in LIVES for day in range(DAYS))
    assert result.healthy_months == pytest.approx(healthy / (365.25 / 12))
    assert f"2 alerts without a cause in {result.healthy_months:.1f}" in result.lines()[0]


def test_days_from_the_crossing_to_the_alert():
    """An alert before the crossing is in time; a valve without one is named so."""
    result = played(alert(WEARS, WEARS.crosses + 2), alert(REPAIRED, REPAIRED.crosses - 1))
    delays = result.delays()
    assert (delays[WEARS.tag], delays[REPAIRED.tag]) == (2, 0)
    assert delays[next(life.tag for life in LIVES if life.life is Life.STEPS)] is None
    assert HEALTHY.tag not in delays
    assert "2 of 6 valves that crossed their limit were alerted within 3" in result.lines()[1]


def test_two_alerts_of_one_cause_are_doubled():
    """A cause that had none does not count."""
    result = played(
        alert(WEARS, 40), alert(WEARS, 41, kind=AlertKind.MISMATCH), alert(REPAIRED, 40)
    )
    assert result.alerts_per_cause() == pytest.approx(1.5)
    assert played().alerts_per_cause() is None


def test_what_closes_by_itself_after_a_repair():
    """With the days it took; one that stays open is counted as such."""
    day = REPAIRED.repaired
    result = played(alert(REPAIRED, day - 3, closed=day + 3), alert(REPAIRED, day - 2))
    assert result.closed_after_repair() == (1, 2, 3)


@pytest.mark.long
def test_a_small_plant_runs_through_schedule_run_store_and_rules(tmp_path):
    """A valve that sticks all the time is alerted from the second window on, one that is healthy
    is not; each day is a run of the schedule."""
    result = play(
        AlertPlan(valves=2, days=3, window_s=900.0, seed=5151, workers=1), tmp_path, InProcess()
    )
    assert [life.life for life in result.lives] == [Life.STEADY, Life.WEARS]
    assert result.false_alerts == ()
    from stemwatch.service.config import load_plant
    from stemwatch.service.store.store import open_store

    plant = load_plant(tmp_path / "plant.toml", environment={})
    with open_store(plant.storage) as store:
        runs = [store.run(number) for number in (1, 2, 3)]
        assert [run.schedule for run in runs] == ["daily"] * 3
        assert [run.done for run in runs] == [2, 2, 2]
        assert [run.due.day for run in runs] == [7, 8, 9]
        assert len(store.screenings(result.lives[0].tag)) == 3


@pytest.mark.long
def test_the_command_prints_its_counts(stemwatch, tmp_path):
    """And writes every alert."""
    file = tmp_path / "alerts.json"
    outcome = stemwatch(
        "alert-trial", "--valves", 1, "--days", 2, "--window-s", 900, "--workers", 1,
        "--seed", 5151, "--json", file,
    )  # fmt: skip
    assert outcome.status == 0, outcome.said
    assert "Seed 5151 was looked at" in outcome.said
    assert "0 alerts without a cause" in outcome.said
    assert json.loads(file.read_text("utf-8"))["days"] == 2
