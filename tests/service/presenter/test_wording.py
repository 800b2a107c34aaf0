"""How times are written for a reader."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from zoneinfo import ZoneInfo

import pytest

from stemwatch.service.presenter.wording import instant, window

BERLIN = ZoneInfo("Europe/Berlin")
FIRST = datetime(2026, 10, 25, 0, 30, tzinfo=UTC)  # 02:30 in Berlin, and an hour later again


def test_a_minute_that_clocks_show_twice_has_its_offset() -> None:
    """A window over the end of summer time would else begin and end at the same minute."""
    later = FIRST + timedelta(hours=1)
    assert instant(FIRST, BERLIN) == "2026-10-25 02:30 UTC+02:00"
    assert instant(later, BERLIN) == "2026-10-25 02:30 UTC+01:00"
    assert window(FIRST, later, BERLIN, "Europe/Berlin") == (
        "2026-10-25 02:30 UTC+02:00 to 02:30 UTC+01:00 (Europe/Berlin)"
    )


@pytest.mark.parametrize("hours", [-1, 2, 24])
def test_other_times_have_none(hours: int) -> None:
    """The caller names the zone."""
    moment = FIRST + timedelta(hours=hours)
    assert instant(moment, BERLIN) == f"{moment.astimezone(BERLIN):%Y-%m-%d %H:%M}"
