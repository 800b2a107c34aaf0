"""What is said of results that could not be saved."""

from __future__ import annotations

import sqlite3
from datetime import timedelta
from pathlib import Path

from stemwatch.connectors.connector import ValveTags
from stemwatch.service.run.saving import PlacedScreening, Saving
from stemwatch.service.run.spill import ResultSpill
from stemwatch.service.run.task import Task
from stemwatch.service.store.store import open_store
from tests.models.narx.test_narx_network import network
from tests.service.web.example_plant import NOW, STICKY, screening

WEEK = timedelta(days=7)


def test_a_window_that_cannot_be_saved_costs_no_other_of_its_valve(tmp_path: Path) -> None:
    """The reason is given once, and the network of the window that was saved is kept."""
    path = tmp_path / "kept.db"
    windows = [
        screening(STICKY, at=NOW - WEEK, network=network()),
        screening(STICKY, at=NOW, network=network(), severity=66.0),
    ]
    tasks = [Task(path="exports", tags=ValveTags(valve=STICKY, tags={})) for _ in windows]
    with open_store(f"sqlite:///{path}") as store:
        with sqlite3.connect(path) as raw:
            raw.execute(
                "CREATE TRIGGER refused BEFORE INSERT ON screenings WHEN NEW.severity = 66.0 "
                "BEGIN SELECT RAISE(ABORT, 'refused'); END"
            )
        raw.close()
        saving = Saving(store, store.begin_run(software_version="1"), NOW, tasks)
        saving.take(
            [PlacedScreening(task_index=n, screening=one) for n, one in enumerate(windows)],
            ResultSpill(len(windows)),
        )
        assert [(valve, reason) for valve, reason in saving.not_saved] == [
            (STICKY, "not saved: refused")
        ]
        assert [one.severity for one in store.screenings(STICKY)] == [windows[0].severity]
        baseline = store.baseline(STICKY)
    assert baseline is not None
    assert baseline.window == windows[0].window
