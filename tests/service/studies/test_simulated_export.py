"""A simulated plant written as a historian export can be read back as one."""

import csv
import json
import tomllib
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from stemwatch.connectors.connector import TagMapping, ValveTags
from stemwatch.connectors.historian import HistorianFile
from stemwatch.models.recording import Role
from stemwatch.models.studies.simulator import (
    PlantLoop,
    SimulatedLoop,
    SimulatedValve,
    simulate_loop,
)
from stemwatch.models.studies.simulator.loop import (
    ManualSpan,
    PvRange,
    SimulatedArchive,
    Span,
    Transmitters,
)
from stemwatch.service.config import load_plant
from stemwatch.service.studies.simulated_export import ExportedPlant, write_export

_START = datetime(2026, 3, 2, 7, 0, tzinfo=UTC)
_ZONE = "Europe/Berlin"
_FIRST = PlantLoop(
    tag="FIC-101",
    description='Naphtha "light" feed',
    area="Reforming",
    criticality=3,
    valve=SimulatedValve(S=4.0, J=2.0),
    pv_range=PvRange(unit="t/h", low=0.0, high=40.0),
    setpoints=((5.0, 52.0),),
    archive=SimulatedArchive(
        bad=(
            Span(start_s=10.0, stop_s=15.0, role=Role.MV),
            Span(start_s=30.0, stop_s=32.0, role=Role.MV),
        ),
        gaps=(Span(start_s=40.0, stop_s=44.0),),
    ),
    manual=(ManualSpan(start_s=20.0, stop_s=25.0),),
    duration_s=60.0,
)
_SECOND = replace(
    _FIRST,
    tag="TIC-102",
    pv_range=PvRange(unit="°C", low=50.0, high=250.0),
    transmitters=Transmitters(has_position=False),
    archive=SimulatedArchive(gaps=(Span(start_s=42.0, stop_s=44.0),)),
    manual=(),
    duration_s=50.0,
)


@pytest.fixture(scope="module")
def loops() -> list[SimulatedLoop]:
    return [simulate_loop(loop, seed=1) for loop in (_FIRST, _SECOND)]


@pytest.fixture
def exported(loops: list[SimulatedLoop], tmp_path: Path) -> ExportedPlant:
    return write_export(loops, tmp_path, start=_START, zone=_ZONE)


def _table(exported: ExportedPlant) -> tuple[list[str], list[str], list[dict[str, str]]]:
    with exported.files[0].open(encoding="utf-8", newline="") as text:
        header, units, *rows = csv.reader(text)
    return header, units, [dict(zip(header, row, strict=True)) for row in rows]


def test_header_and_units(exported: ExportedPlant) -> None:
    """The first row names every tag, the second its unit; a valve without position has none."""
    header, units, _ = _table(exported)
    assert ["Time", *(f"FIC-101.{x}" for x in ("OP", "ZT", "PV", "SP", "MODE"))] == header[:6]
    assert [f"TIC-102.{x}" for x in ("OP", "PV", "SP", "MODE")] == header[6:]
    assert ["", "%", "%", "t/h", "t/h", "", "%", "°C", "°C", ""] == units


def test_times_are_local_with_their_offset(exported: ExportedPlant) -> None:
    """The first row is the start in the plant's zone, and the others follow second by second."""
    _, _, rows = _table(exported)
    assert "2026-03-02 08:00:00+01:00" == rows[0]["Time"]
    assert "2026-03-02 08:00:09+01:00" == rows[9]["Time"]


def test_bare_times_follow_the_clock_change(loops: list[SimulatedLoop], tmp_path: Path) -> None:
    """Without offset the local clock is written bare, and jumps where the clocks do."""
    start = datetime(2026, 3, 29, 0, 59, 50, tzinfo=UTC)
    exported = write_export(loops, tmp_path, start=start, zone=_ZONE, with_offset=False)
    _, _, rows = _table(exported)
    assert ["2026-03-29 01:59:59", "2026-03-29 03:00:00"] == [rows[k]["Time"] for k in (9, 10)]


def test_values_are_in_engineering_units(
    exported: ExportedPlant, loops: list[SimulatedLoop]
) -> None:
    """PV and SP are written between the ends of their range, OP and position in percent."""
    _, _, rows = _table(exported)
    signals = loops[1].recording.signals
    pv = np.array([float(row["TIC-102.PV"]) for row in rows[:40]])
    np.testing.assert_allclose(pv, 50.0 + 2.0 * signals[Role.PV].values[:40], atol=1e-4)
    op = np.array([float(row["TIC-102.OP"]) for row in rows[:40]])
    np.testing.assert_allclose(op, signals[Role.OP].values[:40], atol=1e-4)


def test_bad_cells_hold_status_words(exported: ExportedPlant) -> None:
    """Bad status, gaps and the end of a shorter loop are words, and good neighbours are numbers."""
    _, _, rows = _table(exported)
    assert {"Bad Input"} == {row["FIC-101.ZT"] for row in rows[10:15]}
    assert {"I/O Timeout"} == {row["FIC-101.ZT"] for row in rows[30:32]}
    assert {"No Data"} == {row["FIC-101.OP"] for row in rows[40:42]}
    assert {"No Data"} == {row["TIC-102.PV"] for row in rows[-10:]}
    assert 40.0 < float(rows[10]["FIC-101.OP"]) < 60.0


def test_an_instant_without_any_data_has_no_row(exported: ExportedPlant) -> None:
    """Where every loop has a gap the file has none of these rows."""
    _, _, rows = _table(exported)
    assert 60 - 2 == len(rows)
    assert ["08:00:41", "08:00:44"] == [rows[k]["Time"][11:19] for k in (41, 42)]


def test_the_mode_is_a_word(exported: ExportedPlant) -> None:
    """Automatic and manual are written as controllers show them."""
    _, _, rows = _table(exported)
    assert ["AUTO", "MAN", "MAN", "AUTO"] == [rows[k]["FIC-101.MODE"] for k in (19, 20, 24, 25)]


def test_the_plant_file_is_a_plant_file(exported: ExportedPlant) -> None:
    """``load_plant`` reads the plant file without a problem, with ranges and descriptions."""
    plant = load_plant(exported.plant_toml)
    assert () == tuple(plant.problems)
    raw = tomllib.loads(exported.plant_toml.read_text(encoding="utf-8"))
    first, second = raw["valves"]
    assert "FIC-101" == first["id"]
    assert 'Naphtha "light" feed' == first["description"]
    expected = {"tag": "FIC-101.PV", "unit": "t/h", "low": 0.0, "high": 40.0}
    assert expected == first["tags"]["pv"]
    assert "mv" not in second["tags"]
    assert [exported.files[0]] == list(exported.plant_toml.parent.glob(raw["sources"][0]["path"]))


def test_the_historian_reader_gives_the_recordings_back(
    exported: ExportedPlant, loops: list[SimulatedLoop]
) -> None:
    """Read through its plant file, the export gives the same numbers, holes, clock and start."""
    source = HistorianFile(exported.files[0])
    raw = tomllib.loads(exported.plant_toml.read_text(encoding="utf-8"))
    for valve, loop in zip(raw["valves"], loops, strict=True):
        tags = {Role(role): TagMapping(**tag) for role, tag in valve["tags"].items()}
        recording = source.read(ValveTags(valve=valve["id"], tags=tags))
        assert _START == recording.start
        assert set(loop.recording.signals) == set(recording.signals)
        for role, signal in loop.recording.signals.items():
            read = recording.signals[role].values[: signal.values.size]
            np.testing.assert_allclose(read, signal.values, atol=2e-4, equal_nan=True)


def test_the_truth_is_beside_it(exported: ExportedPlant) -> None:
    """truth.json tells S, J and shape of every valve by its tag."""
    truth = json.loads(exported.truth_file.read_text(encoding="utf-8"))
    assert "2026-03-02T07:00:00+00:00" == truth["start"]
    valves = [(v["tag"], v["S"], v["J"], v["shape"]) for v in truth["valves"]]
    assert [("FIC-101", 4.0, 2.0, "undershoot"), ("TIC-102", 4.0, 2.0, "undershoot")] == valves


def test_a_naive_start_is_refused(loops: list[SimulatedLoop], tmp_path: Path) -> None:
    """A start without zone is an error that shows it."""
    with pytest.raises(ValueError, match=r"timezone aware, received 2026-03-02T08:00:00"):
        write_export(loops, tmp_path, start=datetime(2026, 3, 2, 8, 0), zone=_ZONE)


def test_two_loops_of_one_tag_are_refused(loops: list[SimulatedLoop], tmp_path: Path) -> None:
    """A repeated tag is named."""
    with pytest.raises(ValueError, match=r"a tag of its own; twice: \['FIC-101'\]"):
        write_export([loops[0], loops[0]], tmp_path, start=_START, zone=_ZONE)


def test_different_intervals_are_refused(loops: list[SimulatedLoop], tmp_path: Path) -> None:
    """Loops that cannot share a clock are an error that names their intervals."""
    slow = simulate_loop(replace(_SECOND, archive=SimulatedArchive(interval_s=2.0)), seed=1)
    with pytest.raises(ValueError, match=r"'FIC-101': 1\.0, 'TIC-102': 2\.0"):
        write_export([loops[0], slow], tmp_path, start=_START, zone=_ZONE)


def test_no_loops_are_refused(tmp_path: Path) -> None:
    """An empty export is an error, and nothing is written."""
    with pytest.raises(ValueError, match="at least one loop"):
        write_export([], tmp_path, start=_START, zone=_ZONE)
    assert [] == list(tmp_path.iterdir())
