"""One valve: what was found, its signals, its months, its alerts, and what people know of it."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any
from urllib.parse import urlencode

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse, RedirectResponse
from sqlalchemy.orm import Session

from stemwatch.models.recording import Role
from stemwatch.models.screening_result import Screening
from stemwatch.service.maintenance.finding_kinds import kinds_of, needs_work
from stemwatch.service.maintenance.maintenance_html import page_anchor
from stemwatch.service.report.bars import MODEL_NAMES
from stemwatch.service.report.change_since_last_run import Change, change_since_last_run
from stemwatch.service.report.mismatch_view import MismatchView, mismatch_view
from stemwatch.service.store.screenings.records import StoredScreening, StoredValve
from stemwatch.service.store.screenings.restored import screening_of
from stemwatch.service.store.screenings.screenings import read_last
from stemwatch.service.web.desk import AtDesk, Desk
from stemwatch.service.web.forms import Sent
from stemwatch.service.web.history import read_marks
from stemwatch.service.web.indicator_words import indicator_of
from stemwatch.service.web.queries import alerts, samples
from stemwatch.service.web.queries.samples import Bad
from stemwatch.service.web.queries.valve import read_history, read_indicators, read_valve
from stemwatch.service.web.ranking_page import bar_top
from stemwatch.service.web.reports import MAINTENANCE, report_folder
from stemwatch.service.web.signals import LONGEST, tags_of
from stemwatch.service.web.visit import AtVisit

OPENING = timedelta(hours=2)
MOST_IN_TABLE = 40
ANCHOR = "valve"
SPANS = (("1 h", 3600), ("6 h", 21600), ("1 d", 86400), ("7 d", 604800), ("30 d", 2592000))

router = APIRouter(include_in_schema=False)


@dataclass(frozen=True, kw_only=True)
class Shown:
    """The latest screening as the report's templates want it."""

    screening: Screening
    stored: StoredScreening
    trend: Change
    mismatch: MismatchView | None


@router.get("/valve")
def valve(request: Request, desk: AtDesk) -> HTMLResponse:
    """The page of one valve; ``id`` in the query names it."""
    name = desk.need_valve(request.query_params.get("id", ""))
    with desk.reading() as session:
        stored = read_valve(session, name) or _from_plant(desk, name)
        shown = _shown(desk, session, name)
        points = read_history(session, name)
        marks = read_marks(session, name)
        raised = alerts.read_alerts(session, "all", desk.now, valve=name)
        opens, ends = _opening(desk, session, name, shown)
        quality = _quality(desk, session, name, (opens, ends))
    numbers = [shown.screening.S.value or 0.0, shown.screening.J.value or 0.0] if shown else [0.0]
    return desk.frame.page(
        request,
        "valve_page.html",
        here="ranking",
        open_alerts=desk.open_alerts(),
        one=stored,
        shown=shown,
        gauge_top=bar_top(max(numbers)),
        models=MODEL_NAMES,
        compact=False,
        points=points[::-1][:MOST_IN_TABLE],
        count=len(points),
        marks=marks[::-1],
        alerts=raised,
        state_of=lambda alert: alerts.state_of(alert, desk.now),
        opens=opens,
        ends=ends,
        spans=SPANS,
        roles=_roles(desk, name),
        quality=quality,
        sheet=None if shown is None else _sheet(desk, shown),
    )


@router.post("/valve/note")
def note(request: Request, desk: AtDesk, visitor: AtVisit, form: Sent) -> RedirectResponse:
    """Keep a remark about a valve."""
    name = desk.need_valve(form.text("valve", needed="a valve"))
    at = form.instant("at", desk.site.tz, desk.now)
    text = form.text("text", needed="what was seen")
    desk.actions.note(name, at, text, visitor.signs())
    return _back(request, name, "note", "log")


@router.post("/valve/maintenance")
def maintenance(request: Request, desk: AtDesk, visitor: AtVisit, form: Sent) -> RedirectResponse:
    """Record work on a valve."""
    name = desk.need_valve(form.text("valve", needed="a valve"))
    at = form.instant("at", desk.site.tz, desk.now)
    text = form.text("text", needed="what was done")
    desk.actions.maintenance(name, at, text, visitor.signs())
    return _back(request, name, "maintenance", "log")


@router.post("/valve/baseline")
def baseline(request: Request, desk: AtDesk, visitor: AtVisit, form: Sent) -> RedirectResponse:
    """Make the network fitted last the valve's baseline."""
    name = desk.need_valve(form.text("valve", needed="a valve"))
    desk.actions.baseline(name, form.text("text"), visitor.signs())
    return _back(request, name, "baseline", "log")


def _back(request: Request, valve: str, done: str, place: str) -> RedirectResponse:
    base = request.scope.get("root_path", "").rstrip("/")
    address = f"{base}/valve?{urlencode({'id': valve, 'done': done})}#{place}"
    return RedirectResponse(address, 303)


def _from_plant(desk: Desk, name: str) -> StoredValve:
    """A valve of the plant file that no run has met yet."""
    known: Any = desk.site.plant.valves[name] if desk.site.plant else None
    if known is None:
        return StoredValve(id=name)
    return StoredValve(
        id=name, description=known.description, area=known.area, criticality=known.criticality
    )


def _shown(desk: Desk, session: Session, name: str) -> Shown | None:
    latest = read_last(session, name, 1)
    if not latest:
        return None
    stored = latest[0]
    points = read_indicators(session, stored.id)
    indicators = {name: indicator_of(name, point) for name, point in points.items()}
    screening = screening_of(stored, indicators)
    found = screening.mismatch
    return Shown(
        screening=screening,
        stored=stored,
        trend=change_since_last_run(screening, desk.store.previous_finding(screening)),
        mismatch=None
        if found is None
        else mismatch_view(found, None, ANCHOR, name, stored.held_back),
    )


def _sheet(desk: Desk, shown: Shown) -> str | None:
    """Where the valve's page for maintenance is; ``None`` where it has none, or none is kept."""
    found = shown.screening.mismatch
    stands = not shown.stored.held_back if found is not None and found.effects else None
    if not needs_work(kinds_of(shown.screening, stands=stands)):
        return None
    run = shown.stored.run_id
    folder = report_folder(desk, run)
    if folder is None or not (folder / MAINTENANCE).is_file():
        return None
    anchor = page_anchor(shown.screening.valve)
    return f"/run/report?{urlencode({'id': run, 'file': MAINTENANCE})}#{anchor}"


def _opening(
    desk: Desk, session: Session, name: str, shown: Shown | None
) -> tuple[datetime, datetime]:
    """What the plots open on: the last two hours of the screened window, else of the samples."""
    start, end = shown.stored.window if shown else (None, None)
    if start is not None and end is not None:
        return max(start, end - OPENING), end
    number = _op_number(desk, session, name)
    bounds = None if number is None else samples.read_bounds(session, number)
    end = desk.now if bounds is None else datetime.fromtimestamp(bounds[1] + 1.0, desk.now.tzinfo)
    return end - OPENING, end


def _op_number(desk: Desk, session: Session, name: str) -> int | None:
    tags = tags_of(desk.site, name)
    if Role.OP not in tags or desk.site.plant is None:
        return None
    source = desk.site.plant.valves[name].source
    return samples.tag_number(session, source, tags[Role.OP].tag)


def _quality(
    desk: Desk, session: Session, name: str, window: tuple[datetime, datetime]
) -> list[Bad]:
    """Good and bad samples of each tag in the plots' window, where the store has samples."""
    if desk.site.plant is None or name not in desk.site.plant.valves:
        return []
    source = desk.site.plant.valves[name].source
    found = []
    for tag in tags_of(desk.site, name).values():
        number = samples.tag_number(session, source, tag.tag)
        if number is not None and window[1] - window[0] <= LONGEST:
            found.append(samples.read_bad(session, number, tag.tag, *window))
    return found


def _roles(desk: Desk, name: str) -> list[tuple[str, str]]:
    """Each tag with what it is to the valve, such as OP and FIC101.OP."""
    return [(role.value.upper(), tag.tag) for role, tag in tags_of(desk.site, name).items()]
