"""What every command says of itself."""

from __future__ import annotations

import inspect
import re

import pytest

from stemwatch.service import __version__
from stemwatch.service.cli import app

COMMANDS = {
    "inspect": "propose a mapping for plant.toml",
    "screen": "Screening the same window twice updates",
    "simulate": "truth beside it",
    "demo": "leave a report",
    "trial": "Count right and wrong verdicts",
    "alert-trial": "Play months of a simulated plant",
    "prove-weeks": "Count what windows of weeks confirm",
    "robustness": "Count right and wrong answers",
    "miswiring": "Count confident wrong answers",
    "maintenance": "new baseline",
}


@pytest.mark.parametrize(("command", "says"), COMMANDS.items())
def test_each_command_explains_itself(stemwatch, command: str, says: str) -> None:
    """--help of every command ends with 0 and says what the command is for."""
    outcome = stemwatch(command, "--help")
    assert outcome.status == 0
    assert f"stemwatch {command}" in outcome.said
    assert says in outcome.said


@pytest.mark.parametrize("command", ["simulate", "maintenance", "maintenance-report"])
def test_a_command_that_reads_no_export_does_not_say_how_it_is_read(
    stemwatch, command: str
) -> None:
    """Its zone is that of what is written, shown or given on the command line."""
    assert "How the file is read" not in stemwatch(command, "--help").said


def test_help_lists_every_command_and_the_exit_status(stemwatch) -> None:
    """The program's own help names all commands and what each exit status means."""
    outcome = stemwatch("--help")
    assert outcome.status == 0
    assert [name for name in COMMANDS if name not in outcome.said] == []
    assert "2 wrong usage or a source that cannot be read" in outcome.said


def test_version_is_the_installed_one(stemwatch) -> None:
    """--version prints the version of the installed package and nothing else."""
    outcome = stemwatch("--version")
    assert (0, f"stemwatch {__version__}") == (outcome.status, outcome.said)


def test_an_unknown_command_is_wrong_usage(stemwatch) -> None:
    """A misspelt command ends with 2 and names the one that was probably meant."""
    outcome = stemwatch("scren")
    assert outcome.status == 2
    assert "'screen'" in outcome.said


def test_help_does_not_load_the_numerical_libraries(stemwatch_process) -> None:
    """--help stays quick: neither tables nor networks nor kernels are imported for it."""
    outcome = stemwatch_process("--help", env={"PYTHONPROFILEIMPORTTIME": "1"})
    assert outcome.status == 0
    loaded = {line.rpartition("|")[2].strip() for line in outcome.err.splitlines()}
    assert "typer" in loaded
    assert loaded & {"torch", "pandas", "numba", "scipy", "sqlalchemy"} == set()


@pytest.mark.parametrize("command", app.registered_commands, ids=lambda one: one.callback.__name__)
def test_each_command_ends_with_what_to_do_next(command) -> None:
    """The module of every command says what comes after it."""
    said = inspect.getsource(inspect.getmodule(command.callback))
    assert re.search(r"\.(say_next|say_read_on|say_plant_written)\(", said)
