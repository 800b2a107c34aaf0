"""What people are told of an alert beside its text."""

from __future__ import annotations

from datetime import UTC

import pytest

from stemwatch.service.presenter.alert_history import kind_words, opened_again
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
