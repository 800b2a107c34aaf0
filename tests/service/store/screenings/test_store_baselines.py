"""Networks, maintenance and notes of a valve."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

from stemwatch.service.store.store import Store

DAY = timedelta(days=1)
START = datetime(2026, 3, 1, 6, 0, tzinfo=UTC)


def test_there_is_one_active_baseline_and_it_knows_of_maintenance(store: Store) -> None:
    """Maintenance after a baseline's window makes it a baseline of the valve as it was before."""
    assert store.baseline("FIC-101") is None
    window = (START, START + DAY)
    store.set_baseline("FIC-101", b"first", window=window, reason="first healthy window")
    baseline = store.baseline("FIC-101")
    assert baseline is not None
    assert b"first" == baseline.network
    assert (
        "Baseline: first healthy window, 2026-03-01 06:00 to 2026-03-02 06:00 UTC." == baseline.note
    )
    store.record_maintenance("FIC-101", START - DAY, "New packing", "J. Doe")
    assert store.baseline("FIC-101") == baseline
    store.record_maintenance("FIC-101", START + DAY, "New positioner", "J. Doe")
    stale = store.baseline("FIC-101")
    assert stale is not None
    assert stale.maintenance is not None
    assert "the valve before maintenance (New positioner on 2026-03-02)." in stale.note
    window = (START + 6 * DAY, START + 7 * DAY)
    store.set_baseline("FIC-101", b"second", window=window, reason="after maintenance")
    renewed = store.baseline("FIC-101")
    assert renewed is not None
    assert (b"second", None) == (renewed.network, renewed.maintenance)
    assert ["New packing", "New positioner"] == [r.note for r in store.maintenance("FIC-101")]


def test_a_baseline_of_unknown_date_says_so(store: Store) -> None:
    """Without dates the note tells when the baseline was stored."""
    store.set_baseline("FIC-101", b"n", reason="first healthy window")
    baseline = store.baseline("FIC-101")
    assert baseline is not None
    assert f"of unknown date, stored {baseline.created:%Y-%m-%d}." in baseline.note


def test_the_fitted_network_is_apart_from_the_baseline(store: Store) -> None:
    """The network of the last fit is replaced by the next; the baseline stays."""
    store.set_baseline("FIC-101", b"baseline", reason="first healthy window")
    for network in (b"one", b"\x00two\xff"):
        store.set_fitted("FIC-101", network, reason="screening")
    fitted, baseline = store.fitted("FIC-101"), store.baseline("FIC-101")
    assert fitted is not None
    assert baseline is not None
    assert (b"\x00two\xff", b"baseline") == (fitted.network, baseline.network)


def test_notes_change_nothing_but_the_notes(store: Store) -> None:
    """A remark about a valve is kept with its author and leaves the baseline alone."""
    store.set_baseline("FIC-101", b"n", window=(START, START), reason="first healthy window")
    store.add_note("FIC-101", START + DAY, "Ask the operators", "K. Roe")
    (note,) = store.notes("FIC-101")
    assert ("Ask the operators", "K. Roe", START + DAY) == (note.note, note.who, note.at)
    baseline = store.baseline("FIC-101")
    assert baseline is not None
    assert baseline.maintenance is None
