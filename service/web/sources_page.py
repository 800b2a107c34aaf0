"""Sources of data with their state, and the files that came through watched folders."""

from __future__ import annotations

from datetime import datetime, timedelta

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse

from stemwatch.service.report.wording import NOTHING, figure
from stemwatch.service.store.samples.sources import SourceState
from stemwatch.service.web.desk import AtDesk

SILENT_AFTER = timedelta(minutes=2)  # a collector speaks far more often than this
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
def source_list(request: Request, desk: AtDesk) -> HTMLResponse:
    """Every source of the plant file, with what was heard of it last."""
    heard = desk.store.sources.states()
    plant = desk.site.plant
    known = {one.source for one in heard}
    named = (*plant.sources, *plant.archives, *plant.devices) if plant else ()
    return desk.frame.page(
        request,
        "sources_page.html",
        here="sources",
        open_alerts=desk.open_alerts(),
        sources=heard,
        word_of=lambda source: source_word(source, desk.now),
        count=count_or_figure,
        ago=lambda when: max(0.0, (desk.now - when).total_seconds()),
        quiet=[name for name in named if name not in known],
        files=desk.store.sources.files(limit=MOST_FILES),
    )
