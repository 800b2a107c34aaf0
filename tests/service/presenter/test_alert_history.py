"""What people are told of an alert beside its text."""

from __future__ import annotations

import pytest

from stemwatch.service.presenter.alert_history import kind_words
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
