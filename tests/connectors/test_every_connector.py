"""The contract of ``Connector``, held against every installed one.

A new connector joins by an entry point and a function here that gives it something to read.
"""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from importlib.metadata import entry_points
from pathlib import Path

import pytest

from stemwatch.connectors.connector import (
    Connector,
    ConnectorError,
    TagMapping,
    UnknownTag,
    ValveTags,
    Window,
)
from stemwatch.models.recording import Quality, Role

START = datetime(2026, 1, 5, 6, tzinfo=UTC)
VALVE = ValveTags(
    valve="FIC1",
    tags={
        Role.OP: TagMapping(tag="FIC1.OP", unit="%"),
        Role.PV: TagMapping(tag="FIC1.PV", low=0.0, high=40.0),
    },
)


def csv(connector: Callable[[Path], Connector], folder: Path) -> Connector:
    """600 samples of 1 s from START: OP = i mod 100, PV = 20 t/h, sample 7 of OP bad, 9 absent."""
    rows = "".join(
        f"{(START + timedelta(seconds=i)).isoformat()},{'Bad' if i == 7 else i % 100},20\n"
        for i in range(600)
        if i != 9
    )
    path = folder / "export.csv"
    path.write_text("Time,FIC1.OP,FIC1.PV\n" + rows)
    return connector(path)


PREPARED = {"csv": csv}
INSTALLED = sorted(entry_points(group="stemwatch.connectors"), key=lambda point: point.name)


@pytest.fixture(params=INSTALLED, ids=lambda point: point.name)
def connector(request: pytest.FixtureRequest, tmp_path: Path) -> Connector:
    point = request.param
    if point.name not in PREPARED:
        pytest.fail(f"connector {point.name!r} has nothing to read here; add it to PREPARED")
    return PREPARED[point.name](point.load(), tmp_path)


def test_it_is_a_connector(connector: Connector) -> None:
    """It has the protocol's methods."""
    assert isinstance(connector, Connector)


def test_tags_are_listed_with_samples(connector: Connector) -> None:
    """Every tag is listed with the number of its samples."""
    samples = {info.tag: info.samples for info in connector.tags()}
    assert samples == {"FIC1.OP": 598, "FIC1.PV": 599}


def test_recording_is_even_utc_and_masked(connector: Connector) -> None:
    """One even clock in UTC; bad and absent samples are masked with their reason."""
    recording = connector.read(VALVE)
    assert (recording.start, recording.interval_s, len(recording)) == (START, 1.0, 600)
    assert recording.op.quality[[6, 7, 8, 9, 10]].tolist() == [
        Quality.GOOD,
        Quality.BAD,
        Quality.GOOD,
        Quality.MISSING,
        Quality.GOOD,
    ]
    assert recording.op.values[10] == 10.0


def test_ranges_become_percent(connector: Connector) -> None:
    """With low and high the values are percent of span."""
    pv = connector.read(VALVE).signals[Role.PV]
    assert (pv.unit, pv.values[0]) == ("%", 50.0)


def test_nothing_outside_the_window(connector: Connector) -> None:
    """Samples from start to before stop, and none else."""
    window = Window(start=START + timedelta(seconds=60), stop=START + timedelta(seconds=120))
    recording = connector.read(VALVE, window)
    assert (recording.start, recording.end) == (window.start, window.stop)
    assert recording.op.values[0] == 60.0


def test_empty_window_is_an_error(connector: Connector) -> None:
    """A window without samples is a ConnectorError, not an empty recording."""
    with pytest.raises(ConnectorError):
        connector.read(VALVE, Window(start=START + timedelta(days=9)))


def test_unknown_tag(connector: Connector) -> None:
    """A tag that is not there is an UnknownTag that lists the nearest."""
    wrong = ValveTags(valve="FIC1", tags={Role.OP: TagMapping(tag="FIC1.OPP")})
    with pytest.raises(UnknownTag, match=r"FIC1\.OP'"):
        connector.read(wrong)


def test_provenance_names_source_and_digest(connector: Connector) -> None:
    """A recording knows where it came from."""
    provenance = connector.read(VALVE).provenance
    assert provenance.source
    assert provenance.digest
    assert provenance.decisions
