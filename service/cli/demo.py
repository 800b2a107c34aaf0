"""``stemwatch demo``: the main job on a simulated plant, from nothing to a report; or live."""

from __future__ import annotations

import asyncio
import time
from datetime import timedelta
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stemwatch.service.cli import options as o

if TYPE_CHECKING:
    from stemwatch.service.live_demo import LiveDemo

ZONE = "Europe/Berlin"
LIVE = "The live demo"
# What the run and its report import when they first need it.
NEEDED_LATER = (
    "stemwatch.service.run.engine",
    "stemwatch.service.store.migrations.migrate",
    "stemwatch.service.maintenance.pdf",
    "stemwatch.service.report.xlsx_file",
)


def demo(
    context: typer.Context,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for everything the demo makes: demo, or demo-live where live."),
    ] = None,
    seed: o.Seed = 1,
    workers: o.Workers = None,
    live: Annotated[
        bool, typer.Option("--live", help="Run the service on a plant that wears, until Ctrl-C.")
    ] = False,
    port: Annotated[
        int,
        typer.Option(
            min=0, max=65535, help="Port of the pages; 0 takes a free one.", rich_help_panel=LIVE
        ),
    ] = 8300,
    speed: Annotated[
        float,
        typer.Option(
            min=1.0,
            max=4.0,
            help="Seconds of the plant in one of the clock.",
            rich_help_panel=LIVE,
        ),
    ] = 1.0,
    open_page: Annotated[
        bool, typer.Option("--open", help="Open the pages in a browser.", rich_help_panel=LIVE)
    ] = False,
) -> None:
    """Simulate a small plant, screen its export into SQLite, and leave a report.

    Fifteen valves in closed loops: healthy ones, four shapes of stiction, a badly tuned loop, an
    oscillating disturbance, a quiet loop, and data that is bad in the usual ways. One valve has
    earlier weeks, in which its friction grew; the prices in plant.toml are made up.

    With --live: three valves behind Modbus, one of which wears within minutes, the service that
    watches them, and a catcher for its mails. Record maintenance of the valve, and it is repaired.
    """
    if live:
        o.refuse(context, ("workers",), "the service of the live demo chooses them")
        _live(out or Path("demo-live"), port, speed, seed, open_page)
        return
    o.refuse(context, ("port", "speed", "open_page"), "without --live no service runs")
    _report(out or Path("demo"), seed, workers)


def _report(out: Path, seed: int, workers: int | None) -> None:
    from stemwatch.service.cli import views
    from stemwatch.service.cli.screen import screen_plant
    from stemwatch.service.cli.simulate import START, LoopKind, simulated
    from stemwatch.service.executors import choose_executor
    from stemwatch.service.process_lifecycle import expect_workers

    started = time.perf_counter()
    views.say("1/3  Simulating two hours of a plant with 15 valves ...")
    executor = choose_executor(workers)
    if executor.workers > 1:
        expect_workers()  # its imports and ours side by side
    from stemwatch.models.studies.simulator import simulate_loop, weeks_before
    from stemwatch.service.executors.compile_ahead import compile_ahead
    from stemwatch.service.studies.simulated_export import write_export, write_historian

    with compile_ahead(executor):
        written = write_export(simulated(LoopKind.DEMO, 0, seed), out, start=START, zone=ZONE)
        earlier = [
            write_historian(
                [simulate_loop(loop, seed)],
                out / "earlier" / f"{weeks:g}-weeks-before.csv",
                start=START - timedelta(weeks=weeks),
                zone=ZONE,
            )
            for weeks, loop in weeks_before(seed)
        ]
        for module in NEEDED_LATER:  # while the workers compile
            import_module(module)
    views.say(f"     wrote {written.files[0]} and {written.plant_toml}")
    views.say("2/3  Screening the export, after earlier weeks of one valve ...")
    screen_plant(written.plant_toml, out / "report", workers, earlier)
    views.say(f"3/3  Done in {time.perf_counter() - started:.0f} s. Open the report in a browser.")
    views.say_next(
        "`stemwatch demo --live` shows the service on a valve that wears; an export of your own "
        "begins with `stemwatch inspect FILE`."
    )


def _live(out: Path, port: int, speed: float, seed: int, open_page: bool) -> None:
    import webbrowser

    from stemwatch.service.cli import views
    from stemwatch.service.live_demo import DemoTiming, LiveDemo

    def announce(text: str) -> None:
        # With soft_wrap an address stays on one line, whatever reads it.
        views.out.print(views.escape(text), highlight=False, soft_wrap=True)

    def ready(address: str) -> None:
        if open_page:
            webbrowser.open(address)

    live_demo = LiveDemo(
        out, DemoTiming(speed=speed), port, announce=announce, ready=ready, seed=seed
    )
    asyncio.run(_until_asked(live_demo))


async def _until_asked(live_demo: LiveDemo) -> None:
    """Run the demo until SIGTERM or Ctrl-C."""
    from stemwatch.service.process_lifecycle import on_stop_signal

    stop, loop = asyncio.Event(), asyncio.get_running_loop()
    # Not add_signal_handler, which Windows does not have.
    with on_stop_signal(lambda: loop.call_soon_threadsafe(stop.set), last=True):
        await live_demo.run(stop)
