"""One run with valves of every kind, as it was stored, reported and served: they must agree."""

from __future__ import annotations

import csv
import html
import json
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import httpx
import pytest

from stemwatch.models.recording import Provenance
from stemwatch.models.screening import failed
from stemwatch.models.screening_result import Screening
from stemwatch.models.verdict import Verdict
from stemwatch.service.cli import views
from stemwatch.service.maintenance.stored import report_of_store
from stemwatch.service.report import write_report
from stemwatch.service.report.ranking import Ranking, rank_valves
from stemwatch.service.run.engine import in_brief
from stemwatch.service.run.finish import hold_back
from stemwatch.service.store.store import Store, open_store
from stemwatch.service.web.site import Site
from tests.service.maintenance.made_book import context, frozen, with_effects
from tests.service.report.conftest import screening
from tests.service.web import made_plant
from tests.service.web.signed_in import cookie_of

NO_POSITION = (
    "Cannot tell: there is no valve position in this recording, and OP and PV alone cannot tell a "
    "sticking valve from a badly tuned loop or a disturbance."
)
BAD = "Cannot tell: 62 % of the samples are missing or marked bad."


def blind(valve: str, reason: str) -> Screening:
    """A valve that cannot be judged."""
    made = screening(valve, Verdict.UNDETERMINED, samples=60)
    return replace(made, reason=reason, still_seen=(), severity=15.0)


def by_chance(valve: str) -> Screening:
    """A healthy valve on which chance alone may have named an effect."""
    found = with_effects(valve, Verdict.HEALTHY)
    assert found.mismatch is not None
    return replace(found, mismatch=replace(found.mismatch, p_value=0.6))


def as_built(valve: str) -> Screening:
    """A healthy drive whose effects belong to such a machine."""
    found = with_effects(valve, Verdict.HEALTHY)
    assert found.mismatch is not None
    effects = tuple(replace(effect, inherent=True) for effect in found.mismatch.effects)
    return replace(found, mismatch=replace(found.mismatch, effects=effects))


def every_kind() -> list[Screening]:
    """Sticky, sticky with an effect, defective, to watch, healthy, and what cannot be judged."""
    return [
        screening("FIC-1", S=6.0),
        screening("FIC-2", S=2.1, J=0.3),
        with_effects("FIC-3", Verdict.STICKY),
        with_effects("FIC-4", Verdict.HEALTHY),
        with_effects("FIC-5", Verdict.WATCH),
        screening("FIC-6", Verdict.WATCH, S=1.1),
        screening("FIC-7", Verdict.HEALTHY, S=0.3),
        by_chance("FIC-8"),
        as_built("FIC-9"),
        frozen("PIC-1"),
        blind("PIC-2", NO_POSITION),
        blind("PIC-3", BAD),
        failed(
            "PIC-4", "x.csv: the file is empty", "Look at the file.", Provenance(source="x.csv")
        ),
    ]


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Store, int]]:
    """The run in a store, with what stands among its valves decided."""
    folder = tmp_path_factory.mktemp("stored")
    with open_store(f"sqlite:///{folder / 'plant.db'}") as store:
        run = store.begin_run(software_version="1")
        for one in every_kind():
            store.save(one.without_samples(), run)
        hold_back(store, run)
        store.finish_run(run)
        yield store, run


@pytest.fixture(scope="module")
def ranking() -> Ranking:
    """As the report has it."""
    every = every_kind()
    return rank_valves(every, context(every))


@pytest.fixture(scope="module")
def verdicts(ranking: Ranking) -> dict[str, str]:
    """The verdict on each valve."""
    return {valve.screening.valve: valve.verdict.value for valve in ranking}


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the report."""
    every = every_kind()
    write_report(every, context(every), folder := tmp_path_factory.mktemp("files"))
    return folder


@pytest.fixture(scope="module")
def pages(stored: tuple[Store, int]) -> Iterator[httpx.Client]:
    """Pages and API on the stored run."""
    site = Site(store=stored[0], clock=lambda: made_plant.NOW)
    with made_plant.serving(site) as base:
        cookies = cookie_of(site)
        with httpx.Client(
            base_url=base, trust_env=False, verify=False, timeout=30.0, cookies=cookies
        ) as client:
            yield client


def text_of(page: str) -> str:
    """A page's text with single blanks."""
    return " ".join(html.unescape(re.sub(r"<[^>]+>", " ", page)).split())


def test_each_kind_has_the_verdict_that_it_should(verdicts: dict[str, str]) -> None:
    """A material defect is no healthy valve; one that chance may have named is none, nor is what
    belongs to the machine."""
    assert verdicts == {
        **{"FIC-1": "sticky", "FIC-2": "sticky", "FIC-3": "sticky"},
        **{"FIC-4": "defective", "FIC-5": "defective", "FIC-6": "watch"},
        **{"FIC-7": "healthy", "FIC-8": "healthy", "FIC-9": "healthy"},
        **dict.fromkeys(("PIC-1", "PIC-2", "PIC-3", "PIC-4"), "undetermined"),
    }


def test_tables_report_and_pages_have_one_verdict_a_valve(
    verdicts: dict[str, str], files: Path, pages: httpx.Client
) -> None:
    """CSV, JSON, the report's ranking, API, ranking page and each valve's page."""
    with (files / "valves.csv").open(encoding="utf-8-sig", newline="") as table:
        assert {row["valve"]: row["verdict"] for row in csv.DictReader(table)} == verdicts
    objects = json.loads((files / "valves.json").read_text("utf-8"))
    assert {one["valve"]: one["verdict"] for one in objects} == verdicts
    report = (files / "report.html").read_text("utf-8")
    for valve, verdict in verdicts.items():
        title = re.search(rf'<h2 id="valve-{valve}-title">.*?</header>', report, re.DOTALL)
        assert title is not None
        assert f"v-{verdict}" in title[0]
        page = pages.get("/valve", params={"id": valve}).text
        head = page[page.index('id="valve-title"') : page.index("↑ All valves")]
        assert f"v-{verdict}" in head
    assert {one["valve"]: one["verdict"] for one in _lines(pages)} == verdicts


def _lines(pages: httpx.Client) -> list[dict[str, Any]]:
    lines: list[dict[str, Any]] = pages.get("/api/v1/valves").json()["valves"]
    return lines


def test_order_severity_S_and_J_are_the_same(
    ranking: Ranking, files: Path, pages: httpx.Client
) -> None:
    """Report, tables, API and terminal rank alike, and the numbers agree to the last digit."""
    order = [valve.screening.valve for valve in ranking]
    objects = json.loads((files / "valves.json").read_text("utf-8"))
    lines = _lines(pages)
    table = views.summary([in_brief(one) for one in every_kind()])
    assert [one["valve"] for one in objects] == order
    assert [one["valve"] for one in lines] == order
    assert list(table.columns[1].cells) == order
    for one, line in zip(objects, lines, strict=True):
        assert line["severity"] == pytest.approx(one["severity"])
        assert line["confidence"] == one["confidence"]
        for name in ("S", "J"):
            assert line[name]["value"] == one["stiction"][name]["value"]


def test_headline_and_counts_are_the_same(
    ranking: Ranking, stored: tuple[Store, int], files: Path, pages: httpx.Client, tmp_path: Path
) -> None:
    """Report, ranking page, terminal, run page, metrics, and the book made from the store."""
    store, run = stored
    counts, headline = ranking.counts, ranking.counts.headline
    assert headline == "5 of 13 valves need work"
    assert (counts.watch, counts.not_judged, counts.no_work) == (1, 4, 3)
    assert headline in text_of((files / "report.html").read_text("utf-8"))
    assert headline in text_of(pages.get("/").text)
    assert headline in str(views.summary([in_brief(one) for one in every_kind()]).title)
    book = report_of_store(store, tmp_path, run=run)
    assert headline in book.book.counts
    by_word = Counter(valve.verdict.value for valve in ranking)
    assert dict(store.run(run).counts) == dict(by_word)
    assert {k: v for k, v in pages.get("/api/v1/valves").json()["counts"].items() if v} == by_word


def test_work_orders_are_of_the_valves_that_need_work(
    ranking: Ranking, stored: tuple[Store, int], tmp_path: Path
) -> None:
    """And of those that somebody can find out about; severity and order are the ranking's."""
    store, run = stored
    book = report_of_store(store, tmp_path, run=run).book
    ordered = {sheet.screening.valve: sheet for sheet in book.to_work_on}
    needing = {valve.screening.valve for valve in ranking if valve.decision.needs_work}
    assert needing == {"FIC-1", "FIC-2", "FIC-3", "FIC-4", "FIC-5"}
    assert needing | {"PIC-1", "PIC-2", "PIC-3"} == set(ordered)
    for valve in ranking:
        if valve.screening.valve in ordered:
            sheet = ordered[valve.screening.valve]
            assert sheet.finding.decision.severity == valve.decision.severity
            assert sheet.finding.reason == valve.finding.reason
            assert sheet.finding.next_step == valve.finding.next_step
