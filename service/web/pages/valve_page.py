"""One valve: findings, signals, history over months, alerts, and notes of people."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any
from urllib.parse import urlencode

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse, RedirectResponse

from stemwatch.models.history.trend_over_weeks import TrendOverWeeks
from stemwatch.models.oscillation_groups.plant_groups import OscillationGroup
from stemwatch.models.recording import Role
from stemwatch.models.screening_result import Screening
from stemwatch.models.without_position.suspicion import Suspicion
from stemwatch.service.maintenance.maintenance_html import page_anchor
from stemwatch.service.maintenance.work_compared import compare
from stemwatch.service.presenter.cost_of_sticking import CostOfSticking
from stemwatch.service.presenter.finding import PresentedFinding, present
from stemwatch.service.presenter.oscillation_words import loop_sentences
from stemwatch.service.presenter.urgency import Priority, priority_of
from stemwatch.service.presenter.work_decision import can_be_tested
from stemwatch.service.report.bars import MODEL_NAMES, bar_top
from stemwatch.service.report.change_since_last_run import Change, change_since_last_run
from stemwatch.service.report.charts.small_plot import Picture
from stemwatch.service.report.charts.suspicion_pictures import ShownSuspicion
from stemwatch.service.report.charts.window_pictures import unpack_pictures
from stemwatch.service.report.mismatch_view import MismatchView, mismatch_view
from stemwatch.service.run.clearest_suspicion import of_earlier_window
from stemwatch.service.store.alerts.alerts import state_of
from stemwatch.service.store.samples.tag_quality import BadSamples
from stemwatch.service.store.screenings.feedback import Judgement
from stemwatch.service.store.screenings.records import StoredScreening, StoredValve
from stemwatch.service.store.screenings.restored import screening_of
from stemwatch.service.web.api.history import read_marks
from stemwatch.service.web.api.signals import LONGEST, tags_of
from stemwatch.service.web.auth.current_user import SignedIn
from stemwatch.service.web.auth.forms import SentForm
from stemwatch.service.web.dependencies import Dependencies, Deps
from stemwatch.service.web.pages.redirects import to_page
from stemwatch.service.web.pages.run_report import MAINTENANCE, report_folder
from stemwatch.service.web.path_prefix import root_of

OPENING = timedelta(hours=2)
MOST_IN_TABLE = 40
ANCHOR = "valve"
SPANS = (("1 h", 3600), ("6 h", 21600), ("1 d", 86400), ("7 d", 604800), ("30 d", 2592000))

router = APIRouter(include_in_schema=False)


@dataclass(frozen=True, kw_only=True)
class ShownScreening:
    """The latest screening as the report's templates want it."""

    screening: Screening
    stored: StoredScreening
    trend: Change
    weeks: TrendOverWeeks | None
    mismatch: MismatchView | None
    finding: PresentedFinding
    cost: CostOfSticking | None
    criticality: str
    suspicion: ShownSuspicion | None

    @property
    def priority(self) -> Priority | None:
        """How urgent its work order is; ``None`` where it has none."""
        return priority_of(self.finding.decision, self.criticality)


@router.get("/valve")
def valve(request: Request, deps: Deps) -> HTMLResponse:
    """The page of one valve; ``id`` in the query names it."""
    name = deps.need_valve(request.query_params.get("id", ""))
    store = deps.store
    stored = store.valve(name) or _from_plant(deps, name)
    groups = store.oscillations_of(name, deps.now)
    shown_screening = _shown_screening(deps, name, groups, str(stored.criticality))
    points = store.s_and_j(name)
    marks = read_marks(store, name)
    raised = store.alerts.in_state("all", deps.now, valve=name)
    opens, ends = _opening(deps, name, shown_screening)
    quality = _quality(deps, name, (opens, ends))
    roles = _roles(deps, name)
    around = store.around_work(name)
    numbers = (
        [shown_screening.screening.S.value or 0.0, shown_screening.screening.J.value or 0.0]
        if shown_screening
        else [0.0]
    )
    return deps.renderer.page(
        request,
        "valve_page.html",
        here="ranking",
        open_alerts=deps.open_alerts(),
        stored_valve=stored,
        gone=deps.site.plant is not None and bool(deps.site.plant.not_named([name])),
        shown=shown_screening,
        by_window=store.evidence([name]).get(name),
        gauge_top=bar_top(max(numbers)),
        models=MODEL_NAMES,
        compact=True,
        points=points[::-1][:MOST_IN_TABLE],
        count=len(points),
        marks=marks[::-1],
        alerts=raised,
        state_of=lambda alert: state_of(alert, deps.now),
        opens=opens,
        ends=ends,
        spans=SPANS,
        roles=roles,
        # Without a position the plots show PV in its place. Of a valve without tags nobody knows.
        has_position=not roles or Role.MV.value.upper() in dict(roles),
        quality=quality,
        sheet=None if shown_screening is None else _sheet(deps, shown_screening),
        labels=store.feedback(name),
        judgements=list(Judgement),
        plan_link=_plan_link(request, shown_screening),
        work=None if around is None else compare(around),
        oscillates=loop_sentences(groups, name, deps.site.tz),
    )


@router.post("/valve/note")
def note(request: Request, deps: Deps, current_user: SignedIn, form: SentForm) -> RedirectResponse:
    """Keep a remark about a valve."""
    name = deps.need_valve(form.text("valve", needed="a valve"))
    remark_time = form.instant("at", deps.site.tz, deps.now)
    text = form.text("text", needed="what was seen")
    deps.actions.note(name, remark_time, text, current_user.signature())
    return _to_log(request, name, "note")


@router.post("/valve/maintenance")
def maintenance(
    request: Request, deps: Deps, current_user: SignedIn, form: SentForm
) -> RedirectResponse:
    """Record work on a valve."""
    name = deps.need_valve(form.text("valve", needed="a valve"))
    remark_time = form.instant("at", deps.site.tz, deps.now)
    text = form.text("text", needed="what was done")
    deps.actions.maintenance(name, remark_time, text, current_user.signature(), deps.now)
    return _to_log(request, name, "maintenance")


@router.post("/valve/feedback")
def feedback(
    request: Request, deps: Deps, current_user: SignedIn, form: SentForm
) -> RedirectResponse:
    """Keep whether what was said of a valve was right, and what was found."""
    name = deps.need_valve(form.text("valve", needed="a valve"))
    number = form.number("screening", "the number of a screening")
    judgement = form.text("judgement", needed="right, wrong or partly right")
    remark_time = form.instant("at", deps.site.tz, deps.now)
    deps.actions.feedback(
        number, remark_time, judgement, form.text("text"), current_user.signature()
    )
    return _to_log(request, name, "feedback")


@router.post("/valve/baseline")
def baseline(
    request: Request, deps: Deps, current_user: SignedIn, form: SentForm
) -> RedirectResponse:
    """Make the network fitted last the valve's baseline."""
    name = deps.need_valve(form.text("valve", needed="a valve"))
    deps.actions.baseline(name, form.text("text"), current_user.signature())
    return _to_log(request, name, "baseline")


def _to_log(request: Request, valve: str, done: str) -> RedirectResponse:
    """To the notes on the page of a valve."""
    return to_page(request, "/valve", done, anchor="log", id=valve)


def _from_plant(deps: Dependencies, name: str) -> StoredValve:
    """A valve of the plant file that no run has screened yet."""
    settings: Any = deps.site.plant.valves[name] if deps.site.plant else None
    if settings is None:
        return StoredValve(id=name)
    return StoredValve.of(settings)


def _shown_screening(
    deps: Dependencies, name: str, groups: Sequence[OscillationGroup], criticality: str
) -> ShownScreening | None:
    store, limits = deps.store, deps.site.limits
    latest = store.screenings(name, 1)
    if not latest:
        return None
    stored = latest[0]
    points = store.indicators(stored.id)
    indicators = {name: point.indicator(name) for name, point in points.items()}
    screening = screening_of(stored, indicators)
    mismatch = screening.mismatch
    found = mismatch is not None and (mismatch.effects or stored.confirmed)
    presented = present(
        screening,
        stands=not stored.held_back if found else None,
        confirmed=stored.confirmed,
        held_back=stored.held_back,
        groups=groups,
    )
    weeks = store.trends([name], limits).get(name)
    kept = unpack_pictures(store.packed_pictures(stored.id))
    return ShownScreening(
        screening=screening,
        suspicion=_shown_suspicion(deps, stored, kept.suspicion),
        finding=presented,
        cost=deps.site.cost_of(name, indicators),
        stored=stored,
        criticality=criticality,
        weeks=weeks,
        trend=change_since_last_run(
            screening, presented.decision.verdict, store.previous_finding(screening), weeks
        ),
        mismatch=None
        if mismatch is None
        else mismatch_view(
            mismatch,
            None,
            ANCHOR,
            name,
            stored.held_back,
            counts=(screening.S, screening.J),
            pictures=kept.effects,
        ),
    )


def _shown_suspicion(
    deps: Dependencies, stored: StoredScreening, of_latest: tuple[Picture, ...]
) -> ShownSuspicion | None:
    """The pictures of the window that shows best that the valve may stick."""
    told = stored.without_position
    if told is None or told.verdict is not Suspicion.SUSPECTED:
        return None
    if of_latest:
        return ShownSuspicion(of_latest)
    answers = deps.store.earlier_answers(stored.valve, stored.run_id)
    return of_earlier_window(told, stored.window[0], answers, deps.store.packed_pictures)


def _plan_link(request: Request, shown_screening: ShownScreening | None) -> str:
    """The address of the page that plans a field test; empty where none can be planned that
    helps."""
    if shown_screening is None or not can_be_tested(shown_screening.screening):
        return ""
    valve = urlencode({"id": shown_screening.screening.valve})
    return f"{root_of(request.scope)}/valve/test-plan?{valve}"


def _sheet(deps: Dependencies, shown_screening: ShownScreening) -> str | None:
    """Where the valve's page for maintenance is; ``None`` where it has none, or none is kept."""
    if not shown_screening.finding.decision.has_page:
        return None
    run = shown_screening.stored.run_id
    folder = report_folder(deps, run)
    if folder is None or not (folder / MAINTENANCE).is_file():
        return None
    anchor = page_anchor(shown_screening.screening.valve)
    return f"/run/report?{urlencode({'id': run, 'file': MAINTENANCE})}#{anchor}"


def _opening(
    deps: Dependencies, name: str, shown_screening: ShownScreening | None
) -> tuple[datetime, datetime]:
    """The window on which the plots open: the last two hours of the screened window, else of the
    samples."""
    start, end = shown_screening.stored.window if shown_screening else (None, None)
    if start is not None and end is not None:
        return max(start, end - OPENING), end
    bounds = _op_bounds(deps, name)
    end = deps.now if bounds is None else bounds[1] + timedelta(seconds=1)
    return end - OPENING, end


def _op_bounds(deps: Dependencies, name: str) -> tuple[datetime, datetime] | None:
    tags = tags_of(deps.site, name)
    if Role.OP not in tags or deps.site.plant is None:
        return None
    return deps.store.samples.bounds(deps.site.plant.valves[name].source, tags[Role.OP].tag)


def _quality(deps: Dependencies, name: str, window: tuple[datetime, datetime]) -> list[BadSamples]:
    """Good and bad samples of each tag in the plots' window, where the store has samples."""
    plant = deps.site.plant
    if plant is None or name not in plant.valves or window[1] - window[0] > LONGEST:
        return []
    source = plant.valves[name].source
    parts = (
        deps.store.samples.bad(source, tag.tag, *window)
        for tag in tags_of(deps.site, name).values()
    )
    return [bad_samples for bad_samples in parts if bad_samples is not None]


def _roles(deps: Dependencies, name: str) -> list[tuple[str, str]]:
    """Each tag with what it is to the valve, such as OP and FIC101.OP."""
    return [(role.value.upper(), tag.tag) for role, tag in tags_of(deps.site, name).items()]
