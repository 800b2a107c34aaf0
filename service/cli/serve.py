"""``stemwatch serve`` and ``stemwatch run-now``: the service, and a run of its queue by hand."""

from __future__ import annotations

import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stemwatch.service.cli import options as o

if TYPE_CHECKING:
    from stemwatch.service.config import Plant
    from stemwatch.service.run.queue_worker import QueueWorker
    from stemwatch.service.store.screenings.records import StoredRun
    from stemwatch.service.store.store import Store

PlantFile = Annotated[Path, typer.Option(help="plant.toml with sources, valves and schedules.")]
_LOOK_S = 0.5
_AWAY_S = 600.0  # that the database of a service may stay away while its run is waited for


def serve(
    plant: PlantFile = Path("plant.toml"),
    host: Annotated[str, typer.Option(help="Address to listen on.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port; 0 takes a free one.")] = 8300,
    allow_host: Annotated[
        list[str] | None,
        typer.Option(help="A further name under which browsers reach this machine."),
    ] = None,
    json_logs: Annotated[
        bool, typer.Option("--json-logs", help="Logs as one JSON object a line.")
    ] = False,
) -> None:
    """Run the service: collect, screen on schedule, raise alerts, serve the pages.

    It stops in order on SIGTERM and Ctrl-C. Killed at any moment it loses nothing: the next start
    finishes what was begun. Where nobody can sign in yet it prints a one-time link for the
    first admin.
    """
    from stemwatch.service.cli import views
    from stemwatch.service.logs import set_up_logs
    from stemwatch.service.process_lifecycle import on_stop_signal
    from stemwatch.service.serve import ListenAddress, Service
    from stemwatch.service.serve.plant_secrets import hide_secrets

    loaded = _load(plant)
    set_up_logs(as_json=json_logs)
    hide_secrets(loaded)
    stop = threading.Event()
    address = ListenAddress(host=host, port=port, hosts=tuple(allow_host or ()))

    def ready(address: str) -> None:
        # With soft_wrap the address stays on one line, whatever reads it.
        views.out.print(f"Serving {address}", highlight=False, soft_wrap=True)

    def invite(link: str) -> None:
        sentence = "Nobody can sign in yet. Within 24 hours this link makes the first admin, once:"
        views.out.print(sentence, highlight=False)
        views.out.print(views.escape(link), highlight=False, soft_wrap=True)

    with on_stop_signal(stop.set, last=True):
        Service(loaded, address, logs_as_json=json_logs).run(stop, ready, invite)


def run_now(
    valve: Annotated[list[str] | None, typer.Argument(help="Valves; all where left out.")] = None,
    plant: PlantFile = Path("plant.toml"),
    wait: Annotated[
        bool, typer.Option("--wait/--no-wait", help="Wait until the run is over.")
    ] = True,
    who: Annotated[str, typer.Option(help="Who asks for it.")] = "",
    site: o.Site = None,
    area: o.Area = None,
    unit: o.Unit = None,
) -> None:
    """Screen now, without waiting for a schedule.

    Where a service runs on the same database it does the work; otherwise this command does, with
    alerts, messages and report as on a schedule. Asked to stop (SIGTERM, Ctrl-C), it leaves the run
    to the service, or to the next one that starts.
    """
    from stemwatch.connectors.connector import nearest_names
    from stemwatch.service import __version__
    from stemwatch.service.alerts.notifiers import notifiers_of
    from stemwatch.service.alerts.sender import Sender
    from stemwatch.service.cli import views
    from stemwatch.service.cli.reading import part_of, valves_in_part
    from stemwatch.service.process_lifecycle import on_stop_signal
    from stemwatch.service.run.queue_worker import QueueWorker
    from stemwatch.service.serve.periodic_tasks import LEASE
    from stemwatch.service.store.runs.queue import RunToQueue
    from stemwatch.service.store.store import open_store

    loaded = _load(plant)
    if unknown := [name for name in valve or () if name not in loaded.valves]:
        raise typer.BadParameter(
            f"there is no valve {unknown[0]!r} in {plant}; nearest: "
            f"{nearest_names(unknown[0], list(loaded.valves)) or 'none'}",
            param_hint="VALVE",
        )
    in_part = valves_in_part(loaded, part_of(site, area, unit))
    valves = tuple(dict.fromkeys((*(valve or ()), *in_part)))
    stop = threading.Event()
    with on_stop_signal(stop.set, last=True), open_store(loaded.storage) as store:
        run = RunToQueue(valves=valves, who=who or "command line")
        number = store.queue.put(run, software_version=__version__)
        served = store.leases.holder(LEASE) is not None
        if number is None:
            raise typer.Exit(1)
        who_works = (
            "the service works on it" if served else "no service runs here; this command does it"
        )
        views.out.print(f"Run {number} is queued; {who_works}.", highlight=False)
        working = None
        if not served:
            worker = QueueWorker(store, loaded)
            working = threading.Thread(target=_work, args=(worker, stop))
            working.start()
        try:
            if wait or working is not None:
                _follow(store, number, working, stop)
        finally:
            stop.set()
            if working is not None:
                working.join()
        result = store.run(number)
        if working is not None and result.finished is not None:
            # No service is there that would send them, and try again what was not taken before.
            Sender(store, notifiers_of(loaded)).send_due()
        if wait or working is not None:
            _show(result)


def _load(plant: Path) -> Plant:
    from stemwatch.service.cli import views
    from stemwatch.service.config import load_plant

    loaded = load_plant(o.need_file(plant, "--plant"))
    for problem in loaded.problems:
        views.say_error(str(problem))
    return loaded


def _work(worker: QueueWorker, stop: threading.Event) -> None:
    """Process the queue until it is empty; earlier runs are done first."""
    from stemwatch.service.store.errors import StoreError

    try:
        while not stop.is_set() and worker.once(stop):
            pass
    except StoreError as error:
        from stemwatch.service.cli import views

        views.say_error(str(error))


def _follow(
    store: Store, number: int, working: threading.Thread | None, stop: threading.Event
) -> None:
    """Wait until the run is over, or until ``stop``, with its progress shown.

    A service goes on with the run when its database is back, so the wait goes on too. Raises
    ``StoreError`` where it stays away for ``_AWAY_S``, and at once where this command does the
    work.
    """
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeRemainingColumn

    from stemwatch.service.cli import views
    from stemwatch.service.store.errors import StoreError

    columns = (BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=views.err, transient=True) as progress:
        bar = progress.add_task("run", total=None)
        answered, is_told = time.monotonic(), False
        while not stop.wait(_LOOK_S):
            try:
                run = store.run(number)
            except StoreError as error:
                if working is not None or time.monotonic() - answered > _AWAY_S:
                    raise
                if not is_told:
                    is_told = True
                    views.say(f"{error} The service goes on with run {number} when it is back.")
                continue
            answered, is_told = time.monotonic(), False
            progress.update(bar, completed=run.done, total=run.total or None)
            if run.finished is not None or (working is not None and not working.is_alive()):
                return


def run_sentence(run: StoredRun) -> str:
    """How a run went. A valve whose source is many files has several recordings, each with its
    verdict."""
    counts = ", ".join(f"{count} {verdict.value}" for verdict, count in run.counts.items())
    recordings = sum(run.counts.values())
    several = f"{recordings} recordings: " if recordings > run.done else ""
    sentence = (
        f"Run {run.id}: {run.state.value}, {run.done} of {run.total} valves "
        f"({several}{counts or 'none'})"
    )
    if run.set_aside:
        sentence += f", {run.set_aside} set aside"
    return sentence + (f". {run.reason}" if run.reason else "")


def _show(run: StoredRun) -> None:
    from stemwatch.service.cli import views

    if run.finished is None:
        so_far = f" after {run.done} of {run.total} valves" if run.total else ""
        views.out.print(
            f"Run {run.id} is left{so_far}: the service goes on with it, or the next one that "
            "starts, or the next run-now.",
            highlight=False,
        )
        raise typer.Exit(1)
    views.out.print(run_sentence(run), highlight=False)
    if run.report:
        views.out.print(f"Report: {views.escape(run.report)}", highlight=False, soft_wrap=True)
    if run.state.value in ("failed", "cancelled"):
        raise typer.Exit(1)
    views.say_next(
        "open the report; the work orders lie beside it, and alerts, if any, stand on the pages of "
        "`stemwatch serve`."
    )
