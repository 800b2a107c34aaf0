"""Results as a notebook shows them: HTML without scripts, from the report's own parts."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from functools import cache
from importlib.resources import files
from typing import Any

from markupsafe import Markup

from stemwatch.models.closed_loop.fitted_loop import FittedLoop
from stemwatch.models.mismatch.findings import Mismatch
from stemwatch.models.screening_result import Screening
from stemwatch.service.field_test.sheet import TestSheet
from stemwatch.service.field_test.sheet_files import page_values
from stemwatch.service.field_test.sheet_files import resource as sheet_resource
from stemwatch.service.maintenance.drawing import svg_of
from stemwatch.service.maintenance.evidence_picture import picture_of
from stemwatch.service.presenter.finding import PresentedFinding
from stemwatch.service.report import ReportContext
from stemwatch.service.report.html_page import environment, template
from stemwatch.service.report.mismatch_view import MismatchView, mismatch_view
from stemwatch.service.twin.loop_twin import WhatIf, settings_in_words


def screened_card(screening: Screening, finding: PresentedFinding, remark: str) -> str:
    """The sentence, S and J with intervals, the picture of the loop, and the mismatch.

    ``remark`` says why its named effects are held back; empty where they stand.
    """
    drawing, reason = picture_of(screening, screening.recording, UTC)
    if screening.recording is not None and screening.recording.start is not None:
        reason += " Times in UTC."
    return _rendered(
        "card.html",
        screening=screening,
        finding=finding,
        picture=None if drawing is None else svg_of(drawing),
        why=reason,
        view=_view(screening.mismatch, screening.valve, remark),
    )


def explained_card(valve: str, mismatch: Mismatch, remark: str) -> str:
    """What S and J leave out, with both fits and the maps of the residual."""
    return _rendered("explained.html", valve=valve, view=_view(mismatch, valve, remark))


def screened_table(
    valves: Sequence[tuple[Screening, PresentedFinding, bool | None]], discovered: str
) -> str:
    """A row for each screening, with what is said of it and whether its effects stand; the sentence
    ``discovered`` sums them up.
    """
    return _rendered("screened_valves.html", valves=valves, discovered=discovered)


def twin_card(valve: str, loop: FittedLoop, rows: Sequence[WhatIf]) -> str:
    """The loop as it was fitted, and what it would have done with each change."""
    first = rows[0].prediction
    return _rendered(
        "twin.html",
        valve=valve,
        settings=settings_in_words(loop),
        unit=loop.unit,
        recorded=first.recorded,
        as_it_is=first.as_it_is,
        rows=rows,
    )


def planned_card(sheet: TestSheet) -> str:
    """The operator's sheet, as ``test-plan.html`` has it."""
    return _rendered("planned_test.html", **page_values(sheet))


def _view(mismatch: Mismatch | None, valve: str, remark: str) -> MismatchView | None:
    return None if mismatch is None else mismatch_view(mismatch, None, "valve", valve, remark)


def _rendered(name: str, **values: Any) -> str:
    """The template ``name`` with its values."""
    context = ReportContext(started=datetime.now(UTC))
    styles = Markup(_load("card.css"))
    return environment(context, _load).get_template(name).render(styles=styles, **values)


@cache
def _load(name: str) -> str:
    """A template of this package, the operator's sheet, or one of the report."""
    source = files("stemwatch").joinpath(name)
    if source.is_file():
        return source.read_text("utf-8")
    return sheet_resource(name) if name == "sheet.html" else template(name)
