"""Sources of data with their state, and the files that came through watched folders."""

from __future__ import annotations

from datetime import datetime, timedelta

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse

from stemwatch.service.presenter.wording import NOTHING, figure
from stemwatch.service.store.samples.sources import SourceState
from stemwatch.service.web.dependencies import Deps

SILENT_AFTER = timedelta(minutes=2)  # a collector reports far more often than this
MOST_FILES = 100

router = APIRouter(include_in_schema=False)


def source_word(source: SourceState, now: datetime) -> str:
    """How a source is doing in one word: good, fault, or silent where nobody speaks for it."""
    if not source.connected or source.fault:
        return "fault"
    live = source.kind == "modbus"
    return "silent" if live and now - source.updated > SILENT_AFTER else "good"


def count_or_figure(value: object) -> str:
    """A count without decimals, a measure with three digits, and a text as it is."""
    if not isinstance(value, int | float):
        return NOTHING if value is None else str(value)
    return str(int(value)) if float(value).is_integer() else figure(float(value))


@router.get("/sources")
def source_list(request: Request, deps: Deps) -> HTMLResponse:
    """Every source of the plant file, with what was heard of it last."""
    heard = deps.store.sources.states()
    plant = deps.site.plant
    known_sources = {state.source for state in heard}
    named = (*plant.sources, *plant.archives, *plant.devices) if plant else ()
    return deps.renderer.page(
        request,
        "sources_page.html",
        here="sources",
        open_alerts=deps.open_alerts(),
        sources=heard,
        word_of=lambda source: source_word(source, deps.now),
        count=count_or_figure,
        ago=lambda when: max(0.0, (deps.now - when).total_seconds()),
        quiet=[name for name in named if name not in known_sources],
        files=deps.store.sources.files(limit=MOST_FILES),
    )
