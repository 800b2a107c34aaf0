"""From sources and tags to tasks: which file, which valve, which tags, or why none."""

from __future__ import annotations

from pathlib import Path

import pytest

from stemwatch.connectors.connector import UnreadableSource
from stemwatch.connectors.historian import ReadOptions
from stemwatch.models.limits import Limits
from stemwatch.models.recording import Role
from stemwatch.service.config import load_plant
from stemwatch.service.presenter.finding import present
from stemwatch.service.report.json_contract import to_contract
from stemwatch.service.run.engine import NothingScreened
from stemwatch.service.run.plan import Request, make_plan
from stemwatch.service.run.task import screen_tasks

LOOPS = "Time,{0}.OP,{0}.ZT\n2026-03-02T06:00:00Z,50,50\n2026-03-02T06:00:01Z,51,50\n"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Exports of two loops, one in a folder below, and notes."""
    (tmp_path / "below").mkdir()
    (tmp_path / "a.csv").write_text(LOOPS.format("FIC-1"), encoding="utf-8")
    (tmp_path / "below" / "b.csv").write_text(LOOPS.format("FIC-2"), encoding="utf-8")
    (tmp_path / "notes.txt").write_text("renewed the packing\n", encoding="utf-8")
    return tmp_path


def test_a_folder_gives_a_task_for_each_valve_in_it(folder: Path) -> None:
    """Folders are searched wholly; what is no recording is left out with the reason."""
    planned = make_plan(Request(sources=(str(folder),)))
    assert [("a.csv", "FIC-1"), ("b.csv", "FIC-2")] == [
        (Path(task.path).name, task.tags.valve) for task in planned.tasks
    ]
    ((name, reason),) = planned.not_read
    assert name.endswith("notes.txt")
    assert "no row of numbers" in reason


def test_a_file_named_twice_is_one_task(folder: Path) -> None:
    """A file that two sources name is screened once."""
    planned = make_plan(Request(sources=(str(folder / "a.csv"), str(folder / "*.csv"))))
    assert ["FIC-1"] == [task.tags.valve for task in planned.tasks]


def test_tags_given_are_asked_of_every_file(folder: Path) -> None:
    """With --op and --mv each file is one valve named after it, whether it has the tags or not."""
    tags = {Role.OP: "FIC-1.OP", Role.MV: "FIC-1.ZT"}
    planned = make_plan(Request(sources=(str(folder),), tags=tags))
    assert ["a", "b"] == [task.tags.valve for task in planned.tasks]
    assert {"FIC-1.OP"} == {task.tags.tags[Role.OP].tag for task in planned.tasks}


def test_a_source_that_names_nothing_is_an_error(tmp_path: Path) -> None:
    """The error repeats the source and shows what would be right."""
    with pytest.raises(UnreadableSource, match=r"gone.*no such file.*exports/\*\.csv"):
        make_plan(Request(sources=(str(tmp_path / "gone.csv"),)))


PLANT = """\
[plant]
zone = "Europe/Berlin"
[[sources]]
name = "wide"
path = "*.csv"
{source}
[[valves]]
id = "FIC-1"
source = "wide"
[valves.tags.op]
tag = "FIC-1.OP"
[valves.tags.mv]
tag = "FIC-1.ZT"
[valves.tags.pv]
tag = "FIC-1.PV"
[[valves]]
id = "FIC-9"
source = "wide"
[valves.tags.op]
tag = "FIC-9.OP"
"""


def plant_in(folder: Path, source: str = ""):
    (folder / "plant.toml").write_text(PLANT.format(source=source), encoding="utf-8")
    return load_plant(folder / "plant.toml")


def test_a_plants_valve_asks_only_for_tags_that_are_there(folder: Path) -> None:
    """A PV that the export lacks is not asked for; a valve in no file has a task that says so."""
    first, second = make_plan(Request(plant=plant_in(folder))).tasks
    assert ("FIC-1", "") == (first.tags.valve, first.reason)
    assert {Role.OP, Role.MV} == set(first.tags.tags)
    assert second.tags.valve == "FIC-9"
    assert "the OP tag FIC-9.OP is in none of the source's files" in second.reason


def test_a_plants_options_hold_for_a_file_named_by_hand(folder: Path) -> None:
    """What the plant says of its source is used, and the command line's word goes before it."""
    plant = plant_in(folder, 'separator = ","\nzone = "Asia/Tokyo"')
    file = str(folder / "a.csv")
    (answer,) = make_plan(Request(sources=(file,), plant=plant)).tasks
    assert (",", "Asia/Tokyo") == (answer.read_options.separator, answer.read_options.zone)
    read_options = ReadOptions(zone="UTC")
    (overruled,) = make_plan(Request(sources=(file,), plant=plant, read_options=read_options)).tasks
    assert (",", "UTC") == (overruled.read_options.separator, overruled.read_options.zone)


def test_a_file_without_the_plants_tags_is_named(folder: Path) -> None:
    """The file is named, and that none of the plant's tags is in it."""
    file = folder / "below" / "b.csv"
    (task,) = make_plan(Request(sources=(str(file),), plant=plant_in(folder))).tasks
    assert f"{file}: none of the plant's OP tags is in it" == task.reason


def test_a_file_of_a_plants_source_that_cannot_be_read_is_named(folder: Path) -> None:
    """Also where other files have all its valves; said once where it may be why one is missing, and
    where it is named by hand."""
    file = folder / "last night.csv"
    file.write_bytes(b"")
    plant = plant_in(folder)
    request = Request(plant=plant, valves=("FIC-1",))
    ((name, reason),) = make_plan(request).not_read
    assert (name, reason.partition(";")[0]) == (str(file), "the file is empty")
    planned = make_plan(Request(plant=plant))
    assert planned.not_read == ()
    assert f"{file}: the file is empty" in planned.tasks[1].reason
    (task,) = make_plan(Request(sources=(str(file),), plant=plant)).tasks
    assert task.reason.startswith(f"{file}: the file is empty")


def test_a_source_without_files_is_left_out_with_the_pattern(folder: Path) -> None:
    """A pattern of the plant file that matches nothing is named, with where it was looked for."""
    (folder / "a.csv").unlink()
    planned = make_plan(Request(plant=plant_in(folder)))
    ((name, reason),) = planned.not_read
    assert name == "wide"
    assert "no file matches *.csv" in reason
    assert {"FIC-1", "FIC-9"} == {task.tags.valve for task in planned.tasks if task.reason}


OP_AND_MV = "Time,OP,{0}\n" + "".join(
    f"2026-03-02T06:00:{row:02d}Z,{50 + row % 7},{50 + row % 5}\n" for row in range(60)
)


def test_a_column_that_may_be_the_position_is_asked_for(tmp_path: Path) -> None:
    """Beside OP a column MV is not read, since nobody said what it is; the task asks, the recording
    keeps the question beside its decisions, and what to do next begins with it."""
    file = tmp_path / "loop.csv"
    file.write_text(OP_AND_MV.format("MV"), encoding="utf-8")
    (task,) = make_plan(Request(sources=(str(file),))).tasks
    assert Role.MV not in task.tags.tags
    question = task.position_question
    assert question.startswith("MV may be the measured position of loop, but the name leaves doubt")
    assert "--mv 'MV'" in question
    (screening,) = screen_tasks([task], Limits(), networks=False)
    assert screening.provenance.position_question == question
    assert question in to_contract(screening)["provenance"]["decisions"]
    assert present(screening, stands=None).next_step.startswith(question)


@pytest.mark.parametrize("column", ["ZT", "FLOW"])
def test_nothing_is_asked_where_no_name_leaves_doubt(tmp_path: Path, column: str) -> None:
    """A position by its name is read, and what says nothing about a position is not asked about."""
    file = tmp_path / "loop.csv"
    file.write_text(OP_AND_MV.format(column), encoding="utf-8")
    (task,) = make_plan(Request(sources=(str(file),))).tasks
    assert task.position_question == ""


def test_a_run_without_a_valve_says_five_reasons_and_how_many_more() -> None:
    """A folder of a thousand files is no page of errors."""
    not_read = [(f"{k}.csv", "no row of numbers.") for k in range(7)]
    text = str(NothingScreened.of([], not_read))
    assert text.endswith("4.csv: no row of numbers; and 2 more reasons.")
    assert str(NothingScreened.of([], not_read[:6])).endswith("; and 1 more reason.")
