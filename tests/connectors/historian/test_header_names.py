"""The header of an export tells its tags without the file being read."""

from __future__ import annotations

from pathlib import Path

import pytest

from stemwatch.connectors.historian import HistorianFile
from stemwatch.connectors.historian.header_names import header_names

WANTED = {"FIC-1.OP", "FIC-1.ZT", "FIC-2.OP", "FIC-2.ZT"}


def test_a_wide_heading_is_enough(tmp_path: Path) -> None:
    """Of a wide export the header names what reading all of it would find."""
    rows = [f"2026-03-02 06:00:{k:02d};{k};{k}.1;50;49.8" for k in range(20)]
    file = tmp_path / "export.csv"
    file.write_text("\n".join(["Time;FIC-1.OP;FIC-1.ZT;FIC-2.OP;FIC-2.ZT", *rows]), "utf-8")
    tags = {info.tag for info in HistorianFile(file).tags()}
    assert tags == WANTED
    assert WANTED <= (header_names(str(file), WANTED) or set())


@pytest.mark.parametrize(
    "text",
    [
        "Time;FIC-1.OP (%);FIC-1.ZT [%]\n2026-03-02 06:00:00;1;2\n",
        'Report of March\n\n"Time","FIC-1.OP","FIC-1.ZT"\n"2026-03-02 06:00:00","1","2"\n',
        "\ufeffTime\tFIC-1.OP\tFIC-1.ZT\n2026-03-02 06:00:00\t1\t2\n",
    ],
)
def test_units_quotes_and_titles_do_not_matter(text: str, tmp_path: Path) -> None:
    """The tags are found under a title, in quotes, and with a unit behind them."""
    file = tmp_path / "export.csv"
    file.write_text(text, encoding="utf-8")
    assert {"FIC-1.OP", "FIC-1.ZT"} <= (header_names(str(file), WANTED) or set())
    assert "FIC-2.OP" not in (header_names(str(file), WANTED) or set())


@pytest.mark.parametrize(
    "text",
    [
        "Tag,Time,Value\nFIC-1.OP,2026-03-02 06:00:00,1\nFIC-1.ZT,2026-03-02 06:00:00,2\n",
        "Time,A,B\n2026-03-02 06:00:00,1,2\n",
        "",
    ],
)
def test_where_the_heading_does_not_tell_the_file_is_read(text: str, tmp_path: Path) -> None:
    """A narrow export has other tags further down, so its first lines prove nothing."""
    file = tmp_path / "export.csv"
    file.write_text(text, encoding="utf-8")
    assert header_names(str(file), WANTED) is None
    assert header_names(str(tmp_path / "absent.csv"), WANTED) is None
    assert header_names(str(tmp_path / "export.csv.gz"), WANTED) is None


@pytest.mark.parametrize(
    ("text", "encoding"),
    [
        ('Time;FIC-1.OP;FIC-1.ZT;"FIC""115.OP"\n', "utf-8"),
        ('Time,FIC-1.OP,FIC-1.ZT,"Tank, north.OP"\n', "utf-8"),
        ("Time;FIC-1.OP;FIC-1.ZT;Überlauf.OP\n", "cp1252"),
        ("Time;FIC-1.OP;FIC-1.ZT;Überlauf.OP\n", "utf-16"),
    ],
)
def test_no_tag_of_an_odd_heading_is_said_to_be_absent(
    text: str, encoding: str, tmp_path: Path
) -> None:
    """Names with quotes, separators or umlauts: the quick look finds them or leaves them to
    reading."""
    file = tmp_path / "export.csv"
    file.write_text(text + "2026-03-02 06:00:00;1;2;3\n", encoding=encoding)
    odd = {'FIC"115.OP', "Tank, north.OP", "Überlauf.OP"}
    named = header_names(str(file), WANTED | odd)
    assert named is None or named & odd


def test_a_quoted_heading_of_ten_thousand_tags_is_read(tmp_path: Path) -> None:
    """By a separator that it does not have such a line is one cell, longer than csv allows."""
    file = tmp_path / "export.csv"
    tags = {f"UNIT-{number:05d}.FIC-{number:05d}.OP" for number in range(10_000)}
    heading = ";".join(f'"{tag}"' for tag in ("Time", *sorted(tags)))
    file.write_text(f"{heading}\n", encoding="utf-8")
    assert tags <= (header_names(str(file), tags) or set())
