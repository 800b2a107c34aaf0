"""One run with valves of every kind, as it was stored, reported and served: they must agree."""

from __future__ import annotations

import csv
import html
import io
import itertools
import json
import re
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any
from zoneinfo import ZoneInfo

import httpx
import openpyxl
import pytest
from rich.text import Text

from stemwatch.models.recording import Provenance
from stemwatch.models.screening.screen import failed
from stemwatch.models.screening_result import Screening
from stemwatch.models.verdict import NoVerdict, Verdict
from stemwatch.service.alerts.digest import message_of
from stemwatch.service.alerts.evaluate import gathered
from stemwatch.service.alerts.rules import apply_rules
from stemwatch.service.cli import screening_views as views
from stemwatch.service.config import load_plant
from stemwatch.service.maintenance.labels import labels_csv
from stemwatch.service.maintenance.maintenance_html import work_list_html
from stemwatch.service.maintenance.pdf import work_list_pdf
from stemwatch.service.maintenance.stored import report_of_store
from stemwatch.service.maintenance.work_list import WorkList, work_list_of
from stemwatch.service.maintenance.work_orders import orders_csv
from stemwatch.service.presenter.finding import why_no_work
from stemwatch.service.presenter.suspicion_words import SUSPECTED_NOTE
from stemwatch.service.presenter.wording import figure
from stemwatch.service.report import ReportContext, ValveFacts, write_report
from stemwatch.service.report.ranking import Ranking, rank_valves
from stemwatch.service.run.engine import in_brief
from stemwatch.service.run.finish import hold_back
from stemwatch.service.store.alerts.alerts import RaisedAlert, StoredAlert
from stemwatch.service.store.screenings.feedback import Judgement
from stemwatch.service.store.screenings.records import StoredValve
from stemwatch.service.store.store import Store, open_store
from stemwatch.service.web.site import Site
from tests.service.maintenance.example_work_list import context, frozen, with_effects
from tests.service.report.conftest import screening
from tests.service.report.test_without_position import cannot_tell, no_sign, suspected
from tests.service.web import example_plant
from tests.service.web.signed_in import cookie_of

pytestmark = pytest.mark.filterwarnings("ignore:.*:DeprecationWarning:openpyxl")

NO_POSITION = (
    "Cannot tell: there is no valve position in this recording, and what OP and PV alone say is "
    "no verdict."
)
BAD = "Cannot tell: 62 % of the samples are missing or marked bad."
IN_MM = "Cannot tell: ZT8 is in mm, so OP and position cannot be compared."
SHORT = "Cannot tell: the recording is too short: 90 usable samples in 1.5 minutes."
SLOW = "Cannot tell: the archive stores the position every 300 s, too seldom to see how it moves."
SLUGS = {NO_POSITION: "no_position", BAD: "bad_samples", IN_MM: "position_unit"}


def blind(valve: str, reason: str) -> Screening:
    """A valve that cannot be judged."""
    result = screening(valve, Verdict.UNDETERMINED, samples=60)
    why = NoVerdict.of(SLUGS.get(reason))
    return replace(result, reason=reason, no_verdict=why, still_seen=(), severity=15.0)


def by_chance(valve: str) -> Screening:
    """A healthy valve on which chance alone may have named an effect."""
    result = with_effects(valve, Verdict.HEALTHY)
    assert result.mismatch is not None
    return replace(result, mismatch=replace(result.mismatch, p_value=0.6))


def as_built(valve: str) -> Screening:
    """A healthy drive whose effects belong to such a machine."""
    result = with_effects(valve, Verdict.HEALTHY)
    assert result.mismatch is not None
    effects = tuple(replace(effect, inherent=True) for effect in result.mismatch.effects)
    return replace(result, mismatch=replace(result.mismatch, effects=effects))


def slightly_off(valve: str) -> Screening:
    """A healthy valve whose position reads high by less than is worth a work order."""
    result = with_effects(valve, Verdict.HEALTHY)
    assert result.mismatch is not None
    (first, *_) = result.mismatch.effects
    zero = replace(first, slug="zero_shift", members=("zero_shift",), inherent=True)
    return replace(result, mismatch=replace(result.mismatch, effects=(zero,)))


def every_kind() -> list[Screening]:
    """Sticky, sticky with an effect, defective, to watch, healthy, and what cannot be judged, for
    each main reason, also where OP and PV alone let sticking be suspected or show no sign of it."""
    return [*_made_once()]


@cache
def _made_once() -> tuple[Screening, ...]:
    return (
        screening("FIC-1", S=6.0),
        screening("FIC-2", S=2.1, J=0.3),
        with_effects("FIC-3", Verdict.STICKY),
        with_effects("FIC-4", Verdict.HEALTHY),
        with_effects("FIC-5", Verdict.WATCH),
        screening("FIC-6", Verdict.WATCH, S=1.1),
        screening("FIC-7", Verdict.HEALTHY, S=0.3),
        by_chance("FIC-8"),
        as_built("FIC-9"),
        slightly_off("FIC-10"),
        frozen("PIC-1"),
        blind("PIC-2", NO_POSITION),
        blind("PIC-3", BAD),
        failed(
            "PIC-4", "x.csv: the file is empty", "Look at the file.", Provenance(source="x.csv")
        ),
        replace(blind("PIC-5", NO_POSITION), without_position=suspected()),
        replace(blind("PIC-6", NO_POSITION), without_position=no_sign()),
        blind("PIC-7", IN_MM),
        replace(blind("PIC-8", SHORT), without_position=cannot_tell("OP is at its limit")),
        blind("PIC-9", SLOW),
    )


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Store, int]]:
    """The run in a store, with what stands among its valves decided."""
    folder = tmp_path_factory.mktemp("stored")
    with open_store(f"sqlite:///{folder / 'plant.db'}") as store:
        yield store, save_run(store)


def save_run(store: Store) -> int:
    """The run of every kind into ``store``."""
    facts = needed(every_kind()).valves
    store.save_valves(
        StoredValve(id=valve, criticality=int(facts[valve].criticality)) for valve in facts
    )
    run = store.begin_run(software_version="1")
    for item in every_kind():
        store.save(item.without_samples(), run)
    hold_back(store, run)
    store.finish_run(run)
    return run


def brief_ranking(screenings: Iterable[Screening]) -> Ranking:
    """As the terminal has it."""
    return rank_valves(brief := [in_brief(item) for item in screenings], needed(brief))


def needed(screenings: Iterable[Screening]) -> ReportContext:
    """The plant can least do without one valve, next to without another, by turns, so that the
    order is neither that of severity nor that of tags."""
    made = context(list(screenings))
    levels = itertools.cycle("213")
    return replace(
        made,
        valves={
            valve: replace(facts, criticality=next(levels)) for valve, facts in made.valves.items()
        },
    )


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


def text_of(page: str) -> str:
    """A page's text with single blanks."""
    return " ".join(html.unescape(re.sub(r"<[^>]+>", " ", page)).split())


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


def bare(text: str) -> str:
    """Without blanks, line breaks and what stands for an unprintable letter."""
    return re.sub(r"[\s\N{NO-BREAK SPACE}\ufffd]+", "", html.unescape(text))


def page_text(page: str) -> str:
    """What a reader of a page sees, without blanks."""
    return bare(re.sub(r"<script.*?</script>|<style.*?</style>|<[^>]+>", " ", page, flags=re.S))


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
    parts = re.findall(rb"\((.*?)(?<!\\)\) Tj", work_list_pdf(book, compress=False))
    orders = csv.DictReader(io.StringIO(orders_csv(book).decode("utf-8-sig")))
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
        orders={row["functional_location"]: row for row in orders},
        maintenance=page_text(work_list_html(book).decode()),
        paper=bare(re.sub(r"\\([()\\])", r"\1", b" ".join(parts).decode("latin-1"))),
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
    objects = {item["valve"]: item for item in _objects(files)}
    tables = [
        {row["valve"]: row for row in rows}
        for rows in (_rows(files / "valves.csv"), _workbook(files / "valves.xlsx"))
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
    rows = _rows(files / "valves.csv")
    cells = _workbook(files / "valves.xlsx")
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
    for row in _workbook(files / "valves.xlsx"):
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
    shown = _workbook(files / "valves.xlsx", "Indicators")
    assert len(shown) > len(texts)
    for line in shown:
        written = f" {line['indicator']} {figure(line['value'])} "
        assert written in texts[line["valve"]], line["valve"]


def _rows(file: Path) -> list[dict[str, str]]:
    with file.open(encoding="utf-8-sig", newline="") as table:
        return list(csv.DictReader(table))


def _workbook(file: Path, sheet: str = "Ranking") -> list[dict[str, Any]]:
    """The rows of one sheet."""
    header, *rows = openpyxl.load_workbook(file)[sheet].iter_rows(values_only=True)
    return [dict(zip(map(str, header), row, strict=True)) for row in rows]


@pytest.mark.parametrize(
    ("tag", "words", "effects"), [("FIC-9", "no defects", 2), ("FIC-10", "no work of its own", 1)]
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
    (item,) = [item for item in _objects(files) if item["valve"] == tag]
    assert [effect["inherent"] for effect in item["mismatch"]["effects"]] == [True] * effects
    assert says in item["reason"]
    for rows in (_rows(files / "valves.csv"), _workbook(files / "valves.xlsx")):
        (row,) = [row for row in rows if row["valve"] == tag]
        assert says in row["reason"]
        assert (row["verdict"], row["maintenance"]) == ("healthy", "no work")
    assert bare(says) in told.report[tag]
    assert bare(says) in told.pages[tag]
    (line,) = [line for line in _lines(pages) if line["valve"] == tag]
    assert line["verdict"] == "healthy"
    assert tag not in told.orders


def _objects(files: Path) -> list[dict[str, Any]]:
    result: list[dict[str, Any]] = json.loads((files / "valves.json").read_text("utf-8"))
    return result


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


def test_what_weeks_say_has_the_same_words_and_days_everywhere(tmp_path: Path) -> None:
    """JSON, report, valve page, work sheet as HTML and order, and mail, also where a window ends
    late in the evening in UTC, which is the next day in the plant."""
    tz = ZoneInfo("Asia/Singapore")
    valve = "FIC-5"
    windows = [_late_on(day, valve) for day in range(4)]
    (tmp_path / "plant.toml").write_text('[plant]\nname = "Tuas"\nzone = "Asia/Singapore"\n')
    plant = load_plant(tmp_path / "plant.toml")
    with open_store(f"sqlite:///{tmp_path / 'plant.db'}") as store:
        run = store.begin_run(software_version="1")
        for item in windows:
            store.save(item.without_samples(), run)
        store.finish_run(run)
        by_window = store.evidence([valve])[valve]
        answer = by_window.sentences(tz)
        assert "first seen on 2026-03-03" in answer[0]  # in UTC it is the second
        facts = {valve: ValveFacts(by_window=by_window)}
        report_context = ReportContext(
            started=example_plant.NOW, zone="Asia/Singapore", valves=facts
        )
        files = write_report(windows[-1:], report_context, tmp_path / "report")
        (item,) = json.loads(files.json.read_text("utf-8"))
        assert [effect["sentence"] for effect in item["over_weeks"]] == list(
            answer[: len(item["over_weeks"])]
        )
        book = report_of_store(store, tmp_path / "book", plant=plant, run=run).work_list
        (record,) = gathered(store, plant, [valve], {valve: (by_window, True)})
        (alert,) = [
            apply_rule
            for apply_rule in apply_rules(record, plant.alerts)[0]
            if "MISMATCH" in apply_rule.kind.name
        ]
        site = Site(store=store, plant=plant, clock=lambda: example_plant.NOW)
        with example_plant.serving(site) as base:
            page = httpx.get(
                f"{base}/valve", params={"id": valve}, cookies=cookie_of(site), trust_env=False,
                verify=False, timeout=30.0,
            ).text  # fmt: skip
    html_texts = (files.html.read_text("utf-8"), page, work_list_html(book).decode())
    for sentence in answer:
        for text in html_texts:
            assert sentence in text_of(text).replace("\N{NO-BREAK SPACE}", " ")
    assert answer[0] in alert.text


def _late_on(day: int, valve: str) -> Screening:
    """A window that ends at half past four in the afternoon in UTC, past midnight in Singapore."""
    result = with_effects(valve, Verdict.WATCH)
    assert result.recording is not None
    start = datetime(2026, 3, 2 + day, 15, 30, tzinfo=UTC)
    return replace(result, recording=replace(result.recording, start=start))


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


def test_recordings_of_one_valve_are_told_apart_and_counted_as_one(tmp_path: Path) -> None:
    """Three files of one tag are one valve with one page and one order; wherever each recording has
    a row of its own, the file says which it is, and rows are counted as recordings."""
    files = ("june.txt", "july.txt", "august.txt")
    several = [
        replace(blind("LIC-1", NO_POSITION), provenance=Provenance(source=f"exports/{file}"))
        for file in files
    ]
    every = [*several, screening("FIC-1", S=6.0)]
    ranked = rank_valves(every, context(every))
    assert (ranked.counts.valves, ranked.counts.recordings) == (2, 4)
    assert ranked[0].recording == ""
    named = {valve.recording for valve in ranked[1:]}
    assert named == {f"{file}, 2026-03-02 07:00" for file in files}
    written = write_report(every, context(every), tmp_path)
    sources = [(valve.screening.valve, valve.screening.provenance.source) for valve in ranked]
    for rows in (_rows(written.csv), _workbook(written.xlsx), _objects(tmp_path)):
        assert [(row["valve"], row["recording"]) for row in rows] == sources
    report = written.html.read_text("utf-8")
    table = report[report.index('id="ranking-table"') :]
    table = table[: table.index("</table>")]
    terminal = list(views.summary(brief_ranking(every)).columns[1].cells)
    for file in files:
        assert table.count(file) == 1
        assert [f"LIC-1\n{file}" in str(cell) for cell in terminal].count(True) == 1
    assert ">4 recordings</output>" in report
    assert "3 without a state" not in text_of(report)
    assert "Of the recordings:" in text_of(report)
    assert "1 out of specification, 1 without a state" in text_of(report)
    listed = work_list_of(every, context(every))
    assert [sheet.screening.valve for sheet in listed.sheets] == ["FIC-1", "LIC-1"]
    assert listed.to_work_on == listed.sheets
    page = text_of(work_list_html(listed).decode())
    assert "The most urgent of 3 recordings:" in page
    assert ranked.counts.sentence in page
    assert ranked.counts.sentence.startswith("1 of 2 valves needs work; 1 cannot be judged (1 with")
    assert ranked.counts.sentence.endswith("(4 recordings).")
    (line, *_) = views.undetermined_lines(every)
    assert line.count("LIC-1") == 1


def test_suspected_loops_and_those_without_a_sign_are_told_alike_everywhere(
    tmp_path: Path,
) -> None:
    """A loop to test first is marked in every ranking, leads the orders, and is nowhere among those
    of which nothing can be told; one without a sign is marked too and makes no work order, as its
    advice says. The terminal has the step for each answer."""
    answers = {
        "A-NONE": no_sign(),
        "B-DUMB": cannot_tell("the record is short"),
        "C-FIRST": suspected(),
    }
    every = [
        replace(blind(valve, NO_POSITION), without_position=answer)
        for valve, answer in answers.items()
    ]
    ranked = rank_valves(every, context(every))
    assert ranked.counts.sentence == (
        "None of 3 valves can be judged; 2 with a work order to find out why."
    )
    listed = work_list_of(every, context(every))
    assert [one.screening.valve for one in listed.to_work_on] == ["C-FIRST", "B-DUMB"]
    told = [Text.from_markup(line).plain for line in views.undetermined_lines(every)]
    assert [line.partition("  ")[0] for line in told] == [
        "sticking suspected C-FIRST",
        "cannot tell B-DUMB",
        "no sign of sticking A-NONE",
    ]
    assert told[0].endswith("  it looks as if the valve sticks by 2.5 % of OP. Do a bump test.")
    (valves, verdicts) = (views.summary(brief_ranking(every)).columns[n].cells for n in (1, 2))
    marked = [v for v, word in zip(valves, verdicts, strict=True) if SUSPECTED_NOTE in str(word)]
    assert [str(valve) for valve in marked] == ["C-FIRST"]
    report = write_report(every, context(every), tmp_path).html.read_text("utf-8")
    table = report[report.index('id="ranking-table"') :]
    rows = table[: table.index("</table>")].split("<tr ")
    assert ["C-FIRST" in row for row in rows if SUSPECTED_NOTE in row] == [True]


def test_a_frozen_transmitter_is_not_told_that_there_is_nothing_to_do() -> None:
    """Its order says to mend it; that OP and PV show no sign of sticking changes nothing."""
    dead = replace(frozen("FIC-1"), without_position=no_sign())
    sound = replace(blind("FIC-2", NO_POSITION), without_position=no_sign())
    (step,) = rank_valves([dead, sound], context([dead, sound])).next_steps
    assert step.loops == ("FIC-2",)
