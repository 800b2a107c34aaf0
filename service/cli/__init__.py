"""The command line ``stemwatch``: one module for each command, registered here."""

from __future__ import annotations

import atexit
import gc
import sys
from collections.abc import Iterator
from inspect import cleandoc

import typer
from typer.models import CommandInfo

from stemwatch.service.cli.accounts import accounts_app
from stemwatch.service.cli.alert_trial import alert_trial
from stemwatch.service.cli.benchmark import benchmark_app
from stemwatch.service.cli.calibrate_limits import calibrate_archives, calibrate_wiring
from stemwatch.service.cli.calibrate_mismatch import calibrate_mismatch
from stemwatch.service.cli.compare import compare
from stemwatch.service.cli.db import db_app
from stemwatch.service.cli.demo import demo
from stemwatch.service.cli.drift import drift
from stemwatch.service.cli.explain import explain
from stemwatch.service.cli.feedback import feedback
from stemwatch.service.cli.inspect import inspect
from stemwatch.service.cli.judge_test import judge_test
from stemwatch.service.cli.maintenance import maintenance
from stemwatch.service.cli.maintenance_report import maintenance_report
from stemwatch.service.cli.miswiring import miswiring
from stemwatch.service.cli.modbus import modbus_app
from stemwatch.service.cli.plan_test import plan_test
from stemwatch.service.cli.prove import prove
from stemwatch.service.cli.prove_weeks import prove_weeks
from stemwatch.service.cli.reproduce import reproduce
from stemwatch.service.cli.robustness import robustness
from stemwatch.service.cli.screen import screen
from stemwatch.service.cli.serve import run_now, serve
from stemwatch.service.cli.simulate import simulate
from stemwatch.service.cli.simulate_archive import simulate_archive
from stemwatch.service.cli.study_oscillations import study_oscillations
from stemwatch.service.cli.study_twin import study_twin
from stemwatch.service.cli.study_wear_forecast import study_wear_forecast
from stemwatch.service.cli.study_without_position import study_without_position
from stemwatch.service.cli.trial import trial
from stemwatch.service.cli.twin import twin
from stemwatch.service.cli.views import say_error

OBJECTS_BETWEEN_COLLECTIONS = 100_000

app = typer.Typer(
    name="stemwatch",
    no_args_is_help=True,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"]},
    pretty_exceptions_show_locals=False,  # locals may hold a database password
)


def _version(wanted: bool) -> None:
    if wanted:
        from stemwatch.service import __version__

        typer.echo(f"stemwatch {__version__}")
        raise typer.Exit


@app.callback()
def _main(
    version: bool = typer.Option(
        False, "--version", callback=_version, is_eager=True, help="Print the version and stop."
    ),
) -> None:
    """Finds sticking control valves in plant-historian data.

    Start with [bold]stemwatch inspect FILE[/] to see what is understood of an export, then
    [bold]stemwatch screen FILE[/] to fit every valve in it and get a report. Nothing is ever
    written to a plant, and nothing is fetched from outside.

    Exit status: 0 done, 2 wrong usage or a source that cannot be read; 1 when a valve has the
    verdict that --fail-on names, when a run failed, or when db check finds something to do.
    """


PLANT, SERVICE, SIMULATED = "Your plant", "Day and night", "Simulated valves"
STUDIES = "How often is it right? (studies on simulated valves)"
COMMANDS = {
    PLANT: (
        inspect,
        screen,
        explain,
        plan_test,
        judge_test,
        twin,
        compare,
        maintenance,
        feedback,
        maintenance_report,
    ),
    SERVICE: (serve, run_now),
    SIMULATED: (demo, simulate, simulate_archive),
    STUDIES: (
        trial,
        prove,
        prove_weeks,
        alert_trial,
        robustness,
        miswiring,
        drift,
        study_wear_forecast,
        study_twin,
        study_without_position,
        study_oscillations,
        calibrate_mismatch,
        calibrate_archives,
        calibrate_wiring,
        reproduce,
    ),
}
for panel, commands in COMMANDS.items():
    for command in commands:
        app.command(rich_help_panel=panel)(command)


app.add_typer(db_app, name="db", rich_help_panel=SERVICE)
app.add_typer(accounts_app, name="accounts", rich_help_panel=SERVICE)
app.add_typer(modbus_app, name="modbus", rich_help_panel=PLANT)
app.add_typer(benchmark_app, name="benchmark", rich_help_panel=STUDIES)


def _commands(group: typer.Typer) -> Iterator[CommandInfo]:
    yield from group.registered_commands
    for inner in group.registered_groups:
        if inner.typer_instance is not None:
            yield from _commands(inner.typer_instance)


def _paragraphs(text: str) -> str:
    """``text`` without the line breaks of the source: the terminal breaks lines by its width."""
    return "\n\n".join(part.replace("\n", " ") for part in cleandoc(text).split("\n\n"))


for info in (*_commands(app), app.registered_callback):
    if info is not None and info.callback is not None:
        info.help = _paragraphs(info.callback.__doc__ or "")


def main() -> None:
    """Run the command line; errors that a user can correct are printed and end with status 2."""
    from stemwatch.connectors.connector import ConnectorError
    from stemwatch.service.config.problems import PlantFileError
    from stemwatch.service.interruption import (
        INTERRUPTED,
        TERMINATED,
        ending_on_signals,
        is_interrupt,
        terminated,
    )
    from stemwatch.service.store.errors import StoreError

    # Loading libraries creates hundreds of thousands of objects, none of them garbage. Collecting
    # every 700 objects took a tenth of a short command's processor time.
    gc.set_threshold(OBJECTS_BETWEEN_COLLECTIONS)
    # A last collection at exit is useless and took a quarter of the time.
    atexit.register(gc.freeze)
    for stream in (sys.stdout, sys.stderr):
        # Consoles and pipes may not support every character of a tag: print ? instead of failing.
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")
    try:
        with ending_on_signals():
            app()
    except (ConnectorError, PlantFileError, StoreError, OSError, ValueError) as error:
        say_error(str(error))
        raise SystemExit(2) from error
    except SystemExit as end:
        if end.code == INTERRUPTED and terminated():
            raise SystemExit(TERMINATED) from None
        raise
    except (KeyboardInterrupt, SystemError) as error:
        if not is_interrupt(error):
            raise
        # Before the command itself began, after its end, or out of a compiled function.
        raise SystemExit(TERMINATED if terminated() else INTERRUPTED) from None
