"""What a terminal is shown: hostile tags, narrow windows, no colours, progress."""

from __future__ import annotations

import csv
import io
import json
import re
from dataclasses import replace
from datetime import timedelta
from pathlib import Path
from zoneinfo import ZoneInfo

import pytest
from rich.console import Console

from stemwatch.models.estimate import Estimate
from stemwatch.models.screening_result import Screening
from stemwatch.service.cli import screening_views as views
from stemwatch.service.report.ranking import rank_valves
from tests.service.maintenance.example_work_list import context, mixed

HOSTILE = {
    "markup": "[bold red]FIC[/]",
    "an escape sequence": "FIC\x1b[2J\x1b]0;gone\x07",
    "a formula": '=HYPERLINK("http://x")',
    "a page": "<script>alert(1)</script>",
    "a link": "[link=http://x]FIC[/link]",
    "an override of direction": "FIC\u202e401",
    "spaces and umlauts": "Ventil Größe 7 µ",
}

SHORT = ("markup", "an escape sequence")  # screened in the short run


def renamed(export: Path, path: Path, stem: str) -> Path:
    """The export with ``FIC-104`` in its header replaced."""
    with export.open(encoding="utf-8", newline="") as source:
        header, *rows = csv.reader(source)
    with path.open("w", encoding="utf-8", newline="") as out:
        writer = csv.writer(out)
        writer.writerow([cell.replace("FIC-104", stem) for cell in header])
        writer.writerows(rows)
    return path


@pytest.mark.parametrize(
    "stem",
    [
        pytest.param(stem, id=name, marks=[] if name in SHORT else [pytest.mark.long])
        for name, stem in HOSTILE.items()
    ],
)
def test_a_hostile_name_is_shown_and_does_nothing(
    stemwatch, one_valve: Path, tmp_path: Path, stem: str
) -> None:
    """Whatever a valve or its tags are called, it is screened, and no control code gets out."""
    file = renamed(one_valve, tmp_path / "loop.csv", stem)
    outcome = stemwatch(
        "screen", file, "--op", f"{stem}.OP", "--mv", f"{stem}.ZT", "--valve", stem,
        "--out", tmp_path / "out", "--workers", 1,
    )  # fmt: skip
    assert outcome.status == 0, outcome.said
    (valve,) = json.loads((tmp_path / "out" / "valves.json").read_text(encoding="utf-8"))
    assert valve["verdict"] == "sticky"
    assert not set("\x1b\x07\u202e") & set(outcome.out + outcome.err)
    if stem.isprintable():
        assert stem in outcome.said


@pytest.mark.long
def test_inspect_shows_a_hostile_name_and_does_nothing(
    stemwatch, one_valve: Path, tmp_path: Path
) -> None:
    """The tables and the proposed mapping of a file with markup in its tags hold it as text."""
    file = renamed(one_valve, tmp_path / "loop.csv", HOSTILE["markup"])
    outcome = stemwatch("inspect", file)
    assert outcome.status == 0
    assert "[bold red]FIC[/].OP" in outcome.said


@pytest.mark.parametrize("name", ["an escape sequence", "an override of direction"])
def test_inspect_lets_no_control_code_out(
    stemwatch, one_valve: Path, tmp_path: Path, name: str
) -> None:
    """A tag with a control code does not steer the terminal of whoever inspects the file."""
    file = renamed(one_valve, tmp_path / "loop.csv", HOSTILE[name])
    outcome = stemwatch("inspect", file)
    assert outcome.status == 0
    assert not set("\x1b\x07\u202e") & set(outcome.out + outcome.err)


@pytest.mark.long
def test_a_narrow_terminal_without_colours(
    stemwatch_process, small_plant: Path, tmp_path: Path
) -> None:
    """At 60 columns and with NO_COLOR every valve is still listed, within the width, in plain."""
    outcome = stemwatch_process(
        "screen", small_plant.parent / "export" / "historian.csv", "--out", "r",
        "--executor", "in-process",
        cwd=tmp_path, env={"COLUMNS": "60", "NO_COLOR": "1", "TERM": "xterm"},
    )  # fmt: skip
    assert outcome.status == 0, outcome.err
    assert "\x1b" not in outcome.out + outcome.err
    for tag in ("FIC-104", "FIC-107", "FIC-113"):
        assert tag in outcome.said
    table = [line for line in outcome.out.splitlines() if line[:1] in "┏┃┡│└"]
    assert table
    assert max(map(len, table)) <= 60


@pytest.mark.long
def test_an_old_console_shows_question_marks_instead_of_failing(
    stemwatch_process, one_valve: Path, tmp_path: Path
) -> None:
    """Where the console knows no frames and no umlauts, the command still ends well."""
    file = renamed(one_valve, tmp_path / "loop.csv", "Größe")
    outcome = stemwatch_process("inspect", file, env={"PYTHONIOENCODING": "ascii"})
    assert outcome.status == 0, outcome.err
    assert "Gr??e.ZT" in outcome.out


def test_progress_counts_recordings_and_names_those_that_matter(
    stemwatch, export: Path, tmp_path: Path
) -> None:
    """Progress goes to standard error with done, rate and a line for the sticking valve only."""
    outcome = stemwatch("screen", export, "--out", tmp_path, "--workers", 1)
    assert outcome.status == 0
    assert "3/3" in outcome.err
    assert "/s" in outcome.err
    assert re.search(
        r"sticky       FIC-104, 20\d\d-\d\d-\d\d \d\d:\d\d\s+The stem sticks", outcome.err
    )
    assert "FIC-107" not in outcome.err
    assert "3/3" not in outcome.out


def test_reasons_that_are_alike_are_said_once(stemwatch, export: Path, tmp_path: Path) -> None:
    """Below the summary, valves without a verdict are grouped by their reason; one without a
    position by what OP and PV alone say."""
    minutes = ("--to", "2026-03-02T06:03Z")
    outcome = stemwatch("screen", export, *minutes, "--out", tmp_path, "--workers", 1)
    lines = [line for line in outcome.out.splitlines() if line.startswith("undetermined ")]
    assert len(lines) == 1
    both = "undetermined FIC-104, FIC-107  Cannot tell: the recording is too short"
    assert lines[0].startswith(both)
    (alone,) = [line for line in outcome.out.splitlines() if line.startswith("sticking suspected ")]
    assert alone.startswith("sticking suspected FIC-113  ")


@pytest.mark.long
def test_a_folder_named_like_markup_is_shown_as_it_is(
    stemwatch, one_valve: Path, tmp_path: Path
) -> None:
    """The report's place can be copied from the terminal whatever the folder is called."""
    out = tmp_path / "[bold]week 12"
    outcome = stemwatch("screen", one_valve, "--out", out, "--workers", 1)
    assert outcome.status == 0
    assert str(out / "report.html") in outcome.out


@pytest.mark.parametrize("width", [76, 80, 99, 120])
def test_the_ranking_shows_whole_intervals(width: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """An interval of which a part is cut off says something else."""
    wide = Estimate(value=12.34, low=10.87, high=13.56, unit="%")
    matching = [replace(item, S=wide, J=wide) if item.S.value else item for item in mixed()]
    terminal = Console(width=width, file=io.StringIO(), record=True)
    monkeypatch.setattr(views, "out", terminal)
    terminal.print(views.summary(rank_valves(matching, context(matching))))
    text = terminal.export_text()
    assert text.count("(10.9-13.6)") == 2 * sum(item.S.value is not None for item in matching)
    assert "\N{HORIZONTAL ELLIPSIS}" not in text.partition("verdict")[2]
    assert max(map(len, text.splitlines())) <= width


@pytest.mark.parametrize(("width", "named"), [(80, False), (120, True)])
def test_recordings_of_a_valve_are_told_apart_without_long_names(
    width: int, named: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In a narrow terminal by when they begin, where that is enough: the name of a file would be
    folded into a column of ten letters. Two that begin together keep their names everywhere."""
    name = "exports/AREA400-2026-03-01_unit100.csv"
    first = next(item for item in mixed() if item.S.value and item.recording is not None)
    first = replace(first, provenance=replace(first.provenance, source=name))
    later = replace(first.recording, start=first.recording.start + timedelta(days=1))
    terminal = Console(width=width, file=io.StringIO(), record=True)
    monkeypatch.setattr(views, "out", terminal)

    def shown(*matching: Screening) -> str:
        terminal.print(views.summary(rank_valves(list(matching), context(list(matching)))))
        text = terminal.export_text()
        return "".join(line.split("│")[2].strip() for line in text.splitlines() if "│" in line)

    second = replace(first, recording=later)
    assert ("AREA400" in shown(first, second)) is named
    assert "AREA400" in shown(first, replace(first, recording=first.recording))


def test_a_verdict_says_when_its_recording_begins_in_the_zone_of_the_plant() -> None:
    """So that several windows of one valve can be told apart as they are done."""
    screening = next(item for item in mixed() if item.window[0] is not None)
    begins = screening.window[0]
    assert begins is not None
    here = views.verdict_line(screening, ZoneInfo("Asia/Tokyo"))
    assert begins.astimezone(ZoneInfo("Asia/Tokyo")).strftime("%Y-%m-%d %H:%M") in here
    assert begins.strftime("%Y-%m-%d %H:%M") in views.verdict_line(screening, ZoneInfo("UTC"))


def test_results_that_were_not_saved_are_not_said_to_be_left_out() -> None:
    """They stand in the report: one line for each reason, with what follows."""
    full = "not saved: database or disk is full"
    lines = views.not_saved_lines(
        [("FIC-1", full), ("FIC-2", "not saved: locked"), *((f"TIC-{n}", full) for n in range(7))]
    )
    assert lines == [
        f"{full}: FIC-1, TIC-0, TIC-1, TIC-2, TIC-3, TIC-4 and 2 more. The report has these "
        "results; later runs will not know of them.",
        "not saved: locked: FIC-2. The report has these results; later runs will not know of them.",
    ]
