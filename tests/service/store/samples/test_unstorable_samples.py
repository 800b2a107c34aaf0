"""Samples that a database can never take hold up no others: they are set aside by the collector."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from sqlalchemy import text
from sqlalchemy.exc import DataError

from stemwatch.connectors.modbus import SampleBatch
from stemwatch.connectors.modbus.sample_batch import one_instant
from stemwatch.service.collector import SinkRefused, Spool
from stemwatch.service.collector.forwarder import Forwarder
from stemwatch.service.config import load_plant
from stemwatch.service.serve.collector_process import StoreWhenReady
from stemwatch.service.store.database.engine import store_errors
from stemwatch.service.store.database_url import DatabaseUrl
from stemwatch.service.store.errors import StoreError, Unstorable
from stemwatch.service.store.samples.samples import SampleStore
from stemwatch.service.store.store import Store

AT_US = 1_700_000_000_000_000


def batch_of(value: float) -> SampleBatch:
    return one_instant("plc", ["T"], AT_US + int(value), np.array([value]), np.zeros(1, "u1"), [""])


def test_a_value_that_no_column_takes_is_told_from_a_database_that_is_away(store: Store) -> None:
    """The one is never stored by trying again, the other may be."""
    if not store.transactions.is_sqlite:  # which takes any value
        with pytest.raises(Unstorable), store.transactions.writing("a test") as session:
            session.execute(text("SELECT CAST('x' AS integer)"))
    with pytest.raises(StoreError) as away, store.transactions.writing("a test") as session:
        session.execute(text("SELECT 1 FROM no_such_table"))
    assert not isinstance(away.value, Unstorable)


def test_the_collector_sets_aside_what_can_never_be_stored(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What came before and after is stored, and the rest waits in a file with the reason."""
    write, address = SampleStore.write, DatabaseUrl("sqlite://")

    def refusing(samples: SampleStore, batch: SampleBatch) -> None:
        with store_errors(address, "storing samples"):
            if 4.0 in batch.values:
                raise DataError("INSERT", {}, ValueError("value out of range"))
        write(samples, batch)

    monkeypatch.setattr(SampleStore, "write", refusing)
    plant = tmp_path / "plant.toml"
    plant.write_text(f'[storage]\nurl = "sqlite:///{tmp_path / "s.db"}"\n', encoding="utf-8")
    sink = StoreWhenReady(load_plant(plant))
    with pytest.raises(SinkRefused, match="value out of range"):
        sink.write(batch_of(4.0))
    spool = Spool(tmp_path / "spool")
    for value in (3.0, 4.0, 5.0):
        spool.append(batch_of(value))
    assert Forwarder(spool, sink).once()
    spool.close()
    assert sink.store().samples.read("plc", "T").values.tolist() == [3.0, 5.0]
    (aside,) = (tmp_path / "spool" / "refused").glob("*.csv")
    assert "value out of range" in aside.read_text(encoding="utf-8")
