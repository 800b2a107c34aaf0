"""The planned field test of one valve: designed from its last screening, within limits that the
reader gives, and as one page to print. Nothing is ever written to the plant."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING
from urllib.parse import urlencode

from fastapi import APIRouter, HTTPException, Request
from fastapi.responses import HTMLResponse, Response

from stemwatch.service.report.report_context import ReportContext
from stemwatch.service.web.dependencies import Dependencies, Deps

if TYPE_CHECKING:
    from stemwatch.models.field_test.programme import TestLimits
    from stemwatch.service.field_test.plan_from_screening import PlanCache
    from stemwatch.service.field_test.sheet import TestSheet

FIELDS = ("amplitude", "minutes", "pv_upset", "op_low", "op_high", "op_now")
PAPER = "application/pdf"

router = APIRouter(include_in_schema=False)


@router.get("/valve/test-plan")
def test_plan(request: Request, deps: Deps) -> HTMLResponse:
    """The plan of the valve ``id``; the limits stand in the query."""
    from stemwatch.service.field_test.sheet_files import page_values

    name = deps.need_valve(request.query_params.get("id", ""))
    texts = {field: request.query_params.get(field, "")[:20] for field in FIELDS}
    sheet, refused = None, ""
    try:
        sheet = _sheet(deps, name, texts)
    except ValueError as error:
        refused = str(error)
    return deps.renderer.page(
        request,
        "test_plan_page.html",
        status=422 if refused else 200,
        here="ranking",
        open_alerts=deps.open_alerts(),
        valve=name,
        given=texts,
        refused=refused,
        fields=urlencode({field: text for field, text in texts.items() if text}),
        **({"sheet": None} if sheet is None else page_values(sheet)),
    )


@router.get("/valve/test-plan/sheet")
def sheet_to_print(request: Request, deps: Deps) -> Response:
    """The same plan as PDF, one page."""
    from stemwatch.service.field_test.sheet_files import PDF, pdf_of

    name = deps.need_valve(request.query_params.get("id", ""))
    texts = {field: request.query_params.get(field, "")[:20] for field in FIELDS}
    try:
        sheet = _sheet(deps, name, texts)
    except ValueError as error:
        raise HTTPException(422, str(error)) from error
    if sheet is None:
        raise HTTPException(404, f"{name} was not screened yet; there is nothing to plan from.")
    context = ReportContext(
        started=deps.now, title=sheet.title, plant=deps.site.name, zone=deps.site.zone
    )
    headers = {"content-disposition": f'inline; filename="{PDF}"'}
    return Response(pdf_of(sheet, context), media_type=PAPER, headers=headers)


def _sheet(deps: Dependencies, valve: str, texts: dict[str, str]) -> TestSheet | None:
    """The sheet within the limits that were given; ``None`` where the valve was not screened.

    Raises ``ValueError`` for a limit without sense.
    """
    from stemwatch.service.field_test.sheet import sheet_of

    op_now = _number(texts, "op_now")
    plan = _plan_cache().plan(deps.store, valve, _limits(texts), op_now)
    return None if plan is None else sheet_of(plan, valve)


@cache
def _plan_cache() -> PlanCache:
    """The plans that were made before, by database and screening."""
    from stemwatch.service.field_test.plan_from_screening import PlanCache

    return PlanCache()


def _limits(texts: dict[str, str]) -> TestLimits:
    from stemwatch.models.field_test.programme import TestLimits

    limits_given = {
        "amplitude": _number(texts, "amplitude"),
        "pv_upset": _number(texts, "pv_upset"),
        "op_low": _number(texts, "op_low"),
        "op_high": _number(texts, "op_high"),
    }
    minutes = _number(texts, "minutes")
    limits_given["duration_s"] = None if minutes is None else 60.0 * minutes
    return TestLimits(**{name: value for name, value in limits_given.items() if value is not None})


def _number(texts: dict[str, str], name: str) -> float | None:
    """A number, with a decimal comma or point; ``None`` where nothing was given."""
    text = texts[name].strip().replace(",", ".")
    if not text:
        return None
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not -1e6 < value < 1e6:
        raise ValueError(f"{name.replace('_', ' ')}: a number is expected, received {text!r}")
    return value
