"""An option that makes no difference to a file is said, whichever it is."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path

import pytest

from stemwatch.connectors.connector import TagMapping, ValveTags
from stemwatch.connectors.historian import HistorianFile, ReadOptions
from stemwatch.connectors.parquet import ParquetArchive
from stemwatch.models.recording import Role

OP = ValveTags(valve="A", tags={Role.OP: TagMapping(tag="A.OP")})
ROWS = [(f"2026-03-02T06:{minute:02d}:00+00:00", minute + 0.5) for minute in range(40)]
# One value of each option that a file with dates and offsets has no use for.
SAID = {
    "zone": "Europe/Berlin",
    "ambiguous_hour": "first",
    "missing_hour": "leave_out",
    "encoding": "utf-8",
    "separator": ";",
    "decimal": ".",
    "day_first": True,
    "time_format": "%Y-%m-%dT%H:%M:%S%z",
    "time_column": "Time",
    "tag_column": "Time",
    "value_column": "A.OP",
    "quality_column": "Time",
    "interval_s": 20.0,
    "good_quality": ("192",),
}
# What such a file is read by where it is given.
USED = {"encoding", "separator", "decimal", "time_format", "time_column"}


def test_every_option_has_a_case() -> None:
    """A new option of reading needs a line above, and then a sentence."""
    assert set(SAID) == {field.name for field in fields(ReadOptions)}


@pytest.mark.parametrize("option", SAID)
def test_an_option_is_used_or_said_not_to_be(open_text, option: str) -> None:
    """In a text export: nothing given, nothing said; one given, used or one sentence with why."""
    text = "Time;A.OP\n" + "".join(f"{time};{value}\n" for time, value in ROWS)
    options = replace(ReadOptions(), **{option: SAID[option]})
    recording = open_text(text, options=options).read(OP)
    answer = recording.provenance.unused_options
    assert len(answer) == (option not in USED)
    assert set(answer) <= set(recording.provenance.decisions)
    assert all(sentence.startswith(f"{option} = ") and len(sentence) > 40 for sentence in answer)


def test_what_the_layout_fixes_is_said(tmp_path: Path) -> None:
    """A layout with its own separator and time column does not ask for them."""
    head = "PROCESSDATA\tx\n\t10\t2026-03-02\t40\ntagname\tA.MV\tA.PV\n\tA_OP\tA\n\t\t\n"
    rows = "".join(f"2026-03-02 06:{m:02d}:00\t{m}.5\t{m}.25\n" for m in range(40))
    file = tmp_path / "export.txt"
    file.write_text(head + rows)
    read_options = ReadOptions(separator=";", time_column="Stamp", zone="Europe/Berlin")
    source = HistorianFile(file, read_options)
    inspection = source.inspect()
    assert inspection.unused_options == {"separator", "time_column"}
    text = " ".join(one for one in inspection.decisions if " is not used: " in one)
    assert "separator = ';' is not used: the file was read as PROCESSDATA export" in text
    assert "time_column = 'Stamp' is not used" in text
    assert "zone" not in text


def test_an_archive_reports_unused_options_too(tmp_path: Path) -> None:
    """Parquet has no separator, and times that are instants need no zone."""
    import pandas as pd

    times = pd.to_datetime([time for time, _ in ROWS], utc=True)
    frame = pd.DataFrame({"time": times, "A.OP": [value for _, value in ROWS]})
    frame.to_parquet(tmp_path / "a.parquet")
    read_options = ReadOptions(separator=";", interval_s=5.0, zone="Europe/Berlin")
    recording = ParquetArchive(str(tmp_path / "a.parquet"), read_options).read(OP)
    assert [s.split(" = ")[0] for s in recording.provenance.unused_options] == [
        "zone",
        "separator",
        "interval_s",
    ]
