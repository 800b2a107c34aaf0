"""Runs: what is screened now, how long it will take, what was set aside, and a new one."""

from __future__ import annotations

from fastapi import APIRouter, HTTPException, Request
from fastapi.responses import HTMLResponse, RedirectResponse

from stemwatch.service.plant_path import PartOfPlant, UnknownPart
from stemwatch.service.store.screenings.records import RunState, StoredRun
from stemwatch.service.web.actions import number_in
from stemwatch.service.web.auth.current_user import SignedIn
from stemwatch.service.web.auth.forms import SentForm
from stemwatch.service.web.dependencies import Dependencies, Deps
from stemwatch.service.web.pages.redirects import to_page
from stemwatch.service.web.pages.run_report import TYPES, report_folder

MOST_RUNS = 100
MOST_SET_ASIDE = 500

router = APIRouter(include_in_schema=False)


def is_alive(run: StoredRun) -> bool:
    """Whether a run waits or goes on."""
    return run.state in (RunState.WAITING, RunState.RUNNING)


@router.get("/runs")
def run_list(request: Request, deps: Deps) -> HTMLResponse:
    """What goes on now, then the runs that are over, the newest first."""
    runs = deps.store.queue.recent(MOST_RUNS)
    return deps.renderer.page(
        request,
        "runs_page.html",
        here="runs",
        open_alerts=deps.open_alerts(),
        going=[run for run in runs if is_alive(run)],
        over=[run for run in runs if not is_alive(run)],
        schedules=deps.store.schedules.all(),
        levels=deps.store.levels(),
    )


@router.get("/run")
def one_run(request: Request, deps: Deps) -> HTMLResponse:
    """One run with the valves that were set aside."""
    run_text = request.query_params.get("id", "")
    number = number_in(run_text)
    run = deps.store.queue.find(number) if number else None
    if run is None:
        raise HTTPException(404, f"There is no run {run_text!r}.")
    return deps.renderer.page(
        request,
        "run_page.html",
        here="runs",
        open_alerts=deps.open_alerts(),
        run=run,
        aside=deps.store.queue.set_aside(number, MOST_SET_ASIDE),
        report_files=_report_files(deps, number),
        alive=is_alive(run),
    )


def _report_files(deps: Dependencies, number: int) -> list[str]:
    """The files of a run's report that are there."""
    folder = report_folder(deps, number)
    return [] if folder is None else [name for name in TYPES if (folder / name).is_file()]


@router.post("/runs/begin")
def begin(request: Request, deps: Deps, current_user: SignedIn, form: SentForm) -> RedirectResponse:
    """Queue a run over one valve, the valves of an area or unit, or all."""
    valves = [valve for valve in form.all("valve") if valve]
    area, unit = form.text("area"), form.text("unit")
    if area or unit:
        part = PartOfPlant(areas=(area,) if area else (), units=(unit,) if unit else ())
        in_part = deps.store.valves_in(part)
        if not in_part:
            try:
                part.check(deps.store.levels())
            except UnknownPart as error:
                raise HTTPException(422, str(error)) from None
            raise HTTPException(422, f"no valve is in area {area!r} and unit {unit!r}")
        valves += in_part
    deps.actions.run_now(valves, current_user.signature())
    return to_page(request, "/runs", "run")


@router.post("/runs/cancel")
def cancel(
    request: Request, deps: Deps, current_user: SignedIn, form: SentForm
) -> RedirectResponse:
    """Ask that a run ends early."""
    deps.actions.cancel(form.number("run", "the number of a run"), current_user.signature())
    return to_page(request, "/runs", "cancel")
