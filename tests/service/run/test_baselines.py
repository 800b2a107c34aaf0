"""Which window becomes a valve's baseline, whatever the order in which windows are over."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest

from stemwatch.models.verdict import Verdict
from stemwatch.service.run.saving import keep_network
from stemwatch.service.store.store import Store, open_store
from tests.models.narx.test_narx_network import network
from tests.service.example_mismatches import named
from tests.service.web.example_plant import NOW, STICKY, screening

WEEK = timedelta(days=7)


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Store]:
    """An empty store."""
    with open_store(f"sqlite:///{tmp_path / 'kept.db'}") as opened:
        yield opened


@pytest.fixture
def keep(store: Store) -> Any:
    """Keep the network of a window so many weeks ago; the active baseline's reason and age."""

    def kept(weeks_ago: int, verdict: Verdict = Verdict.STICKY, **changes: Any) -> tuple[str, int]:
        one = screening(STICKY, verdict, at=NOW - weeks_ago * WEEK, network=network(), **changes)
        keep_network(one, store)
        baseline = store.baseline(STICKY)
        assert baseline is not None
        assert baseline.window[1] is not None
        return baseline.reason, round((NOW - baseline.window[1]) / WEEK)

    return kept


def test_the_first_window_is_the_earliest_and_not_the_one_that_is_over_first(keep: Any) -> None:
    """Windows of one run are fitted side by side."""
    assert keep(1) == ("first window with a fit (sticky)", 1)
    assert keep(5) == ("first window with a fit (sticky)", 5)
    assert keep(0) == ("first window with a fit (sticky)", 5)
    assert keep(2, Verdict.HEALTHY) == ("first healthy window (healthy)", 2)
    assert keep(3) == ("first healthy window (healthy)", 2)
    assert keep(4, Verdict.HEALTHY) == ("first healthy window (healthy)", 4)


def test_a_window_before_the_work_stays_before_it(keep: Any, store: Store) -> None:
    """The earlier window shows another valve: one that was worked on since."""
    keep(1)
    store.record_maintenance(STICKY, NOW - 2 * WEEK, "new packing", "K. Berg")
    assert keep(5) == ("first window with a fit (sticky)", 1)


def test_a_stem_that_follows_a_defective_actuator_is_no_healthy_baseline(keep: Any) -> None:
    """The baseline's word is that of the valve's pages; the first sound window replaces it."""
    assert keep(2, Verdict.HEALTHY, mismatch=named()) == ("first window with a fit (defective)", 2)
    assert keep(1, Verdict.HEALTHY) == ("first healthy window (healthy)", 1)
