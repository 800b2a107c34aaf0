"""What is said after work on a valve."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from types import SimpleNamespace
from typing import Any
from zoneinfo import ZoneInfo

from stemwatch.models.estimate import Estimate
from stemwatch.models.verdict import Verdict
from stemwatch.service.alerts.after_maintenance import compare

LATE = datetime(2026, 3, 2, 23, 30, tzinfo=UTC)  # the day after in Berlin


def screened(at: datetime, S: float) -> Any:
    estimate = Estimate(value=S, low=0.9 * S, high=1.1 * S, unit="%")
    hour = timedelta(hours=1)
    return SimpleNamespace(verdict=Verdict.WATCH, window=(at, at + hour), S=estimate)


def test_work_has_the_day_that_the_plant_calls_it() -> None:
    """The log of the valve's page has the local day beside it."""
    windows = [screened(LATE + timedelta(days=1), 0.5), screened(LATE - timedelta(days=1), 4.0)]
    work: Any = SimpleNamespace(at=LATE, note="packing renewed")
    said = compare(windows, work, ZoneInfo("Europe/Berlin"))
    assert said is not None
    assert said.startswith("After the work of 2026-03-03 (packing renewed): It helped")
