"""``stemwatch inspect``: what is understood of an export, and a mapping that can be pasted."""

from __future__ import annotations

import gzip
import json
import tomllib
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stemwatch.models.recording import Floats
from stemwatch.service.config import load_plant
from stemwatch.service.run.plan import Request, make_plan
from tests.connectors.pi.loopback_server import ARCHIVE, Served, serving
from tests.models.stickslip.test_stroke_curve import plain, stored


def proposal(text: str) -> str:
    """The proposed mapping, as a user would copy it."""
    return text[text.index("[[sources]]") :]


def narrow(export: Path, folder: Path) -> Path:
    """The export's valve as tag, time, value: one row for each sample."""
    header, _units, *rows = export.read_text(encoding="utf-8").splitlines()
    tags = header.split(",")[1:]
    lines = ["TagName,Timestamp,Value,Quality"]
    for row in rows:
        time, *cells = row.split(",")
        lines += [f"{tag},{time},{cell},Good" for tag, cell in zip(tags, cells, strict=True)]
    path = folder / "narrow.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def german(export: Path, folder: Path) -> Path:
    """The export as a German spreadsheet saves it: semicolons, decimal commas, cp1252."""
    text = export.read_text(encoding="utf-8").replace(",", ";").replace(".", ",")
    path = folder / "deutsch.csv"
    text = text.replace("FIC-104,", "FIC-104.")  # the dot in a tag is no decimal mark
    text = text.replace("+01:00", "").replace("t/h", "m³/h").replace("\n", "\r\n")
    path.write_bytes(text.encode("cp1252"))
    return path


def packed(export: Path, folder: Path) -> Path:
    """The export with gzip."""
    path = folder / "historian.csv.gz"
    path.write_bytes(gzip.compress(export.read_bytes()))
    return path


def as_it_is(export: Path, folder: Path) -> Path:
    """The wide export itself."""
    return export


@pytest.mark.parametrize(
    "layout",
    [narrow, german, *(pytest.param(one, marks=pytest.mark.long) for one in (as_it_is, packed))],
)
def test_the_proposed_mapping_loads_and_screens(
    stemwatch, one_valve: Path, tmp_path: Path, layout
) -> None:
    """Whatever the layout, the proposed text, pasted as printed, is a plant file that screens."""
    file = layout(one_valve, tmp_path)
    seen = stemwatch("inspect", file, "--zone", "Europe/Berlin")
    assert seen.status == 0, seen.said
    plant = tmp_path / "plant.toml"
    plant.write_text(proposal(seen.out), encoding="utf-8")

    loaded = load_plant(plant)
    assert loaded.problems == ()
    assert list(loaded.valves) == ["FIC-104"]

    valve = the_valve_screened(stemwatch, plant)
    assert ("FIC-104", "sticky") == (valve["valve"], valve["verdict"])


def exported(path: Path, op: Floats, mv: Floats, units: str = "") -> Path:
    """An export of OP and position, a row each second, with a row of ``units`` where given."""
    start = datetime(2026, 3, 2, 6, tzinfo=UTC)
    lines = ["Time,FIC-104.OP,FIC-104.ZT", *([units] if units else [])]
    for second, row in enumerate(zip(op, mv, strict=True)):
        time = (start + timedelta(seconds=second)).isoformat()
        lines.append(",".join([time, *(f"{value:.3f}" for value in row)]))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def the_valve_screened(stemwatch, plant: Path) -> dict[str, Any]:
    """What a screening by this plant file says of its one valve."""
    out, results = plant.parent / "out", plant.parent / "found.json"
    screened = stemwatch(
        "screen", "--plant", plant, "--out", out, "--json", results, "--workers", 1
    )
    assert screened.status == 0, screened.said
    (valve,) = json.loads(results.read_text(encoding="utf-8"))
    found: dict[str, Any] = valve
    return found


def split_range(folder: Path) -> Path:
    """An export of a valve that the upper half of OP strokes, and that sticks."""
    recording = stored("upper half of a split range", 5.0, 1.5)
    assert recording.mv is not None
    return exported(folder / "split.csv", recording.op.values, recording.mv.values, ",%,%")


def test_a_position_in_mA_is_not_proposed_as_a_curve(stemwatch, tmp_path: Path) -> None:
    """Without a unit in the file it was, and then the range that the report asks for did not help.
    What is proposed screens as it is."""
    recording = plain(5.0, 1.5)
    assert recording.mv is not None
    file = exported(tmp_path / "mA.csv", recording.op.values, 4.0 + 0.16 * recording.mv.values)
    plant = tmp_path / "plant.toml"
    assert stemwatch("inspect", file, "--write", plant).status == 0
    assert "stroke_curve" not in plant.read_text(encoding="utf-8")
    valve = the_valve_screened(stemwatch, plant)
    assert valve["verdict"] == "sticky"
    assert "4 to 20 mA" in " ".join(valve["provenance"]["decisions"])


def test_a_curve_from_op_to_stroke_is_proposed_and_used(stemwatch, tmp_path: Path) -> None:
    """The proposed key, pasted, is what the valve is then read through."""
    seen = stemwatch("inspect", split_range(tmp_path))
    assert seen.status == 0, seen.said
    plant = tmp_path / "plant.toml"
    plant.write_text(proposal(seen.out), encoding="utf-8")
    loaded = load_plant(plant)
    assert loaded.problems == ()
    curve = loaded.valves["FIC-104"].given_curve.curve
    op = np.linspace(70.0, 80.0, 9)
    np.testing.assert_allclose(curve.command(op), 2.0 * (op - 50.0), atol=2.5)

    valve = the_valve_screened(stemwatch, plant)
    assert valve["verdict"] == "sticky"
    assert "The plant file gives this curve." in " ".join(valve["provenance"]["decisions"])
    assert valve["mismatch"]["stroke_curve"]["proposal"] == ""


def test_the_tables_show_what_was_understood(stemwatch, one_valve: Path) -> None:
    """Encoding, window, interval, and each tag with role and unit are printed."""
    outcome = stemwatch("inspect", one_valve)
    assert outcome.status == 0
    for fact in ("utf-8", "2026-03-02 06:00:00+00:00", "FIC-104.ZT", "t/h", "900"):
        assert fact in outcome.said


def test_a_tag_named_mv_is_not_guessed(stemwatch, tmp_path: Path) -> None:
    """A lone MV column is proposed neither as command nor as position, and the text asks."""
    rows = [
        f"2026-03-02T06:{k // 60:02}:{k % 60:02}Z,{50 + k % 7},{20 + k % 5}" for k in range(300)
    ]
    file = tmp_path / "loop.csv"
    file.write_text("\n".join(["Time,FC7.MV,FC7.PV", *rows]), encoding="utf-8")
    outcome = stemwatch("inspect", file)
    assert outcome.status == 0
    assert "Not proposed, because the controller output (OP) is not certain" in outcome.said
    assert "[[valves]]" not in proposal(outcome.out)


def test_json_holds_everything_that_was_found(stemwatch, one_valve: Path, tmp_path: Path) -> None:
    """--json writes the inspection with every tag and its evidence."""
    file = tmp_path / "seen.json"
    outcome = stemwatch("inspect", one_valve, "--json", file)
    assert outcome.status == 0
    seen = json.loads(file.read_text(encoding="utf-8"))
    assert {"OP", "ZT", "PV", "SP", "MODE"} == {t["tag"].split(".")[1] for t in seen["tags"]}
    assert seen["interval_s"] == 1.0
    assert seen["start"] == "2026-03-02T06:00:00+00:00"


@pytest.mark.long
def test_a_redirected_proposal_is_whole_toml(
    stemwatch_process, one_valve: Path, tmp_path: Path
) -> None:
    """In a narrow terminal or a pipe no line of the proposal is cut or wrapped."""
    deep = tmp_path / ("a folder with a rather long name, as plants have them " * 2).strip()
    deep.mkdir()
    file = deep / "export of the whole unit 4711, last week.csv"
    file.write_bytes(one_valve.read_bytes())
    outcome = stemwatch_process("inspect", file, env={"COLUMNS": "60"})
    assert outcome.status == 0, outcome.err
    mapping = tomllib.loads(proposal(outcome.out))
    assert str(file) == mapping["sources"][0]["path"]


def test_a_file_that_is_no_recording_is_refused(stemwatch, tmp_path: Path) -> None:
    """A file without a row of numbers ends with 2 and says what was expected."""
    file = tmp_path / "notes.csv"
    file.write_text("who,what\nAnna,packing\nBert,seat\n", encoding="utf-8")
    outcome = stemwatch("inspect", file)
    assert outcome.status == 2
    assert "notes.csv" in outcome.said
    assert "Expected" in outcome.said


def test_a_file_that_is_not_there_is_wrong_usage(stemwatch, tmp_path: Path) -> None:
    """The message names the file."""
    outcome = stemwatch("inspect", tmp_path / "gone.csv")
    assert outcome.status == 2
    assert "there is no file" in outcome.said
    assert "gone.csv" in outcome.said


def test_a_wrong_decimal_mark_is_wrong_usage(stemwatch, one_valve: Path) -> None:
    """An option that makes no sense ends with 2 and a sentence, not with a traceback."""
    outcome = stemwatch("inspect", one_valve, "--decimal", "x")
    assert outcome.status == 2
    assert "decimal" in outcome.said
    assert "Traceback" not in outcome.said


def test_a_plant_file_is_written_beside_the_export_or_elsewhere_and_never_over_another(
    stemwatch, one_valve: Path, tmp_path: Path
) -> None:
    """It loads and screens from any folder, and what a person has filled in is not lost."""
    beside, elsewhere = one_valve.parent / "written.toml", tmp_path / "far" / "plant.toml"
    elsewhere.parent.mkdir()
    for plant in (beside, elsewhere):
        seen = stemwatch("inspect", one_valve, "--write", plant)
        assert seen.status == 0, seen.said
        assert f"stemwatch screen --plant {plant}" in seen.out
        loaded = load_plant(plant)
        assert loaded.problems == ()
        results = tmp_path / f"{plant.parent.name}.json"
        command = ("screen", "--plant", plant, "--out", tmp_path / "out", "--json", results)
        assert stemwatch(*command, "--workers", 1).status == 0
        (valve,) = json.loads(results.read_text(encoding="utf-8"))
        assert ("FIC-104", "sticky") == (valve["valve"], valve["verdict"])
    beside.write_text("# filled in by hand\n", encoding="utf-8")
    repeated = stemwatch("inspect", one_valve, "--write", beside)
    assert repeated.status == 2
    assert "is not overwritten" in repeated.said
    assert beside.read_text(encoding="utf-8") == "# filled in by hand\n"
    beside.unlink()


def files_of_each_valve(plant_file: Path) -> dict[str, list[str]]:
    """Which files the written plant file reads each valve from, as a run plans it."""
    loaded = load_plant(plant_file)
    assert loaded.problems == ()
    planned: dict[str, list[str]] = {}
    for task in make_plan(Request(plant=loaded)).tasks:
        assert task.reason == "", task.reason
        planned.setdefault(task.tags.valve, []).append(Path(task.path).name)
    return planned


@pytest.mark.parametrize("beside", [True, False])
def test_a_folder_of_daily_files_is_one_source(
    stemwatch, one_valve: Path, tmp_path: Path, beside: bool
) -> None:
    """By a pattern, so that tomorrow's file is read too; a note among them is said and left out,
    and a bracket in the folder's name is no pattern."""
    folder = tmp_path / "exports [unit 100]"
    folder.mkdir()
    for day in ("monday.csv", "tuesday.csv"):
        (folder / day).write_bytes(one_valve.read_bytes())
    (folder / "notes.txt").write_text("who did what\n", encoding="utf-8")
    plant = (folder if beside else tmp_path) / "plant.toml"
    seen = stemwatch("inspect", folder, "--write", plant)
    assert seen.status == 0, seen.said
    assert "notes.txt" in seen.said
    assert files_of_each_valve(plant) == {"FIC-104": ["monday.csv", "tuesday.csv"]}
    (folder / "wednesday.csv").write_bytes(one_valve.read_bytes())
    assert files_of_each_valve(plant)["FIC-104"][-1] == "wednesday.csv"


def test_a_folder_whose_files_name_their_tags_alike_has_a_source_for_each(
    stemwatch, tmp_path: Path
) -> None:
    """A tag OP in every file is another valve in every file, each read from its own."""
    rows = [
        f"2026-03-02T06:{k // 60:02}:{k % 60:02}Z,{50 + k % 7},{50 + k % 5}" for k in range(300)
    ]
    for valve in ("FIC-1", "FIC-2"):
        text = "\n".join(["Time,OP,ZT", *rows])
        (tmp_path / f"{valve}.csv").write_text(text, encoding="utf-8")
    plant = tmp_path / "plant.toml"
    seen = stemwatch("inspect", tmp_path, "--write", plant)
    assert seen.status == 0, seen.said
    assert files_of_each_valve(plant) == {"FIC-1": ["FIC-1.csv"], "FIC-2": ["FIC-2.csv"]}


def test_how_a_file_is_read_stands_in_the_plant_file(stemwatch, tmp_path: Path) -> None:
    """What had to be said on the command line need not be said again."""
    text = "\n".join(["OP;ZT", *(f"{50 + k % 7},5;{50 + k % 5},5" for k in range(300))])
    (tmp_path / "FIC-1.csv").write_text(text, encoding="utf-8")
    plant = tmp_path / "plant.toml"
    answer = ("--interval-s", "2", "--decimal", ",", "--separator", ";")
    seen = stemwatch("inspect", tmp_path / "FIC-1.csv", *answer, "--write", plant)
    assert seen.status == 0, seen.said
    loaded = load_plant(plant)
    assert loaded.problems == ()
    assert loaded.read_options("historian") == {"interval_s": 2.0, "decimal": ",", "separator": ";"}
    (task,) = make_plan(Request(plant=loaded)).tasks
    assert task.reason == ""


def test_an_empty_folder_says_so(stemwatch, tmp_path: Path) -> None:
    """Nothing is written."""
    seen = stemwatch("inspect", tmp_path, "--write", tmp_path / "plant.toml")
    assert seen.status == 2
    assert seen.said.count("the folder is empty") == 1
    assert "Usage" not in seen.said
    assert not (tmp_path / "plant.toml").exists()


@pytest.fixture
def pi_file(tmp_path: Path) -> Iterator[tuple[Path, Served]]:
    """A plant file with nothing but a PI server, and the server: two loops and what is none."""
    names = ("FIC-101.OP", "FIC-101.PV", "FIC-101.SP", "ZT-101", "LIC-7.OUT", "LIC-7.MV", "TI-9")
    units = {"FIC-101.OP": "%", "FIC-101.PV": "t/h"}
    points: dict[str, list[dict[str, Any]]] = {name: [] for name in names}
    ranges = {"FIC-101.PV": (0.0, 40.0), "FIC-101.OP": (0.0, 100.0)}
    with serving(Served(points=points, units=units, ranges=ranges)) as served:
        file = tmp_path / "pi.toml"
        file.write_text(
            f'# our plant\n[[sources]]\nname = "pi"\nkind = "pi"\nurl = "{served.url}"\n'
            f'server = "{ARCHIVE}"\nsign_in = "anonymous"\n',
            encoding="utf-8",
        )
        yield file, served


def test_valves_of_a_pi_server_are_proposed_from_the_names_of_its_points(
    stemwatch, pi_file: tuple[Path, Served]
) -> None:
    """By the rules of the files: a position by its number, no guess at MV, ranges of the points.
    What is written is the plant file that was given and the valves, and it loads."""
    file, served = pi_file
    plant = file.with_name("plant.toml")
    seen = stemwatch("inspect", file, "--write", plant)
    assert seen.status == 0, seen.said
    assert "pi: 7 tags, 2 valves by their names" in seen.said
    text = plant.read_text(encoding="utf-8")
    assert text.startswith("# our plant\n")
    loaded = load_plant(plant)
    assert loaded.problems == ()
    tags = loaded.valves["FIC-101"].tags
    names = [tag.tag for tag in (tags.op, tags.mv, tags.pv, tags.sp)]
    assert names == ["FIC-101.OP", "ZT-101", "FIC-101.PV", "FIC-101.SP"]
    assert (tags.pv.low, tags.pv.high, tags.pv.unit) == (0.0, 40.0, "t/h")
    assert loaded.valves["LIC-7"].tags.mv is None
    assert "which tag is the measured position (MV) of LIC-7? (perhaps LIC-7.MV)" in text
    assert served.methods == {"GET"}

    again = stemwatch("inspect", plant)
    assert again.status == 0, again.said
    assert "No new valve is proposed: " in again.said
    assert "has all of these" in again.said


def test_a_pattern_for_an_opc_ua_server_is_held_against_the_names_of_its_nodes(
    stemwatch, tmp_path: Path
) -> None:
    """Node ids begin with a namespace, which nobody writes into a pattern."""
    pytest.importorskip("asyncua", reason="asyncua is missing: OPC UA IS NOT TESTED")
    from tests.connectors.opcua.loopback_server import serving as serving_opcua

    file = tmp_path / "opcua.toml"
    nodes: dict[str, list] = {"FIC-101.OP": [], "FIC-101.PV": [], "LIC-7.OUT": []}
    with serving_opcua(nodes) as (url, _):
        file.write_text(
            f'[[sources]]\nname = "dcs"\nkind = "opcua"\nurl = "{url}"\n', encoding="utf-8"
        )
        seen = stemwatch("inspect", file, "--pattern", "FIC*", "--write", tmp_path / "plant.toml")
    assert seen.status == 0, seen.said
    assert "dcs: 2 tags, 1 valve by their names" in seen.said
    (valve,) = load_plant(tmp_path / "plant.toml").valves.values()
    assert (valve.id, valve.tags.op.tag) == ("FIC-101", "ns=2;s=FIC-101.OP")


def test_where_the_plant_file_has_every_valve_of_its_archive_nothing_is_to_be_added(
    stemwatch, pi_file: tuple[Path, Served]
) -> None:
    """No empty proposal; what is next is to screen them."""
    file, _ = pi_file
    plant = file.with_name("plant.toml")
    assert stemwatch("inspect", file, "--pattern", "FIC*", "--write", plant).status == 0
    again = stemwatch("inspect", plant, "--pattern", "FIC*")
    assert again.status == 0, again.said
    assert "has all of these" in again.said
    assert "Proposed for plant.toml" not in again.said
    assert "add this to" not in again.said
    assert f"stemwatch screen --plant {plant}" in again.said


def test_only_points_that_fit_the_pattern_are_asked_for(
    stemwatch, pi_file: tuple[Path, Served], tmp_path: Path
) -> None:
    """The server itself is given the pattern; JSON has the tags that were found."""
    file, served = pi_file
    found = tmp_path / "tags.json"
    seen = stemwatch("inspect", file, "--pattern", "LIC*", "--source", "pi", "--json", found)
    assert seen.status == 0, seen.said
    assert any("nameFilter=LIC" in asked for asked in served.asked)
    names = [info["tag"] for info in json.loads(found.read_text(encoding="utf-8"))["pi"]]
    assert names == ["LIC-7.MV", "LIC-7.OUT"]
    assert "FIC-101" not in seen.out


def test_many_points_are_found_page_by_page(stemwatch, pi_file: tuple[Path, Served]) -> None:
    """More valves than a page of points, or a terminal, holds; each once."""
    file, served = pi_file
    served.points |= {f"FIC-{number}.OP": [] for number in range(2000, 3500)}
    plant = file.with_name("plant.toml")
    seen = stemwatch("inspect", file, "--write", plant)
    assert seen.status == 0, seen.said
    assert "1502 valves by their names" in seen.said
    assert len(tomllib.loads(plant.read_text(encoding="utf-8"))["valves"]) == 1502


@pytest.mark.parametrize(
    ("arguments", "fault", "message"),
    [
        ((), (401, {}, {"Message": "Authorization has been denied."}), "check sign_in, the user"),
        ((), (200, {}, {"Errors": ["The archive is offline."]}), "The archive is offline"),
        (("--source", "pa"), None, "has no archive 'pa'; its archives are 'pi'"),
        (("--write", "elsewhere/plant.toml"), None, "name a file beside it"),
    ],
)
def test_what_hinders_an_inspection_of_pi_is_said(
    stemwatch, pi_file: tuple[Path, Served], arguments, fault, message: str
) -> None:
    """Refused, an error inside a success, a wrong name: nothing is written."""
    file, served = pi_file
    served.faults += [fault] if fault else []
    before = sorted(file.parent.iterdir())
    seen = stemwatch("inspect", file, "--write", file.with_name("p.toml"), *arguments)
    assert seen.status == 2
    assert message in seen.said
    assert sorted(file.parent.iterdir()) == before


def test_a_plant_file_without_archives_and_a_pattern_for_a_file(
    stemwatch, one_valve: Path, tmp_path: Path
) -> None:
    """Each is told what the other needs."""
    empty = tmp_path / "empty.toml"
    empty.write_text('[plant]\nname = "x"\n', encoding="utf-8")
    assert 'kind = "pi"' in stemwatch("inspect", empty).said
    assert "are for archives" in stemwatch("inspect", one_valve, "--pattern", "F*").said


def test_an_option_that_no_file_needs_is_not_proposed(stemwatch, tmp_path: Path) -> None:
    """It would be kept in the plant file and never be used; the one that is needed stays."""
    rows = "".join(f"2026-03-02T06:{m:02d}:00;{m}.5\n" for m in range(40))
    (tmp_path / "dated.csv").write_text("Time;FIC-1.OP\n" + rows)
    options = ("--interval-s", "5", "--zone", "Europe/Berlin")
    plant = tmp_path / "plant.toml"
    seen = stemwatch("inspect", tmp_path / "dated.csv", *options, "--write", plant)
    assert seen.status == 0
    assert "interval_s = 5 is not used" in " ".join(seen.out.split())
    assert "interval_s" not in plant.read_text()
    assert 'zone = "Europe/Berlin"' in plant.read_text()


def test_a_parquet_file_is_sent_to_its_plant_file(stemwatch, tmp_path: Path) -> None:
    """It is an archive, and no export that could be read alone."""
    (tmp_path / "day.parquet").write_bytes(b"PAR1" + bytes(range(256)))
    seen = stemwatch("inspect", tmp_path / "day.parquet")
    assert seen.status != 0
    assert 'a Parquet file, which is read through a plant file: kind = "parquet"' in " ".join(
        (seen.out + seen.err).split()
    )
