"""Samples in the store: each once, as it came, and a valve's recording from them."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from stemwatch.connectors.connector import (
    Connector,
    ConnectorError,
    MappingNeeded,
    TagMapping,
    UnknownTag,
    ValveTags,
    Window,
)
from stemwatch.connectors.modbus.sample_batch import CAME_TWICE, SampleBatch
from stemwatch.models.recording import Quality, Role
from stemwatch.service.store.samples.connector import StoredSamples
from stemwatch.service.store.samples.tables import microseconds
from stemwatch.service.store.store import Store

START = datetime(2026, 3, 2, 6, 0, tzinfo=UTC)
TAGS = ValveTags(
    valve="FIC-1",
    tags={
        Role.OP: TagMapping(tag="OP", unit="%"),
        Role.MV: TagMapping(tag="MV", unit="mA", low=4.0, high=20.0),
    },
)


def batch(tag: str, seconds, values, *, quality=None, reason="", source="plc") -> SampleBatch:
    count = len(seconds)
    at_us = microseconds(START) + np.round(np.asarray(seconds, float) * 1e6).astype(np.int64)
    quality = [0] * count if quality is None else quality
    return SampleBatch(
        source=source,
        tags=(tag,) * count,
        at_us=at_us,
        values=np.asarray(values, float),
        quality=np.asarray(quality, np.uint8),
        reasons=tuple(reason if code else "" for code in quality),
    )


def test_a_batch_that_comes_again_changes_nothing(store: Store) -> None:
    """After a crash between storing and noting it a batch comes twice; the first one stays."""
    store.samples.write(batch("OP", [0, 1, 2], [10, 11, 12]))
    store.samples.write(batch("OP", [1, 2, 3], [99, 99, 13]))
    samples = store.samples.read("plc", "OP")
    assert samples.values.tolist() == [10, 11, 12, 13]
    assert store.samples.read("plc", "OP").at_us.size == 4


def test_a_sample_whose_time_came_twice_makes_the_first_one_bad(store: Store) -> None:
    """The only one that takes another's place, with its reason; those beside it stay, and so does
    all of it when the batch comes again."""
    store.samples.write(batch("OP", [0, 1, 2], [10, 11, 12]))
    repeated = batch("OP", [1, 3], [np.nan, 13], quality=[Quality.MISSING, 0], reason=CAME_TWICE)
    for _ in range(2):
        store.samples.write(repeated)
        samples = store.samples.read("plc", "OP")
        assert samples.quality.tolist() == [0, Quality.MISSING, 0, 0]
        assert np.array_equal(samples.values, [10, np.nan, 12, 13], equal_nan=True)
        assert store.samples.reasons("plc", "OP") == {CAME_TWICE: 1}


def test_the_same_tag_of_two_sources_is_two(store: Store) -> None:
    """Tags are known by source and name."""
    store.samples.write(batch("OP", [0], [1.0], source="a"))
    store.samples.write(batch("OP", [0], [2.0], source="b"))
    assert [store.samples.read(item, "OP").values.tolist() for item in "ab"] == [[1.0], [2.0]]


def test_bad_samples_keep_their_reason(store: Store) -> None:
    """A bad sample has no value, a quality, and a sentence that can be counted."""
    store.samples.write(batch("OP", [0, 1], [np.nan, 5.0], quality=[2, 0], reason="timed out"))
    store.samples.write(batch("OP", [2], [np.nan], quality=[2], reason="timed out"))
    samples = store.samples.read("plc", "OP")
    assert samples.quality.tolist() == [2, 0, 2]
    assert np.isnan(samples.values[[0, 2]]).all()
    assert store.samples.reasons("plc", "OP") == {"timed out": 2}


def test_a_window_is_half_open(store: Store) -> None:
    """The start belongs to a window, the stop does not."""
    store.samples.write(batch("OP", [0, 1, 2, 3], [0, 1, 2, 3]))
    second = timedelta(seconds=1)
    samples = store.samples.read("plc", "OP", START + second, START + 3 * second)
    assert samples.values.tolist() == [1, 2]
    assert store.samples.bounds("plc", "OP") == (START, START + 3 * second)
    assert store.samples.bounds("plc", "no such tag") is None


def test_old_samples_are_removed(store: Store) -> None:
    """What is older than asked for goes, of every tag, and nothing else."""
    for tag in ("OP", "MV"):
        store.samples.write(batch(tag, [0, 10, 20], [1, 2, 3]))
    assert store.samples.remove_before(START + timedelta(seconds=10)) == 2
    assert store.samples.read("plc", "MV").values.tolist() == [2, 3]


def test_units_come_with_the_tags(store: Store) -> None:
    """A unit may be said before or after the first sample."""
    store.samples.write(batch("OP", [0], [1.0]))
    store.samples.describe("plc", {"OP": "%", "PV": "t/h"})
    assert [(tag.name, tag.unit) for tag in store.samples.tags("plc")] == [
        ("OP", "%"),
        ("PV", "t/h"),
    ]


@given(
    tag=st.text(min_size=1, max_size=20),
    numbers=st.lists(st.floats(allow_subnormal=False), min_size=1, max_size=30),
)
@settings(
    max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_every_tag_and_finite_number_comes_back_exactly(
    store: Store, tag: str, numbers: list[float]
) -> None:
    """Every finite number comes back bit for bit, whatever the tag is called."""
    source = f"s{abs(hash((tag, tuple(numbers))))}"
    store.samples.write(batch(tag, range(len(numbers)), numbers, source=source))
    values = store.samples.read(source, tag).values
    expected = np.asarray(numbers)
    expected[~np.isfinite(expected)] = np.nan
    np.testing.assert_array_equal(values, expected)


def test_a_recording_from_the_store_has_ops_clock_and_percent(store: Store) -> None:
    """OP's clock, percent of the given range, holes left holes, and where it came from."""
    seconds = [n for n in range(30) if n not in (10, 11)]
    store.samples.write(batch("OP", seconds, np.arange(30.0)[seconds]))
    store.samples.write(batch("MV", range(30), np.full(30, 12.0)))
    source = StoredSamples(store.samples, "plc")
    assert isinstance(source, Connector)
    recording = source.read(TAGS, Window(start=START + timedelta(seconds=2)))
    assert (recording.interval_s, recording.start) == (1.0, START + timedelta(seconds=2))
    assert len(recording) == 28
    assert np.flatnonzero(recording.op.quality == Quality.MISSING).tolist() == [8, 9]
    np.testing.assert_allclose(recording.mv.values, 50.0)
    assert recording.mv.unit == "%"
    assert "source plc" in recording.provenance.source


def test_what_is_not_there_is_said(store: Store) -> None:
    """Unknown tags, empty windows and a missing OP are sentences that help."""
    source = StoredSamples(store.samples, "plc")
    with pytest.raises(UnknownTag, match="nothing was collected yet"):
        source.read(TAGS)
    store.samples.write(batch("OP", range(5), range(5)))
    with pytest.raises(UnknownTag, match=r"'MV'.*nearest are 'OP'"):
        source.read(TAGS)
    store.samples.write(batch("MV", [0], [4.0]))
    store.samples.write(batch("OP", [60], [np.nan], quality=[2], reason="no connection"))
    late = Window(start=START + timedelta(seconds=30))
    with pytest.raises(ConnectorError, match=r"no good sample .*no connection \(once\)"):
        source.read(TAGS, late)
    with pytest.raises(MappingNeeded):
        source.read(ValveTags(valve="V", tags={Role.MV: TagMapping(tag="MV")}))


def test_the_rules_of_exports_hold_for_collected_samples(store: Store) -> None:
    """Raw counts are no percent, an impossible value is left out, an empty range is an error, and
    the command is not taken for the position."""
    store.samples.write(batch("OP", range(60), np.linspace(0.0, 27648.0, 60)))
    values = np.full(60, 12.0)
    values[7] = 4000.0
    store.samples.write(batch("MV", range(60), values))
    source = StoredSamples(store.samples, "plc")
    no_unit = ValveTags(valve="V", tags={**TAGS.tags, Role.OP: TagMapping(tag="OP")})
    recording = source.read(no_unit)
    assert recording.op.unit == ""
    assert "no unit is known and values from 0 to 27648 are no percent" in " ".join(
        recording.provenance.decisions
    )
    assert np.flatnonzero(recording.mv.quality == Quality.RANGE).tolist() == [7]
    flat = {Role.OP: TagMapping(tag="OP"), Role.MV: TagMapping(tag="MV", low=4.0, high=4.0)}
    with pytest.raises(ConnectorError, match="give no range"):
        source.read(ValveTags(valve="V", tags=flat))
    twice = {Role.OP: TagMapping(tag="OP"), Role.MV: TagMapping(tag="OP")}
    with pytest.raises(ConnectorError, match="given for both OP and MV"):
        source.read(ValveTags(valve="V", tags=twice))
