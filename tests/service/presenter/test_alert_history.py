"""What people are told of an alert beside its text."""

from __future__ import annotations

from datetime import UTC

import pytest

from stemwatch.service.presenter.alert_history import S_since_raised, kind_words, opened_again
from stemwatch.service.store.alerts.alerts import AlertKind


@pytest.mark.parametrize("kind", AlertKind)
def test_every_kind_of_alert_has_words(kind: AlertKind) -> None:
    """Its name in the database is not shown."""
    words = kind_words(kind.value)
    assert words != kind.value
    assert "_" not in words


def test_a_kind_of_another_version_is_shown_as_it_is_stored() -> None:
    """Without its underscores."""
    assert kind_words("of_a_later_version") == "of a later version"


@pytest.mark.parametrize(("count", "said"), [(1, ": the same"), (2, ", 2 times by now: the same")])
def test_an_alert_says_how_often_it_was_opened_again(count: int, said: str) -> None:
    """The first time needs no number."""
    once = {"again": "2026-03-02T08:00:00+00:00", "closed": "2026-03-01T08:00:00+00:00", "why": ""}
    sentence = opened_again({"reopened": [once] * count}, UTC, "UTC")
    assert sentence.startswith(f"Opened again 2026-03-02 08:00 (UTC){said} trouble came back")


@pytest.mark.parametrize(
    ("now", "said"),
    [
        (3.4, "S 2.10 % (1.80 to 2.40) when raised, 3.40 % (3.00 to 3.80) when last found."),
        (1.2, "S 2.10 % (1.80 to 2.40) when raised, 1.20 % (0.80 to 1.60) when last found."),
        (2.4, ""),
        (None, ""),
    ],
)
def test_S_of_an_alert_is_told_then_and_now_where_it_changed(now: float | None, said: str) -> None:
    """Whoever plans the work must not take the size of some weeks ago for that of today; a change
    that the interval allows is none."""
    first = {"S": 2.1, "S_low": 1.8, "S_high": 2.4}
    assert S_since_raised(first) == ""
    low, high = (None, None) if now is None else (now - 0.4, now + 0.4)
    assert S_since_raised({"S": now, "S_low": low, "S_high": high, "when_raised": first}) == said


def test_an_alert_without_S_says_nothing_of_it() -> None:
    """One about a device, or sticking that is only suspected."""
    assert S_since_raised({}) == ""
    assert S_since_raised({"S": None, "S_low": None, "S_high": None}) == ""
