"""What stands beside the verdict, as one run was stored, reported, served, ordered and told: the
state of NAMUR NE 107, when S will reach its limit, what OP and PV alone suggest, loops that
oscillate together, and findings that chance alone may have named."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import timedelta
from typing import Any

import httpx
import pytest

from stemwatch.models.limits import Limits
from stemwatch.models.oscillation_groups.plant_groups import GroupMember, OscillationGroup
from stemwatch.models.screening_result import Screening
from stemwatch.models.verdict import NoVerdict, Verdict
from stemwatch.service.cli import screening_views as views
from stemwatch.service.maintenance.maintenance_html import work_list_html
from stemwatch.service.maintenance.pdf import work_list_pdf
from stemwatch.service.maintenance.stored import report_of_store
from stemwatch.service.presenter import oscillation_words
from stemwatch.service.presenter.finding import NAMED_BY_CHANCE, present
from stemwatch.service.presenter.suspicion_words import suspected_sentence, worth_a_test_sentence
from stemwatch.service.presenter.work_decision import ne107_word
from stemwatch.service.report import write_report
from stemwatch.service.report.ranking import Ranking, rank_valves
from stemwatch.service.run.engine import in_brief
from stemwatch.service.run.finish import hold_back
from stemwatch.service.store.store import open_store
from stemwatch.service.web.site import Site
from tests.service.maintenance.example_work_list import (
    context,
    order_rows,
    text_of_pdf,
    with_effects,
)
from tests.service.presenter.every_kind import (
    NO_POSITION,
    bare,
    by_chance,
    csv_rows,
    page_text,
    workbook_rows,
)
from tests.service.report.conftest import START, screening
from tests.service.report.test_without_position import suspected
from tests.service.web import example_plant
from tests.service.web.signed_in import cookie_of

pytestmark = pytest.mark.filterwarnings("ignore:.*:DeprecationWarning:openpyxl")
DAY = timedelta(days=1)
# What the recording of an oscillating loop with a healthy valve says by itself.
OWN_TUNING = "Look for the cause in the controller's tuning or in a disturbance upstream."
DAYS = 20  # of history, over which S of one valve rises


def on_day(found: Screening, day: int) -> Screening:
    """The screening of a window on another day."""
    assert found.recording is not None
    return replace(found, recording=replace(found.recording, start=START + day * DAY))


def last_run() -> list[Screening]:
    """Sticky, rising towards its limit, defective, named by chance, and without a position."""
    blind = screening("PIC-5", Verdict.UNDETERMINED)
    blind = replace(
        blind,
        reason=NO_POSITION,
        no_verdict=NoVerdict.NO_POSITION,
        without_position=suspected(),
        still_seen=(),
    )
    victim = replace(screening("FIC-7", Verdict.HEALTHY, S=0.3), advice=OWN_TUNING)
    every = [
        screening("FIC-1", S=6.0),
        screening("FIC-6", Verdict.WATCH, S=0.5 + 0.03 * DAYS),
        with_effects("FIC-4", Verdict.HEALTHY),
        by_chance("FIC-8"),
        victim,
        blind,
    ]
    return [on_day(one, DAYS) for one in every]


GROUP = OscillationGroup(
    period_s=229.0,
    members=(
        GroupMember(loop="FIC-1", share=0.8, probability=0.6, evidence=("it leads",)),
        GroupMember(loop="PIC-5", share=0.5, probability=0.2),
        GroupMember(loop="FIC-7", share=0.4, probability=0.1),
    ),
    outside=0.1,
    regularity=5.0,
    start=START + DAYS * DAY,
    duration_s=86400.0,
    since=None,
    strength=(0.1, 1.4),
    periods_s=(40.0, 60.0, 90.0, 135.0, 229.0, 900.0),
    spectra=((0.0, 0.0, 0.1, 0.2, 1.0, 0.3),) * 3,
)


@dataclass(frozen=True)
class Outputs:
    """Everything that the run left: texts without blanks, tables and objects by valve."""

    ranking: Ranking
    report: str
    maintenance: str
    paper: str
    terminal: str
    overview: str
    pages: Mapping[str, str]
    tables: tuple[Mapping[str, Mapping[str, Any]], ...]
    objects: Mapping[str, Mapping[str, Any]]
    lines: Mapping[str, Mapping[str, Any]]
    orders: Mapping[str, Mapping[str, str]]
    groups: list[dict[str, Any]]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Outputs:
    """The run, after weeks in which S of FIC-6 rose."""
    folder, every = tmp_path_factory.mktemp("run"), last_run()
    with open_store(f"sqlite:///{folder / 'plant.db'}") as store:
        for day in range(DAYS):
            number = store.begin_run(software_version="1")
            rising = screening("FIC-6", Verdict.HEALTHY, S=0.5 + 0.03 * day)
            store.save(on_day(rising, day).without_samples(), number)
            store.finish_run(number)
        number = store.begin_run(software_version="1")
        for one in every:
            store.save(one.without_samples(), number)
        store.keep_oscillations(number, [GROUP])
        hold_back(store, number)
        store.finish_run(number)
        weeks = store.trends([one.valve for one in every], Limits())
        made = context(every, groups=(GROUP,))
        facts = {valve: replace(one, weeks=weeks.get(valve)) for valve, one in made.valves.items()}
        made = replace(made, valves=facts)
        files = write_report(every, made, folder / "report")
        book = report_of_store(store, folder / "book", run=number, all_valves=True).work_list
        site = Site(store=store, clock=lambda: START + (DAYS + 1) * DAY)
        with (
            example_plant.serving(site) as base,
            httpx.Client(
                base_url=base, trust_env=False, verify=False, timeout=30.0, cookies=cookie_of(site)
            ) as client,
        ):
            valves = [one.valve for one in every]
            pages = {valve: client.get("/valve", params={"id": valve}).text for valve in valves}
            lines = client.get("/api/v1/valves").json()["valves"]
            groups = client.get("/api/v1/oscillations").json()
            overview = client.get("/overview").text
    tables = csv_rows(files.csv), workbook_rows(files.xlsx)
    return Outputs(
        ranking=rank_valves(every, made),
        report=page_text(files.html.read_text("utf-8")),
        maintenance=page_text(work_list_html(book).decode()),
        paper=bare(text_of_pdf(work_list_pdf(book, compress=False))),
        terminal=bare(
            str(views.summary(rank_valves([in_brief(one) for one in every], made)).caption)
        ),
        overview=page_text(overview),
        pages={valve: page_text(page) for valve, page in pages.items()},
        tables=tuple({str(row["valve"]): row for row in table} for table in tables),
        objects={one["valve"]: one for one in json.loads(files.json.read_text("utf-8"))},
        lines={one["valve"]: one for one in lines},
        orders={row["functional_location"]: row for row in order_rows(book)},
        groups=groups,
    )


def test_the_state_of_ne107_is_that_of_the_verdict(run: Outputs) -> None:
    """In JSON, tables, API, work orders, the report and each valve's page."""
    for valve in run.ranking:
        name, state = valve.screening.valve, ne107_word(valve.verdict)
        assert valve.decision.ne107 == run.objects[name]["ne107"] == run.lines[name]["ne107"]
        assert run.objects[name]["ne107"] == state
        for table in run.tables:
            assert (table[name]["NE 107"] or None) == state
        assert (bare(f"NE 107 {state}") in run.pages[name]) == (state is not None), name
        if name in run.orders:
            assert (run.orders[name]["ne107"] or None) == state
    assert bare("NE 107 out of specification") in run.report


def test_when_S_reaches_its_limit_is_one_sentence(run: Outputs) -> None:
    """Report, valve's page, tables, and both forms of the maintenance report."""
    (rising,) = [one for one in run.ranking if one.screening.valve == "FIC-6"]
    assert rising.facts.weeks is not None
    words = rising.facts.weeks.words
    assert "reaches 1.5 % in" in words
    for text in (run.report, run.pages["FIC-6"], run.maintenance, run.paper):
        assert bare(words) in text
    for table in run.tables:
        assert words in str(table["FIC-6"]["trend"])
    others = [one for one in run.ranking if one.screening.valve != "FIC-6"]
    assert not any("reaches" in one.trend.words for one in others)


def test_what_op_and_pv_let_suspect_is_no_verdict_anywhere(run: Outputs) -> None:
    """The same reason, score and apparent S on page, report, JSON and tables; named first on the
    terminal and in the report; undetermined, without S, everywhere."""
    told = suspected()
    for text in (run.report, run.pages["PIC-5"]):
        assert bare(told.reason) in text
        assert bare(told.advice) in text
    one = run.objects["PIC-5"]
    assert (one["verdict"], one["stiction"]["S"]["value"]) == ("undetermined", None)
    assert one["without_position"]["reason"] == told.reason
    assert one["without_position"]["score"] == told.score
    for table in run.tables:
        row = table["PIC-5"]
        assert row["verdict"] == "undetermined"
        assert (row["S (%)"] or None) is None
        assert float(row["sticking score (0 to 1)"]) == pytest.approx(told.score)
    first = bare(suspected_sentence(["PIC-5"]))
    assert first in run.report
    (blind,) = [one for one in run.ranking if one.screening.valve == "PIC-5"]
    sooner = blind.finding.still_seen[0]
    assert sooner == worth_a_test_sentence(blind.screening)
    assert "Test it before other loops" in sooner
    for text in (run.maintenance, run.paper):
        assert bare(sooner) in text
    assert sooner in run.orders["PIC-5"]["long_text"]
    assert first in run.terminal
    assert run.lines["PIC-5"]["verdict"] == "undetermined"


def test_loops_that_oscillate_together_are_the_same_group(run: Outputs) -> None:
    """Report, each member's page, overview, JSON and API; nobody else is said to be in it."""
    headline = bare(oscillation_words.headline(GROUP))
    assert headline in run.report
    assert headline in run.overview
    (group,) = run.groups
    members = [member["loop"] for member in group["members"]]
    for name, one in run.objects.items():
        inside = [told["loops"] for told in one["oscillates_with"]]
        assert inside == ([members] if name in members else [])
        assert (bare("more likely begins") in run.pages[name]) == (name in ("PIC-5", "FIC-7"))
    (told,) = run.objects["PIC-5"]["oscillates_with"]
    assert told["source"] == group["source"] == GROUP.source == "FIC-1"


def test_a_healthy_loop_that_another_moves_is_sent_there(run: Outputs) -> None:
    """Its advice is that of the group in report, JSON, tables and page; its own tuning, which its
    recording alone would have blamed, is blamed nowhere."""
    (victim,) = [one for one in run.ranking if one.screening.valve == "FIC-7"]
    advice = victim.finding.next_step
    assert "Look at FIC-1 first" in advice
    assert run.objects["FIC-7"]["advice"] == advice
    for table in run.tables:
        assert table["FIC-7"]["advice"] == advice
    for text in (run.report, run.pages["FIC-7"]):
        assert bare(advice) in text
        assert bare(OWN_TUNING) not in text


def test_what_chance_may_have_named_is_held_back_everywhere(run: Outputs) -> None:
    """No work, no defect and no state but normal; the same remark on page and in the report; what
    stands is held back nowhere."""
    by_valve = {one.screening.valve: one for one in run.ranking}
    assert (by_valve["FIC-8"].stands, by_valve["FIC-4"].stands) == (False, True)
    for table in run.tables:
        stands = {name: table[name]["beyond chance"] for name in ("FIC-4", "FIC-8")}
        assert stands == {"FIC-4": "yes", "FIC-8": "held back"}
    assert run.objects["FIC-8"]["verdict"] == run.lines["FIC-8"]["verdict"] == "healthy"
    assert run.objects["FIC-8"]["ne107"] == "normal"
    assert "FIC-8" not in run.orders
    assert "FIC-4" in run.orders
    remark = bare("chance alone may have named")
    assert remark in run.pages["FIC-8"]
    assert remark not in run.pages["FIC-4"]
    assert remark in run.maintenance
    assert remark in run.paper


def test_an_effect_in_the_reason_that_is_held_back_is_said_to_be(run: Outputs) -> None:
    """S and J were restated with it, so the reason has it; terminal, tables and JSON then say that
    chance alone may have named it, and say so of nothing that stands."""
    (valve,) = [one for one in run.ranking if one.screening.valve == "FIC-4"]
    screening, mismatch = valve.screening, valve.screening.mismatch
    assert mismatch is not None
    named = replace(screening, reason=f"{screening.reason} {mismatch.effects[0].sentence}")
    assert NAMED_BY_CHANCE in present(named, stands=False).reason
    assert NAMED_BY_CHANCE not in present(named, stands=True).reason
    assert NAMED_BY_CHANCE not in present(replace(screening, reason="."), stands=False).reason


def test_what_is_foreseen_is_the_same_everywhere(run: Outputs) -> None:
    """Ranking, report, page and JSON have the sentence of one function; JSON its numbers; a valve
    without weeks behind it has none."""
    trend = run.objects["FIC-6"]["trend"]
    assert trend["is_change"] is True
    assert trend["S_per_month"]["value"] == pytest.approx(0.91, abs=0.05)
    assert 0 < trend["weeks_until_sticky"]["low"] < trend["weeks_until_sticky"]["value"]
    assert "reaches 1.5 % in" in trend["sentence"]
    for text in (run.report, run.pages["FIC-6"]):
        assert bare(trend["sentence"]) in text
    assert run.objects["FIC-1"]["trend"] is None
