"""The ranking: which valve to look at first. All filters, the order and the page are in the
address, so that a view can be bookmarked and sent."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any
from urllib.parse import urlencode

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse
from starlette.datastructures import QueryParams

from stemwatch.models.verdict import WORST_FIRST, Verdict
from stemwatch.service.presenter.cost_of_sticking import money_of, total_in_words
from stemwatch.service.presenter.suspicion_words import (
    SUSPECTED_NOTE,
    loops_to_test,
    next_steps,
    suspected_sentence,
)
from stemwatch.service.presenter.urgency import CLASSES_IN_WORDS
from stemwatch.service.presenter.work_counts import WorkCounts
from stemwatch.service.report.bars import bar_top
from stemwatch.service.report.change_since_last_run import change_since_last_run
from stemwatch.service.store.screenings.ranking import (
    LARGEST_FIRST,
    NOT_SCREENED,
    SORTS,
    RankingFilter,
)
from stemwatch.service.web.actions import number_in
from stemwatch.service.web.dependencies import Deps

LONGEST_SEARCH = 200
MOST_PAGES = 10_000
_VERDICTS = (*(verdict.value for verdict in WORST_FIRST), NOT_SCREENED)
COLUMNS = (
    ("rank", "#"),
    ("valve", "Valve and service"),
    ("area", "Area"),
    ("unit", "Unit"),
    ("criticality", "Crit."),
    ("severity", "Verdict"),
    ("cost", "Cost a month"),
    ("S", "S, %"),
    ("J", "J, %"),
    ("confidence", "Confidence"),
    ("", "Trend"),
    ("grade", "Data"),
    ("at", "Window until"),
)

router = APIRouter(include_in_schema=False)


@router.get("/")
def ranking(request: Request, deps: Deps) -> HTMLResponse:
    """The valves, the most urgent first unless the address says otherwise."""
    ranking_filter = wanted_of(request.query_params)
    costs = deps.site.costs()
    page = deps.store.ranking(ranking_filter, money_of(costs), deps.standing_groups())
    weeks = deps.store.trends([line.valve for line in page.lines], deps.site.limits)
    alerted = deps.store.alerts.open_by_valve(deps.now)
    to_test = loops_to_test(next_steps(deps.store.without_verdict()))
    open_alerts = deps.open_alerts()
    plant = deps.site.plant
    return deps.renderer.page(
        request,
        "ranking_page.html",
        here="ranking",
        wanted=ranking_filter,
        ranking=page,
        costs=costs,
        cost=total_in_words(costs),
        suspected=suspected_sentence(to_test),
        suspected_note=SUSPECTED_NOTE,
        to_test=to_test,
        priorities=CLASSES_IN_WORDS,
        unknown=page.unknown(ranking_filter),
        work=WorkCounts.of_states(page.states, page.orders),
        trends=[
            change_since_last_run(line, line.verdict, line.previous, weeks.get(line.valve))
            if line.verdict
            else None
            for line in page.lines
        ],
        alerted=alerted,
        gone=plant.not_named(line.valve for line in page.lines) if plant else set(),
        open_alerts=open_alerts,
        verdicts={word: Verdict(word) if word != NOT_SCREENED else None for word in _VERDICTS},
        columns=COLUMNS,
        head=lambda sort: _head(ranking_filter, sort),
        link=lambda **changes: link(ranking_filter, **changes),
        pages=max(1, math.ceil(page.total / ranking_filter.size)),
        gauge_top=bar_top(page.largest_percent),
    )


def wanted_of(query: QueryParams) -> RankingFilter:
    """The filter in an address; invalid parts keep their default and are never an error."""
    sort = query.get("sort", "")
    levels = [text for text in query.getlist("criticality") if text in ("1", "2", "3")]
    return RankingFilter(
        text=query.get("q", "").strip()[:LONGEST_SEARCH],
        sites=tuple(site for site in query.getlist("site") if site),
        areas=tuple(area for area in query.getlist("area") if area),
        units=tuple(unit for unit in query.getlist("unit") if unit),
        verdicts=tuple(word for word in query.getlist("verdict") if word in _VERDICTS),
        criticalities=tuple(int(level) for level in levels),
        sort=sort if sort in SORTS else "rank",
        descending=query.get("order") == "desc",
        page=min(number_in(query.get("page", "")), MOST_PAGES) or 1,
    )


def link(ranking_filter: RankingFilter, **changes: Any) -> str:
    """The address of the ranking with ``changes`` to what is wanted, defaults left out."""
    fields: dict[str, Any] = {
        "q": ranking_filter.text,
        "site": ranking_filter.sites,
        "area": ranking_filter.areas,
        "unit": ranking_filter.units,
        "verdict": ranking_filter.verdicts,
        "criticality": ranking_filter.criticalities,
        "sort": "" if ranking_filter.sort == "rank" else ranking_filter.sort,
        "order": "desc" if ranking_filter.descending else "",
        "page": "" if ranking_filter.page == 1 else ranking_filter.page,
    } | changes
    filled = {name: value for name, value in fields.items() if value not in ("", (), None)}
    return f"/?{urlencode(filled, doseq=True)}" if filled else "/"


def _head(ranking_filter: RankingFilter, sort: str) -> Mapping[str, str]:
    """Where a column's heading leads, and how the column is sorted now."""
    first = sort in LARGEST_FIRST
    chosen = ranking_filter.sort == sort
    descending = not ranking_filter.descending if chosen else first
    name = "" if sort == "rank" else sort
    return {
        "link": link(ranking_filter, sort=name, order="desc" if descending else "", page=""),
        "sorted": ("descending" if ranking_filter.descending else "ascending") if chosen else "",
    }
