"""What sticking costs, as an order of report, page and API; and the report's first screen."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import httpx
import pytest

from stemwatch.models.history.trend_over_weeks import TrendOverWeeks
from stemwatch.models.screening_result import Screening
from stemwatch.models.verdict import Verdict
from stemwatch.service.config.schema import Valve
from stemwatch.service.presenter.cost_of_sticking import Prices, RankBy
from stemwatch.service.report.ranking import rank_valves
from stemwatch.service.report.report_context import ReportContext, ValveFacts
from stemwatch.service.store.screenings.ranking import RankingFilter
from stemwatch.service.store.store import open_store
from stemwatch.service.web.site import Site
from tests.service.presenter.test_cost_of_sticking import FOUND
from tests.service.report.conftest import screening
from tests.service.web import example_plant
from tests.service.web.example_plant import HEALTHY, HOSTILE, NOW, STICKY, WATCH
from tests.service.web.signed_in import cookie_of


def costing(name: str, S: float, verdict: Verdict = Verdict.STICKY) -> Screening:
    """A sticking valve whose loop could be run again."""
    made = screening(name, verdict, S=S)
    return replace(made, indicators={**made.indicators, **FOUND})


def context(rank_by: RankBy) -> ReportContext:
    """FIC-2 costs ten times what FIC-1 does; nobody knows a price for FIC-3."""
    prices = {"FIC-1": Prices(per_unit_hour=1.0), "FIC-2": Prices(per_unit_hour=10.0)}
    rising = TrendOverWeeks(per_month=0.4, low=0.3, high=0.5, days=60.0)
    facts = {
        "FIC-1": ValveFacts(prices=prices["FIC-1"], weeks=rising),
        "FIC-2": ValveFacts(prices=prices["FIC-2"]),
    }
    return ReportContext(started=NOW, currency="EUR", valves=facts, rank_by=rank_by)


VALVES = [costing("FIC-1", 6.0), costing("FIC-2", 3.0), costing("FIC-3", 9.0)]
WELL = screening("FIC-4", Verdict.HEALTHY, S=0.2)
BLIND = screening("PIC-5", Verdict.UNDETERMINED)


def test_the_dearest_valve_stands_first_where_it_is_asked_for() -> None:
    """Valves without a price come after it, worst first."""
    orders = [
        [valve.screening.valve for valve in rank_valves([*VALVES, WELL], context(rank_by))]
        for rank_by in RankBy
    ]
    assert orders == [["FIC-3", "FIC-1", "FIC-2", "FIC-4"], ["FIC-2", "FIC-1", "FIC-3", "FIC-4"]]


def test_the_first_screen_says_states_response_trend_and_cost() -> None:
    """A line each; no verdict is no state."""
    ranked = rank_valves([*VALVES, WELL, BLIND], context(RankBy.VERDICT))
    lines = {line.about: line.says for line in ranked.summary}
    assert lines == {
        "NE 107": "3 out of specification, 1 normal, 1 without a state",
        "Response": (
            "dead band (S) up to 9.00 % of OP (FIC-3), resolution (J) up to 2.10 % of OP (FIC-4)"
        ),
        "Trend": "FIC-1: S +0.40 % a month (+0.30 to +0.50)",
        "Cost": "The sticking of 2 loops costs about 4,015 EUR (3,281 to 5,482) a month.",
    }
    assert rank_valves([], context(RankBy.VERDICT)).summary == ()


def test_an_order_by_cost_needs_a_price(stemwatch, plant: Path) -> None:
    """Without one it would be no order."""
    priceless = re.sub(r"price_per_unit_hour = .*\n", "", plant.read_text("utf-8"))
    plant.write_text(priceless, "utf-8")
    outcome = stemwatch("screen", "--plant", str(plant), "--rank-by", "cost")
    assert outcome.status == 2
    assert "an order by cost needs" in " ".join(outcome.said.split())


@pytest.fixture
def priced(tmp_path: Path) -> Iterator[Site]:
    """The plant of the pages with prices for three valves, two of which stick."""
    with open_store(f"sqlite:///{tmp_path / 'plant.db'}") as store:
        example_plant.fill(store, months=1)
        number = store.begin_run(software_version="1")
        for name, verdict in ((STICKY, Verdict.STICKY), (WATCH, Verdict.WATCH)):
            made = example_plant.screening(name, verdict, 4.0, 2.0)
            store.save(replace(made, indicators={**made.indicators, **FOUND}), number)
        store.finish_run(number)
        plant = example_plant.plant_of(tmp_path, store)
        tags = {"op": {"tag": "x"}}
        valves = {
            name: Valve(id=name, source="gateway 1", price_per_unit_hour=price, tags=tags)
            for name, price in ((STICKY, 1.0), (WATCH, 10.0), (HEALTHY, 99.0))
        }
        plant = replace(plant, valves={**plant.valves, **valves}, currency="EUR")
        yield Site(store=store, plant=plant, clock=lambda: NOW)


def test_page_and_api_sort_by_cost(priced: Site) -> None:
    """The latest screening counts, with the prices of the plant file; the page has the sum."""
    assert {valve: cost.money.value for valve, cost in priced.costs().items()} == {
        STICKY: 365.0,
        WATCH: 3650.0,
    }
    by_cost = RankingFilter(sort="cost", descending=True)
    lines = priced.store.ranking(by_cost, {STICKY: 365.0, WATCH: 3650.0}).lines
    assert [line.valve for line in lines][:3] == [WATCH, STICKY, HOSTILE]
    with (
        example_plant.serving(priced) as base,
        httpx.Client(
            base_url=base, trust_env=False, verify=False, timeout=30.0, cookies=cookie_of(priced)
        ) as client,
    ):
        wanted = {"sort": "cost", "order": "desc"}
        answer = client.get("/api/v1/valves", params=wanted).json()["valves"]
        page = client.get("/", params=wanted).text
    assert [(line["valve"], line["cost_per_month"]) for line in answer][:1] == [
        (WATCH, {"value": 3650.0, "low": 2920.0, "high": 5110.0, "reason": None})
    ]
    assert answer[2]["cost_per_month"] is None
    assert page.index(f">{WATCH}<") < page.index(f">{STICKY}<")
    assert "3,650 EUR (2,920 to 5,110)" in page
    assert "The sticking of 2 loops costs about 4,015 EUR" in page


@pytest.mark.long
@pytest.mark.browser
def test_a_click_on_the_cost_orders_the_ranking_by_it(priced: Site, windows) -> None:
    """The dearest first; on a phone the cost is a line of the valve's card, and the page
    no wider."""
    with example_plant.serving(priced) as base:
        (name, value) = next(iter(cookie_of(priced).items()))
        page = windows.open(
            base,
            cookies=[{"name": name, "value": value, "url": base}],
            viewport={"width": 1280, "height": 900},
        )
        costs = page.locator("#ranking-table tbody .c-cost")
        page.locator("th.h-cost a").click()
        page.locator("th.h-cost[aria-sort=descending]").wait_for()
        dear, cheap, *others = costs.all_inner_texts()
        assert dear.startswith("3,650 EUR")
        assert cheap.startswith("365 EUR")
        assert set(others) == {"–"}
        page.set_viewport_size({"width": 390, "height": 800})
        assert costs.first.is_visible()
        label = "one => getComputedStyle(one, '::before').content"
        assert "Cost a month" in costs.first.evaluate(label)
        assert page.evaluate("document.documentElement.scrollWidth") <= 390
        windows.close()
