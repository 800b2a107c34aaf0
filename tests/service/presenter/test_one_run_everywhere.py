"""One run with valves of every kind, as it was stored, reported and served: they must agree."""

from __future__ import annotations

import csv
import io
import json
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import pytest
from rich.text import Text

from stemwatch.service.alerts.digest import message_of
from stemwatch.service.alerts.evaluate import gathered
from stemwatch.service.alerts.rules import apply_rules
from stemwatch.service.cli import screening_views as views
from stemwatch.service.config import load_plant
from stemwatch.service.maintenance.labels import labels_csv
from stemwatch.service.maintenance.maintenance_html import work_list_html
from stemwatch.service.maintenance.pdf import work_list_pdf
from stemwatch.service.maintenance.stored import report_of_store
from stemwatch.service.maintenance.work_list import WorkList
from stemwatch.service.presenter.finding import why_no_work
from stemwatch.service.presenter.wording import figure
from stemwatch.service.report import write_report
from stemwatch.service.report.ranking import Ranking, rank_valves
from stemwatch.service.store.alerts.alerts import RaisedAlert, StoredAlert
from stemwatch.service.store.screenings.feedback import Judgement
from stemwatch.service.store.store import Store, open_store
from stemwatch.service.web.site import Site
from tests.service.maintenance.example_work_list import order_rows, text_of_pdf
from tests.service.presenter.every_kind import (
    bare,
    brief_ranking,
    csv_rows,
    every_kind,
    json_objects,
    needed,
    page_text,
    save_run,
    text_of,
    workbook_rows,
)
from tests.service.web import example_plant
from tests.service.web.signed_in import cookie_of

pytestmark = pytest.mark.filterwarnings("ignore:.*:DeprecationWarning:openpyxl")


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Store, int]]:
    """The run in a store, with what stands among its valves decided."""
    folder = tmp_path_factory.mktemp("stored")
    with open_store(f"sqlite:///{folder / 'plant.db'}") as store:
        yield store, save_run(store)


@pytest.fixture(scope="module")
def ranking() -> Ranking:
    """As the report has it."""
    every = every_kind()
    return rank_valves(every, needed(every))


@pytest.fixture(scope="module")
def verdicts(ranking: Ranking) -> dict[str, str]:
    """The verdict on each valve."""
    return {valve.screening.valve: valve.verdict.value for valve in ranking}


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the report."""
    every = every_kind()
    write_report(every, needed(every), folder := tmp_path_factory.mktemp("files"))
    return folder


@pytest.fixture(scope="module")
def pages(stored: tuple[Store, int]) -> Iterator[httpx.Client]:
    """Pages and API on the stored run."""
    site = Site(store=stored[0], clock=lambda: example_plant.NOW)
    with example_plant.serving(site) as base:
        cookies = cookie_of(site)
        with httpx.Client(
            base_url=base, trust_env=False, verify=False, timeout=30.0, cookies=cookies
        ) as client:
            yield client


@pytest.fixture(scope="module")
def work_list(stored: tuple[Store, int], tmp_path_factory: pytest.TempPathFactory) -> WorkList:
    """What maintenance gets, from the store, with a page for each valve that has one."""
    store, run = stored
    folder = tmp_path_factory.mktemp("maintenance")
    return report_of_store(store, folder, run=run, all_valves=True).work_list


@pytest.fixture(scope="module")
def valve_pages(ranking: Ranking, pages: httpx.Client) -> dict[str, str]:
    """The page of each valve, as it is sent."""
    valves = (valve.screening.valve for valve in ranking)
    return {valve: pages.get("/valve", params={"id": valve}).text for valve in valves}


@dataclass(frozen=True)
class Told:
    """All texts of the run without blanks and breaks; what is of one valve, by valve."""

    report: dict[str, str]
    pages: dict[str, str]
    terminal: dict[str, str]
    orders: dict[str, dict[str, str]]
    maintenance: str
    paper: str
    mails: dict[str, dict[str, Any]]


@pytest.fixture(scope="module")
def told(
    ranking: Ranking,
    stored: tuple[Store, int],
    files: Path,
    valve_pages: dict[str, str],
    work_list: WorkList,
    tmp_path_factory: pytest.TempPathFactory,
) -> Told:
    """What each output tells, read once."""
    store, run = stored
    folder = tmp_path_factory.mktemp("told")
    valves = [valve.screening.valve for valve in ranking]
    articles = (files / "report.html").read_text("utf-8").split("<article")[1:]
    book = work_list
    (folder / "plant.toml").write_text("[alerts]\nraise_after_runs = 1\nof_runs = 1\n")
    records = gathered(store, plant := load_plant(folder / "plant.toml"), valves)
    raised = [one for record in records for one in apply_rules(record, plant.alerts)[0]]
    return Told(
        report={
            valve: next(page_text(one) for one in articles if f'id="valve-{valve}"' in one)
            for valve in valves
        },
        pages={valve: page_text(page) for valve, page in valve_pages.items()},
        terminal={
            valve.screening.valve: Text.from_markup(views.verdict_line(valve.screening)).plain
            for valve in ranking
        },
        orders={row["functional_location"]: row for row in order_rows(book)},
        maintenance=page_text(work_list_html(book).decode()),
        paper=bare(text_of_pdf(work_list_pdf(book, compress=False))),
        mails={one.valve: message_of([_kept(one)], "plant", run) for one in raised if one.valve},
    )


def _kept(raised: RaisedAlert) -> StoredAlert:
    """An alert as it is stored when it was raised and nobody has done anything yet."""
    return StoredAlert(
        id=1, cause=raised.cause, kind=raised.kind, severity=raised.severity, text=raised.text,
        valve=raised.valve, source=None, run_id=1, opened=example_plant.NOW, seen=example_plant.NOW,
        evidence=raised.evidence, closed=None, closed_why="", acknowledged=None,
        acknowledged_by="", comment="", snoozed_until=None, snoozed_by="", false_alarm=False,
        told=None,
    )  # fmt: skip


def test_why_and_what_to_do_read_the_same_in_every_output(
    ranking: Ranking, told: Told, files: Path
) -> None:
    """Of a valve of every kind: reason and next step in report, page, tables, workbook, JSON, PDF,
    its HTML, work orders and terminal, the verdict beside them."""
    objects = {item["valve"]: item for item in json_objects(files)}
    tables = [
        {row["valve"]: row for row in rows}
        for rows in (csv_rows(files / "valves.csv"), workbook_rows(files / "valves.xlsx"))
    ]
    for valve in ranking:
        name, answer = valve.screening.valve, valve.finding
        reason, step = bare(answer.reason), bare(answer.next_step)
        for row in (objects[name], *(table[name] for table in tables)):
            assert (bare(row["reason"]), bare(row["advice"])) == (reason, step), name
        for where in (told.report[name], told.pages[name]):
            assert reason in where, name
            assert step in where, name
        assert reason in bare(told.terminal[name])
        if valve.stands is not False:
            assert told.terminal[name].startswith(valve.verdict.value)
        if valve.decision.has_page:
            for where in (told.paper, told.maintenance):
                assert reason in where, name
        assert (name in told.orders) == valve.decision.has_order, name
        if name in told.orders:
            assert reason in bare(told.orders[name]["long_text"])
            assert told.orders[name]["ne107"] == tables[0][name]["NE 107"]


def test_a_mail_says_of_a_valve_what_its_page_and_order_say(ranking: Ranking, told: Told) -> None:
    """Only of valves that need work; what was found and the first step are those of all others."""
    needing = {valve.screening.valve for valve in ranking if valve.decision.needs_work}
    assert told.mails
    assert set(told.mails) <= needing
    for valve in ranking:
        name = valve.screening.valve
        if name not in told.mails:
            continue
        (alert,) = told.mails[name]["alerts"]
        found = bare(alert["text"].removeprefix(f"{name}: "))
        for where in (told.report[name], told.pages[name], told.maintenance, told.paper):
            assert found in where, alert["text"]
        assert bare(alert["first_step"]) in bare(told.orders[name]["long_text"])
        assert bare(alert["first_step"]) in told.paper


def test_each_kind_has_the_verdict_that_it_should(verdicts: dict[str, str]) -> None:
    """A material defect is no healthy valve; one that chance may have named is none, nor is what
    belongs to the machine."""
    assert verdicts == {
        **{"FIC-1": "sticky", "FIC-2": "sticky", "FIC-3": "sticky"},
        **{"FIC-4": "defective", "FIC-5": "defective", "FIC-6": "watch"},
        **dict.fromkeys(("FIC-7", "FIC-8", "FIC-9", "FIC-10"), "healthy"),
        **{f"PIC-{number}": "undetermined" for number in range(1, 10)},
    }


def test_tables_report_and_pages_have_one_verdict_a_valve(
    verdicts: dict[str, str], files: Path, pages: httpx.Client, valve_pages: dict[str, str]
) -> None:
    """CSV, JSON, the report's ranking, API, ranking page and each valve's page."""
    with (files / "valves.csv").open(encoding="utf-8-sig", newline="") as table:
        assert {row["valve"]: row["verdict"] for row in csv.DictReader(table)} == verdicts
    objects = json.loads((files / "valves.json").read_text("utf-8"))
    assert {item["valve"]: item["verdict"] for item in objects} == verdicts
    report = (files / "report.html").read_text("utf-8")
    for valve, verdict in verdicts.items():
        title = re.search(rf'<h2 id="valve-{valve}-title">.*?</header>', report, re.DOTALL)
        assert title is not None
        assert f"v-{verdict}" in title[0]
        page = valve_pages[valve]
        head = page[page.index('id="valve-title"') : page.index("↑ All valves")]
        assert f"v-{verdict}" in head
    assert {line["valve"]: line["verdict"] for line in _lines(pages)} == verdicts


def _lines(pages: httpx.Client) -> list[dict[str, Any]]:
    lines: list[dict[str, Any]] = pages.get("/api/v1/valves").json()["valves"]
    return lines


def test_order_severity_S_and_J_are_the_same(
    ranking: Ranking, files: Path, pages: httpx.Client
) -> None:
    """Report, tables, workbook, API, pages and terminal rank alike, and the numbers agree to the
    last digit that each shows."""
    order = [valve.screening.valve for valve in ranking]
    objects = json.loads((files / "valves.json").read_text("utf-8"))
    lines = _lines(pages)
    rows = csv_rows(files / "valves.csv")
    cells = workbook_rows(files / "valves.xlsx")
    table = views.summary(brief_ranking(every_kind()))
    for several in (objects, lines, rows, cells):
        assert [item["valve"] for item in several] == order
    assert list(table.columns[1].cells) == order
    assert [int(row["rank"]) for row in rows] == list(range(1, len(order) + 1))
    report = (files / "report.html").read_text("utf-8")
    assert re.findall(r'<tr role="row" data-anchor="valve-([^"]+)"', report) == order
    page = pages.get("/").text
    assert [item for item in re.findall(r'<a href="/valve\?id=([^"#]+)"', page)] == order
    result = zip(ranking, objects, lines, rows, cells, strict=True)
    for index, (valve, item, line, row, cell) in enumerate(result):
        for severity in (item, line):
            assert severity["severity"] == pytest.approx(valve.decision.severity)
        for severity in (row, cell):
            assert float(severity["severity (0 to 100)"]) == pytest.approx(valve.decision.severity)
        assert line["confidence"] == item["confidence"] == valve.decision.confidence
        code = None if valve.priority is None else valve.priority.code
        assert line["priority"] == item["priority"] == (cell["priority"] or None) == code
        for name, column in (("S", 3), ("J", 4)):
            value = item["stiction"][name]["value"]
            assert line[name]["value"] == value
            written = "" if value is None else pytest.approx(value)
            for table_row in (row, cell):
                text = table_row[f"{name} (%)"]
                assert (float(text) if text not in ("", None) else "") == written
            on_terminal = str(list(table.columns[column].cells)[index])
            assert on_terminal.startswith("-" if value is None else f"{value:.1f}")


def test_the_workbook_says_what_the_live_pages_say(
    files: Path, valve_pages: dict[str, str]
) -> None:
    """Severity, state by NE 107, S and J with their intervals, and every indicator of a valve: the
    numbers of its row, as its page in the service writes them."""
    texts = {valve: text_of(page) for valve, page in valve_pages.items()}
    for row in workbook_rows(files / "valves.xlsx"):
        text = texts[row["valve"]]
        if row["severity (0 to 100)"] is not None:
            assert f"Severity {figure(row['severity (0 to 100)'], 2)} of 100" in text
        for word in (row["NE 107"], row["verdict"]):
            assert word is None or word in text, row["valve"]
        for name in ("S", "J"):
            value, low, high = (row[f"{name}{part} (%)"] for part in ("", " low", " high"))
            if value is not None:
                assert f"{value:.2f}" in text, row["valve"]
                assert low is None or f"{low:.2f} to {high:.2f}" in text, row["valve"]
    shown = workbook_rows(files / "valves.xlsx", "Indicators")
    assert len(shown) > len(texts)
    for line in shown:
        written = f" {line['indicator']} {figure(line['value'])} "
        assert written in texts[line["valve"]], line["valve"]


@pytest.mark.parametrize(
    ("tag", "words", "effects"), [("FIC-9", "is no defect", 2), ("FIC-10", "no work of its own", 1)]
)
def test_what_asks_for_no_work_is_a_defect_nowhere(
    ranking: Ranking,
    files: Path,
    pages: httpx.Client,
    told: Told,
    tag: str,
    words: str,
    effects: int,
) -> None:
    """Named as such in JSON, and said in the same words in the tables, the report and on the page;
    no work order, no defect in the API, and nothing in the list for maintenance."""
    (valve,) = [item for item in ranking if item.screening.valve == tag]
    says = why_no_work(valve.decision.inherent)
    assert words in says
    assert says in valve.finding.reason
    (item,) = [item for item in json_objects(files) if item["valve"] == tag]
    assert [effect["inherent"] for effect in item["mismatch"]["effects"]] == [True] * effects
    assert says in item["reason"]
    for rows in (csv_rows(files / "valves.csv"), workbook_rows(files / "valves.xlsx")):
        (row,) = [row for row in rows if row["valve"] == tag]
        assert says in row["reason"]
        assert (row["verdict"], row["maintenance"]) == ("healthy", "no work")
    assert bare(says) in told.report[tag]
    assert bare(says) in told.pages[tag]
    (line,) = [line for line in _lines(pages) if line["valve"] == tag]
    assert line["verdict"] == "healthy"
    assert tag not in told.orders


def test_a_label_is_of_what_was_said(
    verdicts: dict[str, str], stored: tuple[Store, int], pages: httpx.Client
) -> None:
    """Verdict, effects, S and J of a label are those of ranking and page; the page that counts has
    it under that verdict, and so has the exported table."""
    store = stored[0]
    for valve in ("FIC-4", "FIC-8", "FIC-9"):
        (last,) = store.screenings(valve, 1)
        store.add_feedback(last.id, example_plant.NOW, Judgement.PARTLY, f"seen at {valve}")
    lines = {line["valve"]: line for line in _lines(pages)}
    labels = {label.valve: label for label in store.feedback()}
    assert set(labels) == {"FIC-4", "FIC-8", "FIC-9"}
    for valve, label in labels.items():
        assert label.verdict.value == verdicts[valve] == lines[valve]["verdict"]
        assert (label.S, label.J) == (lines[valve]["S"]["value"], lines[valve]["J"]["value"])
    assert labels["FIC-8"].effects == ()  # chance may have named it, so it was not said
    exported = {
        row["valve"]: row for row in csv.DictReader(io.StringIO(labels_csv([*labels.values()])))
    }
    assert {valve: row["verdict"] for valve, row in exported.items()} == {
        valve: verdicts[valve] for valve in labels
    }
    counts = text_of(pages.get("/feedback").text)
    for valve in labels:
        assert f"seen at {valve}" in counts


def test_headline_and_counts_are_the_same(
    ranking: Ranking,
    stored: tuple[Store, int],
    files: Path,
    pages: httpx.Client,
    work_list: WorkList,
) -> None:
    """Report, ranking page, terminal, run page, metrics, and the work list made from the store."""
    store, run = stored
    counts, headline = ranking.counts, ranking.counts.headline
    assert headline == "5 of 19 valves need work"
    assert (counts.watch, counts.not_judged, counts.no_work) == (1, 9, 4)
    assert headline in text_of((files / "report.html").read_text("utf-8"))
    assert headline in text_of(pages.get("/").text)
    assert headline in text_of(pages.get("/overview").text)
    overview = re.findall(r"<b>(\d+)</b>", pages.get("/overview").text)
    assert [int(item) for item in overview[:4]] == [
        counts.needs_work,
        counts.watch,
        counts.not_judged,
        counts.no_work,
    ]
    assert headline in str(views.summary(brief_ranking(every_kind())).title)
    assert headline in work_list.counts
    by_word = Counter(valve.verdict.value for valve in ranking)
    assert dict(store.run(run).counts) == dict(by_word)
    assert {k: v for k, v in pages.get("/api/v1/valves").json()["counts"].items() if v} == by_word


def test_work_orders_are_of_the_valves_that_need_work(
    ranking: Ranking, work_list: WorkList
) -> None:
    """And of those that somebody can find out about; severity and order are the ranking's."""
    ordered = {sheet.screening.valve: sheet for sheet in work_list.to_work_on}
    needing = {valve.screening.valve for valve in ranking if valve.decision.needs_work}
    assert needing == {"FIC-1", "FIC-2", "FIC-3", "FIC-4", "FIC-5"}
    assert needing | {"PIC-1", "PIC-2", "PIC-3", "PIC-5", "PIC-7"} == set(ordered)
    for valve in ranking:
        if valve.screening.valve in ordered:
            sheet = ordered[valve.screening.valve]
            assert sheet.finding.decision.severity == valve.decision.severity
            assert sheet.finding.reason == valve.finding.reason
            assert sheet.finding.next_step == valve.finding.next_step
