"""The audit log, for admins: as a page with filters that stand in the address, and as JSON."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from typing import Annotated
from urllib.parse import urlencode

from fastapi import APIRouter, Query, Request
from fastapi.responses import HTMLResponse
from pydantic import AwareDatetime
from starlette.datastructures import QueryParams

from stemwatch.service.store.accounts.audit import AuditFilter
from stemwatch.service.store.accounts.records import AuditOutcome, StoredAuditEntry
from stemwatch.service.web.actions import LARGEST_NUMBER, number_in
from stemwatch.service.web.api import schemas as shapes
from stemwatch.service.web.api.schemas import AuditLine
from stemwatch.service.web.dependencies import Dependencies, Deps

PAGE = 100
MOST = 1000
LONGEST_WORD = 200

router = APIRouter(include_in_schema=False)
api = APIRouter(prefix="/api/v1", tags=["read"], responses=shapes.REFUSALS)


@router.get("/audit")
def audit(request: Request, deps: Deps) -> HTMLResponse:
    """The newest entries that the address asks for."""
    query = request.query_params
    audit_filter = wanted_of(query, deps)
    entries = deps.store.audit.read(audit_filter)
    older = (
        {**dict(query), "before": str(entries[-1].id)} if len(entries) == audit_filter.limit else {}
    )
    return deps.renderer.page(
        request,
        "audit_page.html",
        here="audit",
        open_alerts=deps.open_alerts(),
        entries=entries,
        actions=deps.store.audit.actions(),
        outcomes=list(AuditOutcome),
        names=[user.name for user in deps.store.accounts.all()],
        given=query,
        older=urlencode(older),
    )


@api.get("/audit")
def audit_lines(
    deps: Deps,
    who: Annotated[str, Query(max_length=LONGEST_WORD)] = "",
    action: Annotated[str, Query(max_length=LONGEST_WORD)] = "",
    outcome: AuditOutcome | None = None,
    start: AwareDatetime | None = None,
    stop: AwareDatetime | None = None,
    before: Annotated[int | None, Query(ge=1, le=LARGEST_NUMBER)] = None,
    limit: Annotated[int, Query(ge=1, le=MOST)] = PAGE,
) -> list[AuditLine]:
    """Who wanted what, and what became of it, the newest first; ``before`` is the number of the
    last entry that was read."""
    audit_filter = AuditFilter(
        who=who,
        action=action,
        outcome=outcome,
        start=_in_utc(start),
        stop=_in_utc(stop),
        before=before,
        limit=limit,
    )
    return [line_of(entry) for entry in deps.store.audit.read(audit_filter)]


def wanted_of(query: QueryParams, deps: Dependencies) -> AuditFilter:
    """The filter in an address; invalid parts are left out and are never an error."""
    outcome = query.get("outcome", "")
    return AuditFilter(
        who=query.get("who", "")[:LONGEST_WORD],
        action=query.get("action", "")[:LONGEST_WORD],
        outcome=AuditOutcome(outcome) if outcome in list(AuditOutcome) else None,
        start=_day(query.get("start", ""), deps),
        stop=_day(query.get("stop", ""), deps, after=1),
        before=number_in(query.get("before", "")) or None,
        limit=PAGE,
    )


def line_of(entry: StoredAuditEntry) -> AuditLine:
    """An entry for the API."""
    return AuditLine(**{name: getattr(entry, name) for name in AuditLine.model_fields})


def _day(text: str, deps: Dependencies, after: int = 0) -> datetime | None:
    """The beginning of a day in the plant's zone, or of the one ``after`` so many days."""
    try:
        day = datetime.fromisoformat(text) + timedelta(days=after)
        return day.replace(tzinfo=deps.site.tz).astimezone(UTC)
    except (ValueError, OverflowError):
        return None


def _in_utc(instant: datetime | None) -> datetime | None:
    """An instant that every database takes; one beyond its calendar is as good as none."""
    try:
        return None if instant is None else instant.astimezone(UTC)
    except OverflowError:
        return None
