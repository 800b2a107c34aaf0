"""A valve list that is wrong: a row costs itself, a heading stops the reading."""

from __future__ import annotations

from pathlib import Path

import pytest

from stemwatch.service.config import PlantFileError, load_plant

SOURCE = '[[sources]]\nname = "s"\npath = "a.csv"\n'  # three lines
GOOD = '[[valves]]\nid = "GOOD"\nsource = "s"\n[valves.tags.op]\ntag = "GOOD.OP"\n'  # five lines


def write(folder: Path, text: str, listed: str | None = None) -> Path:
    (folder / "plant.toml").write_text(text, encoding="utf-8")
    if listed is not None:
        (folder / "valves.csv").write_text(listed, encoding="utf-8")
    return folder / "plant.toml"


LISTED = f'valve_list = "valves.csv"\n{SOURCE}'
HEAD = "id,source,criticality,op,op_low,op_high,mv"


@pytest.mark.parametrize(
    ("row", "expected"),
    [
        (",s,2,A.OP,,,", "column id: found nothing; expected the valve's own name"),
        ("A,,2,A.OP,,,", "column source: found nothing; expected the name of one of the [[sou"),
        ("A,t,2,A.OP,,,", "column source: found the unknown source 't'; expected one of s"),
        ("A,s,5,A.OP,,,", "column criticality: found the text '5'; expected 1, 2 or 3"),
        ("A,s,high,A.OP,,,", "column criticality: found the text 'high'; expected 1, 2 or 3"),
        ("A,s,2,,,,", "column op: found nothing; expected the tag of the controller output"),
        ("A,s,2,,0,1,", "column op: found nothing; expected the tag's name in the source"),
        ("A,s,2,A.OP,9,1,", "column op_low: found low = 9 and high = 1; expected low below high"),
        ("A,s,2,A.OP,9,,", "column op_low: found low without high; expected both"),
        ("A,s,2,A.OP,x,1,", "column op_low: found the text 'x'; expected the engineering value"),
        ("A,s,2,A.OP,0,inf,", "column op_high: found the text 'inf'; expected the engineering"),
        ("A,s,2,A.OP,,,A.OP", "column mv: found 'A.OP', which is also the op tag; expected"),
        ("A,s,2", "row: found 3 cells; expected 7, as in the heading"),
        ("A,s,2,A.OP,,,,extra", "row: found 8 cells; expected 7, as in the heading"),
        ("GOOD,s,2,A.OP,,,", "column id: found 'GOOD', which valves.csv, line 2 has already"),
    ],
)
def test_a_wrong_row_is_left_out_with_its_sentence(tmp_path: Path, row: str, expected: str) -> None:
    """File, line and column are named, and the rows before and after it are read."""
    rows = f"{HEAD}\nGOOD,s,2,GOOD.OP,,,\n"
    listing = f"{rows}\n{row}\nLAST,s,,LAST.OP,,,\n"
    plant = load_plant(write(tmp_path, LISTED, listing), environment={})
    (problem,) = plant.problems
    assert str(problem).startswith(f"valves.csv, line 4: {expected}")
    assert ["GOOD", "LAST"] == list(plant.valves)


def test_a_valve_of_the_file_comes_before_one_of_the_list(tmp_path: Path) -> None:
    """The sentence for a row names the place in the other file."""
    plant = load_plant(write(tmp_path, LISTED + GOOD, "id,source,op\nGOOD,s,X\n"), environment={})
    (problem,) = plant.problems
    assert "valves.csv, line 2: column id: found 'GOOD', which plant.toml, line 6 has" in str(
        problem
    )
    assert "GOOD.OP" == plant.valves["GOOD"].tags.op.tag


@pytest.mark.parametrize(
    ("listed", "expected"),
    [
        ("", "line 1: heading: found an empty file; expected one of area,"),
        ("id,source\n", "line 1: column op: found nothing; expected a column with this heading"),
        ("id,source,op,op_lwo\n", "line 1: column op_lwo: found an unknown column; expected one "),
        ("id,source,op,op\n", "line 1: column op: found 2 columns with this heading; expected one"),
        ('id,source,op\nA,s,a\nB,s,"b\nC,s,c\n', "line 3: row: found a row that is not CSV ("),
        (None, ": valve_list: found No such file or directory; expected a CSV file of valves"),
    ],
)
def test_a_list_that_is_wrong_as_a_whole_stops_the_reading(
    tmp_path: Path, listed: str | None, expected: str
) -> None:
    """A heading that is not understood would be wrong for every valve; none may vanish."""
    with pytest.raises(PlantFileError) as caught:
        load_plant(write(tmp_path, LISTED, listed), environment={})
    (problem,) = caught.value.problems
    assert str(problem).removeprefix("valves.csv").removeprefix(", ").startswith(expected)


def test_a_list_in_another_encoding_is_read_and_said(tmp_path: Path) -> None:
    """An old spreadsheet's umlauts cost no valve."""
    file = write(tmp_path, LISTED)
    text = "id,source,op,description\nA,s,A.OP,\nB,s,B.OP,Süd\n"
    (tmp_path / "valves.csv").write_bytes(text.encode("cp1252"))
    plant = load_plant(file, environment={})
    (problem,) = plant.problems
    assert str(problem) == (
        "valves.csv, line 3: encoding: found the byte 0xfc, which is not UTF-8; expected UTF-8 "
        "(the list was read as Windows-1252 instead)"
    )
    assert "Süd" == plant.valves["B"].description


def test_a_cell_of_connections_holds_several_valves(tmp_path: Path) -> None:
    """Between bars, or commas and semicolons in quotation marks."""
    rows = 'id,source,op,feeds\nA,s,A.OP,B | C\nB,s,B.OP,"C;A"\nC,s,C.OP,\n'
    plant = load_plant(write(tmp_path, LISTED, rows), environment={})
    assert plant.problems == ()
    feeds = {valve.id: valve.feeds for valve in plant.valves.values()}
    assert feeds == {"A": ["B", "C"], "B": ["C", "A"], "C": []}
