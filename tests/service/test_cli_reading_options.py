"""No reading option of any command is silently ignored."""

from __future__ import annotations

from pathlib import Path

import pytest
import typer
from typer.core import TyperGroup

from stemwatch.service.cli import app
from stemwatch.service.cli.options import READING

# How each command with reading options is called on a file.
CALLS = {
    "inspect": ("inspect", "{file}"),
    "screen": ("screen", "{file}", "--op", "A.OP", "--out", "{out}"),
    "explain": ("explain", "{file}", "--op", "A.OP", "--mv", "A.MV", "--no-narx"),
    "compare": ("compare", "{file}", "--op", "A.OP", "--mv", "A.MV", "--no-narx"),
    "plan-test": ("plan-test", "{file}", "--op", "A.OP", "--mv", "A.MV"),
    "twin": ("twin", "{file}", "--op", "A.OP", "--mv", "A.MV"),
    "judge-test": ("judge-test", "{file}", "{file}", "--op", "A.OP", "--mv", "A.MV"),
}
# What a file of dates with offsets does not need, and how the sentence begins.
NEEDLESS = {
    "--zone": (("--zone", "Europe/Berlin"), "zone = 'Europe/Berlin' is not used: "),
    "--day-first": (("--day-first",), "day_first = True is not used: "),
    "--interval-s": (("--interval-s", "20"), "interval_s = 20 is not used: "),
}
# What every file is read by; a column, format or mark that is not in it is an error.
ALWAYS = {"--encoding", "--separator", "--decimal", "--time-column", "--time-format"}


def reading_options() -> dict[str, set[str]]:
    """The reading options of every command."""
    root = typer.main.get_command(app)
    assert isinstance(root, TyperGroup)
    results = {}
    for name, command in root.commands.items():
        options = {
            parameter.opts[0]
            for parameter in command.params
            if getattr(parameter, "rich_help_panel", None) == READING
        }
        if options:
            results[name] = options
    return results


def test_every_reading_option_of_every_command_has_a_case() -> None:
    """A command or an option that is added later is asked the same."""
    result = reading_options()
    assert set(result) == set(CALLS)
    assert set.union(*result.values()) == set(NEEDLESS) | ALWAYS


@pytest.fixture
def export(tmp_path: Path) -> Path:
    """Too short to be fitted, so that every command answers at once."""
    rows = "".join(
        f"2026-03-02T06:{row // 60:02d}:{row % 60:02d}+00:00;{row % 7}.5;{row % 7}.25\n"
        for row in range(90)
    )
    file = tmp_path / "loop.csv"
    file.write_text("Time;A.OP;A.MV\n" + rows)
    return file


@pytest.mark.parametrize("command", CALLS)
def test_an_option_that_is_not_used_is_said_on_the_terminal(
    stemwatch, export: Path, tmp_path: Path, command: str
) -> None:
    """All needless options of a command at once: a sentence for each, with the reason."""
    expected = [case for option, case in NEEDLESS.items() if option in reading_options()[command]]
    call = [part.format(file=export, out=tmp_path / "report") for part in CALLS[command]]
    outcome = stemwatch(*call, *(part for given, _ in expected for part in given))
    text = " ".join(outcome.said.split())
    assert expected
    assert [begins for _, begins in expected if begins not in text] == []


ERRORS = {
    "a plant's own sources": (
        ("screen", "--plant", "{plant}", "--interval-s", "20"),
        "--interval-s says how the files on the command line are read, and there are none",
    ),
    "a plant's own sources and a zone": (
        ("explain", "--plant", "{plant}", "--zone", "Europe/Berlin"),
        "--zone says how the files on the command line are read",
    ),
    "tags beside a plant": (
        ("screen", "{file}", "--plant", "{plant}", "--op", "A.OP"),
        "--op is for files without a plant file",
    ),
    "a valve that the plant does not have": (
        ("screen", "--plant", "{plant}", "--valve", "A"),
        "there is no valve 'A' among the 0 of",
    ),
    "a name without tags": (("screen", "{file}", "--valve", "A"), "--valve names the valve whose"),
    "a column that is not there": (
        ("inspect", "{file}", "--time-column", "Stamp"),
        "there is no column 'Stamp' to take the time from",
    ),
    "a valve of the store": (
        ("plan-test", "FIC-101", "--db", "sqlite:///none.db", "--interval-s", "20"),
        "--interval-s says how a file is read, and FIC-101 is not a file",
    ),
}


@pytest.mark.parametrize(("call", "says"), ERRORS.values(), ids=ERRORS.keys())
def test_an_option_that_nothing_could_ask_for_is_wrong_usage(
    stemwatch, export: Path, tmp_path: Path, call: tuple[str, ...], says: str
) -> None:
    """Where no file can need it, the command does not begin."""
    plant = tmp_path / "plant.toml"
    plant.write_text('[plant]\nname = "P"\n[[sources]]\nname = "h"\npath = "loop.csv"\n')
    outcome = stemwatch(*(part.format(file=export, plant=plant) for part in call))
    assert outcome.status == 2
    assert says in " ".join(outcome.said.split())
