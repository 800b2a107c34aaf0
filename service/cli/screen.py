"""``stemwatch screen``: a verdict on every valve of an export or a plant file, and the report."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stemwatch.models.verdict import Verdict
from stemwatch.service.cli import options as o
from stemwatch.service.cli.reading import (
    given_by,
    part_of,
    requested,
    say_reading_remarks,
    valves_in_part,
)
from stemwatch.service.presenter.cost_of_sticking import RankBy

if TYPE_CHECKING:
    from stemwatch.service.config import Plant
    from stemwatch.service.report.ranking import Ranking
    from stemwatch.service.run.engine import RunResult
    from stemwatch.service.run.plan import Request
    from stemwatch.service.store.database_url import DatabaseUrl

LONGEST_S = 600.0  # that a valve may take where no plant file says it
NOT_SAVED = 2  # exit status


@given_by(requested, name="request")
def screen(
    request: Request,
    out: Annotated[Path, typer.Option(help="Folder of the report.")] = Path("stemwatch-report"),
    db: Annotated[
        str, typer.Option(help="Database URL; without it the plant's, else a file in --out.")
    ] = "",
    json_file: o.JsonFile = None,
    fail_on: Annotated[
        Verdict | None, typer.Option(help="Exit with 1 when a valve has this verdict.")
    ] = None,
    workers: o.Workers = None,
    executor: o.Executor = "local",
    new_baseline: Annotated[
        bool, typer.Option("--new-baseline", help="Make this window each valve's baseline.")
    ] = False,
    rank_by: Annotated[
        RankBy,
        typer.Option(help="Order: the most urgent first, or what sticking costs most first."),
    ] = RankBy.VERDICT,
    site: o.Site = None,
    area: o.Area = None,
    unit: o.Unit = None,
) -> None:
    """Fit every valve of an export and leave a report, pages to print, work orders and tables.

    Each valve is judged sticky, defective, watch, healthy or undetermined, with the reason. Without
    --plant and --op the roles are taken from tags and descriptions where they leave no doubt.
    Screening the same window twice updates what is stored.
    """
    chosen = valves_in_part(request.plant, part_of(site, area, unit))
    request = replace(request, valves=request.valves or chosen)
    _need_prices(request.plant, rank_by)
    if workers is not None and executor != "local":
        raise typer.BadParameter(
            f"it counts the processes of the executor local, and {executor} has its own",
            param_hint="--workers",
        )
    ranking = _run(
        request,
        out,
        (workers, executor),
        db=db,
        new_baseline=new_baseline,
        json_file=json_file,
        rank_by=rank_by,
    )
    if fail_on is not None and _is_found(fail_on, ranking):
        raise typer.Exit(1)


def _need_prices(plant: Plant | None, rank_by: RankBy) -> None:
    """Wrong usage where an order by cost would be none."""
    if rank_by is RankBy.VERDICT:
        return
    if plant is None or not any(valve.prices for valve in plant.valves.values()):
        where = (
            "give --plant with a plant file that has" if plant is None else "the plant file has no"
        )
        raise typer.BadParameter(
            f"an order by cost needs a price: {where} one of price_per_unit_hour, "
            "price_per_hour_off_target and price_per_stroke of a valve",
            param_hint="--rank-by",
        )


def _is_found(verdict: Verdict, ranking: Ranking) -> bool:
    """Whether a valve or its stem has this verdict, so that ``--fail-on sticky`` also reports the
    sticking stem of a defective valve."""
    return any(verdict in (valve.verdict, valve.screening.verdict) for valve in ranking)


def screen_plant(plant: Path, out: Path, workers: int | None, earlier: Sequence[Path] = ()) -> None:
    """Screen a plant file's own sources into its own database, after the files ``earlier``, of
    which no summary is printed and whose report lies beside them."""
    from stemwatch.service.cli.reading import loaded_plant
    from stemwatch.service.run.plan import Request

    request = Request(plant=loaded_plant(plant, None))
    executor = (workers, "local")
    if earlier:
        before = replace(request, sources=tuple(str(path) for path in earlier))
        _run(before, earlier[0].parent / "report", executor, is_shown=False)
    _run(request, out, executor)


def _run(
    request: Request,
    out: Path,
    workers: tuple[int | None, str],
    *,
    db: str = "",
    new_baseline: bool = False,
    json_file: Path | None = None,
    rank_by: RankBy = RankBy.VERDICT,
    is_shown: bool = True,
) -> Ranking:
    """Screen, write the report and show what was found, in the order of the report.

    ``workers`` is how many there are and the address of their executor; the others are options of
    ``screen``. Results that could not be saved end the command with ``NOT_SAVED`` when all is
    shown: whoever starts it every night must learn that later runs will not know of them.
    """
    from stemwatch.service.executors import LocalProcesses, choose_executor
    from stemwatch.service.process_lifecycle import expect_workers

    plant = request.plant
    timeout_s = plant.service.valve_timeout_s if plant else LONGEST_S
    executor = choose_executor(*workers, item_timeout_s=timeout_s)
    if isinstance(executor, LocalProcesses) and plant and len(plant.valves) > 1:
        expect_workers()

    # Imported only now, while the server process of the workers does its own imports.
    from stemwatch.models.limits import Limits
    from stemwatch.service.cli import screening_views, views
    from stemwatch.service.report.ranking import rank_valves
    from stemwatch.service.run.engine import RunNow, screen_now
    from stemwatch.service.store.database_url import DatabaseUrl
    from stemwatch.service.store.store import open_store

    for problem in plant.problems if plant else ():
        views.say_error(str(problem))
    stored_in = db or (plant.storage if plant else f"sqlite:///{out / 'stemwatch.db'}")
    address = DatabaseUrl(stored_in) if isinstance(stored_in, str) else stored_in
    with (
        _nothing_left_of_nothing(out, address),
        open_store(address) as store,
        screening_views.screening_progress(request.zone) as on_screened,
    ):
        how_to_run = RunNow(
            store=store,
            executor=executor,
            out=out,
            limits=plant.limits if plant else Limits(),
            command=("stemwatch", *sys.argv[1:]),
            new_baseline=new_baseline,
            rank_by=rank_by,
        )
        result: RunResult = screen_now(request, how_to_run, on_screened)
    # What sticking costs is not in the brief screenings.
    screenings = result.brief if rank_by is RankBy.VERDICT else result.screenings
    ranking = rank_valves(screenings, result.context)
    if is_shown:
        show(result, ranking, json_file)
    # What a plant file says of its sources holds for all their files; the report names those that
    # did without.
    if request.sources and is_shown:
        say_reading_remarks(screening.provenance for screening in result.brief)
    if result.not_saved:
        raise typer.Exit(NOT_SAVED)
    return ranking


@contextmanager
def _nothing_left_of_nothing(out: Path, address: DatabaseUrl) -> Iterator[None]:
    """Make the folder of the report. Where nothing could be read, or not even the database be
    opened, what was made for it goes again: a new database without a valve would look like a plant
    without one."""
    from stemwatch.connectors.connector import ConnectorError
    from stemwatch.service.store.database.engine import sqlite_files
    from stemwatch.service.whole_files import make_folder

    database = sqlite_files(address)
    made = () if database and database[0].exists() else database
    folders = [folder for folder in (out, *out.parents) if not folder.exists()]
    make_folder(out)
    try:
        yield
    except Exception as error:
        for file in made if isinstance(error, ConnectorError) else ():
            file.unlink(missing_ok=True)
        for folder in folders:
            with suppress(OSError):  # what holds a file is kept
                folder.rmdir()
        raise


def show(result: RunResult, ranking: Ranking, json_file: Path | None) -> None:
    """The summary, what was left out or not saved, and where report, PDF and work orders are."""
    from stemwatch.service.cli import screening_views, views
    from stemwatch.service.maintenance.write_maintenance import ORDERS_XLSX, PDF

    groups = result.context.groups
    views.out.print(screening_views.summary(ranking))
    for line in (
        *screening_views.undetermined_lines(result.brief, groups),
        *screening_views.oscillation_lines(groups),
        *screening_views.signal_lines(result.brief),
    ):
        views.out.print(line, highlight=False)
    if result.outside_window:
        views.say(result.outside_window)
    for source, reason in result.not_read:
        views.say(f"left out: {source}: {reason}")
    for line in screening_views.not_saved_lines(result.not_saved):
        views.say(line)
    if json_file is not None:
        views.write_file(json_file, result.report.json.read_bytes() + b"\n")
    for label, path in (
        ("Report", result.report.html),
        ("For maintenance, to print", result.report.html.with_name(PDF)),
        ("Work orders", result.report.html.with_name(ORDERS_XLSX)),
    ):
        if path.is_file():
            text = f"{label}: {views.escape(str(path.resolve()))}"
            views.out.print(text, highlight=False, soft_wrap=True)
    views.say_next(screening_views.next_sentence(ranking))
