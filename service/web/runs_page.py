"""Runs: what is screened now, how long it will take, what was set aside, and a new one."""

from __future__ import annotations

from urllib.parse import urlencode

from fastapi import APIRouter, HTTPException, Request
from fastapi.responses import HTMLResponse, RedirectResponse

from stemwatch.service.store.screenings.records import RunState, StoredRun
from stemwatch.service.web.actions import LARGEST_NUMBER
from stemwatch.service.web.desk import AtDesk, Desk
from stemwatch.service.web.forms import Sent
from stemwatch.service.web.queries.ranking import read_areas, valves_in
from stemwatch.service.web.queries.run import read_run, read_set_aside
from stemwatch.service.web.reports import TYPES, report_folder
from stemwatch.service.web.visit import AtVisit

MOST_RUNS = 100

router = APIRouter(include_in_schema=False)


def is_alive(run: StoredRun) -> bool:
    """Whether a run waits or goes on."""
    return run.state in (RunState.WAITING, RunState.RUNNING)


@router.get("/runs")
def run_list(request: Request, desk: AtDesk) -> HTMLResponse:
    """What goes on now, then the runs that are over, the newest first."""
    found = desk.store.queue.recent(MOST_RUNS)
    with desk.reading() as session:
        areas = read_areas(session)
    return desk.frame.page(
        request,
        "runs_page.html",
        here="runs",
        open_alerts=desk.open_alerts(),
        going=[run for run in found if is_alive(run)],
        over=[run for run in found if not is_alive(run)],
        schedules=desk.store.schedules.all(),
        areas=areas,
    )


@router.get("/run")
def one_run(request: Request, desk: AtDesk) -> HTMLResponse:
    """One run with the valves that were set aside."""
    given = request.query_params.get("id", "")
    number = int(given) if given.isascii() and given.isdigit() and len(given) < 12 else 0
    with desk.reading() as session:
        run = read_run(session, number) if 0 < number <= LARGEST_NUMBER else None
        aside = read_set_aside(session, number) if run else []
    if run is None:
        raise HTTPException(404, f"There is no run {given!r}.")
    return desk.frame.page(
        request,
        "run_page.html",
        here="runs",
        open_alerts=desk.open_alerts(),
        run=run,
        aside=aside,
        report_files=_report_files(desk, number),
        alive=is_alive(run),
    )


def _report_files(desk: Desk, number: int) -> list[str]:
    """The files of a run's report that are there."""
    folder = report_folder(desk, number)
    return [] if folder is None else [name for name in TYPES if (folder / name).is_file()]


@router.post("/runs/begin")
def begin(request: Request, desk: AtDesk, visitor: AtVisit, form: Sent) -> RedirectResponse:
    """Queue a run over one valve, the valves of an area, or all."""
    valves = [valve for valve in form.all("valve") if valve]
    area = form.text("area")
    if area:
        with desk.reading() as session:
            valves += valves_in(session, area)
        if not valves:
            raise HTTPException(422, f"no valve is known in the area {area!r}")
    desk.actions.run_now(valves, visitor.signs())
    return _back(request, "run")


@router.post("/runs/cancel")
def cancel(request: Request, desk: AtDesk, visitor: AtVisit, form: Sent) -> RedirectResponse:
    """Ask that a run ends early."""
    desk.actions.cancel(form.number("run", "the number of a run"), visitor.signs())
    return _back(request, "cancel")


def _back(request: Request, done: str) -> RedirectResponse:
    base = request.scope.get("root_path", "").rstrip("/")
    return RedirectResponse(f"{base}/runs?{urlencode({'done': done})}", 303)
