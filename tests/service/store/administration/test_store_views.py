"""The views that other programs read: their columns are a promise, on both engines the same."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest
from sqlalchemy import inspect, text

from stemwatch.models.verdict import Verdict
from stemwatch.service.presenter.work_decision import Ne107, ne107_word
from stemwatch.service.run.finish import hold_back
from stemwatch.service.store.migrations import views_v1, views_v2
from stemwatch.service.store.screenings.ranking import RankingFilter
from stemwatch.service.store.store import Store
from tests.service.maintenance.example_work_list import with_effects
from tests.service.presenter.every_kind import by_chance
from tests.service.report.conftest import screening
from tests.service.store.older_databases import AT_US, database_at
from tests.service.web.example_plant import STICKY, fill, write_samples

NAMES = views_v1.NAMES + views_v2.NAMES
STORAGE = Path(__file__).parents[4] / "docs" / "storage.md"
COLUMNS = {
    "stemwatch_valves_v1": "valve description area criticality",
    "stemwatch_runs_v1": (
        "run_id state schedule started finished valves_total valves_done valves_set_aside reason "
        "software_version"
    ),
    "stemwatch_screenings_v1": (
        "screening_id run_id valve area criticality at window_start window_end verdict severity "
        "confidence grade shape s_percent s_low_percent s_high_percent j_percent j_low_percent "
        "j_high_percent reason advice mismatch_finding software_version"
    ),
    "stemwatch_indicators_v1": (
        "screening_id valve area criticality at indicator value low high unit"
    ),
    "stemwatch_alerts_v1": (
        "alert_id kind severity valve area source text opened seen closed closed_why is_open "
        "acknowledged acknowledged_by snoozed_until is_false_alarm run_id"
    ),
    "stemwatch_tags_v1": "source tag unit",
    "stemwatch_samples_v1": "source tag unit at_us at value quality quality_name reason",
    "stemwatch_valves_v2": "valve description site area unit loop criticality",
    "stemwatch_screenings_v2": (
        "screening_id run_id valve site area unit loop criticality at window_start window_end "
        "verdict ne107 stem_verdict severity confidence grade shape s_percent s_low_percent "
        "s_high_percent j_percent j_low_percent j_high_percent reason advice mismatch_finding "
        "software_version"
    ),
    "stemwatch_alerts_v2": (
        "alert_id kind severity valve site area unit loop source text opened seen closed "
        "closed_why is_open acknowledged acknowledged_by snoozed_until is_false_alarm run_id"
    ),
}


def test_the_columns_of_a_version_never_change(store: Store) -> None:
    """Names and order of every column, as the first release of the views had them."""
    with store.transactions.reading() as session:
        inspector = inspect(session.connection())
        results = {
            name: " ".join(column["name"] for column in inspector.get_columns(name))
            for name in inspector.get_view_names()
            if name.startswith("stemwatch_")
        }
    assert results == COLUMNS
    assert tuple(COLUMNS) == NAMES


@pytest.mark.parametrize("view", COLUMNS)
def test_every_column_is_documented(view: str) -> None:
    """docs/storage.md has a section for each view and a row for each of its columns."""
    section = STORAGE.read_text("utf-8").split(f"### {view}\n")[1].split("\n#")[0]
    rows = [line.split("|")[1] for line in section.splitlines() if line.startswith("| `")]
    described = re.findall(r"`([a-z_0-9]+)`", " ".join(rows))
    assert described == COLUMNS[view].split()


def test_the_views_show_what_the_store_holds(store: Store) -> None:
    """A plant with months behind it: each view has its rows, with the store's own numbers."""
    fill(store, months=1)
    write_samples(store, hours=0.1)
    with store.transactions.reading() as session:
        counts = {
            name: session.execute(text(f"SELECT count(*) FROM {name}")).scalar() for name in NAMES
        }
        indicators = session.execute(text("SELECT count(*) FROM indicators")).scalar()
        latest = session.execute(
            text(
                "SELECT verdict, s_percent, area FROM stemwatch_screenings_v1 "
                "WHERE valve = :valve ORDER BY at DESC LIMIT 1"
            ),
            {"valve": STICKY},
        ).one()
    assert counts.pop("stemwatch_indicators_v1") == indicators > 0
    assert counts == {
        "stemwatch_valves_v1": 5,
        "stemwatch_runs_v1": 2,
        "stemwatch_screenings_v1": 10,
        "stemwatch_alerts_v1": 2,
        "stemwatch_tags_v1": 2,
        "stemwatch_samples_v1": 720,
        "stemwatch_valves_v2": 5,
        "stemwatch_screenings_v2": 10,
        "stemwatch_alerts_v2": 2,
    }
    assert latest == ("sticky", store.screenings(STICKY)[0].S.value, "Area 100")


@pytest.mark.parametrize(
    ("engine", "shown"),
    [
        ("sqlite", "2026-03-01 06:00:00.000000"),
        pytest.param("postgresql", "2026-03-01 06:00:00+00", marks=pytest.mark.postgres),
    ],
)
def test_a_sample_is_shown_with_its_instant_and_its_reason(
    new_database: Callable[[str], str], engine: str, shown: str
) -> None:
    """Microseconds become a time in the form that the database's other times have."""
    with database_at(new_database(engine), "0013") as created, created.connect() as connection:
        if engine == "postgresql":
            connection.execute(text("SET TIME ZONE 'UTC'"))
        rows = connection.execute(
            text(
                "SELECT at_us, CAST(at AS text), value, quality_name, reason "
                "FROM stemwatch_samples_v1 ORDER BY at"
            )
        ).all()
    assert rows[0] == (AT_US, shown, 41.25, "good", None)
    assert rows[1][2:] == (None, "bad", "sample_reasons words 1 ü")


def test_the_view_has_the_state_of_every_output(store: Store) -> None:
    """``verdict`` and ``ne107`` of the view are those of the ranking, whatever S and J say alone;
    no verdict is no state."""
    valves = [
        screening("FIC-1", S=6.0),
        screening("FIC-2", Verdict.WATCH, S=1.0),
        screening("FIC-3", Verdict.HEALTHY, S=0.1),
        with_effects("FIC-4", Verdict.HEALTHY),
        by_chance("FIC-5"),
        screening("PIC-6", Verdict.UNDETERMINED),
    ]
    number = store.begin_run(software_version="1")
    for one in valves:
        store.save(one.without_samples(), number)
    hold_back(store, number)
    store.finish_run(number)
    lines = {line.valve: line.verdict for line in store.ranking(RankingFilter()).lines}
    with store.transactions.reading() as session:
        rows = session.execute(
            text("SELECT valve, verdict, ne107, stem_verdict FROM stemwatch_screenings_v2")
        ).all()
    assert {row.valve: row.verdict for row in rows} == {
        valve: verdict.value for valve, verdict in lines.items() if verdict
    }
    assert {row.valve: row.ne107 for row in rows} == {
        valve: ne107_word(verdict) for valve, verdict in lines.items()
    }
    by_valve = {row.valve: row for row in rows}
    assert (by_valve["FIC-4"].verdict, by_valve["FIC-4"].stem_verdict) == ("defective", "healthy")
    assert by_valve["FIC-4"].ne107 == Ne107.OUT_OF_SPECIFICATION.value
    assert by_valve["PIC-6"].ne107 is None
