"""The same finding reads the same in HTML, PDF, tables, JSON, work orders, mail and terminal."""

from __future__ import annotations

import io
import json
from datetime import timedelta

import openpyxl
import pytest
from rich.console import Console
from rich.text import Text

from stemwatch.models.history.evidence_over_windows import WindowEvidence
from stemwatch.models.screening_result import Screening
from stemwatch.service.alerts.digest import message_of
from stemwatch.service.alerts.rules import ValveRecord, apply_rules
from stemwatch.service.cli import screening_views as views
from stemwatch.service.cli.explanation_views import explanation
from stemwatch.service.config.service_schema import AlertRules
from stemwatch.service.explain.explain_recording import Explained
from stemwatch.service.maintenance.maintenance_html import work_list_html
from stemwatch.service.maintenance.pdf import work_list_pdf
from stemwatch.service.maintenance.work_list import WorkList, work_list_of
from stemwatch.service.presenter.evidence_of_weeks import evidence_of_weeks
from stemwatch.service.report import ReportContext, write_report
from stemwatch.service.report.ranking import Ranking, rank_valves
from stemwatch.service.store.alerts.alerts import AlertKind, StoredAlert
from stemwatch.service.store.screenings.records import JudgedScreening, StoredValve
from tests.service.maintenance.example_work_list import (
    context,
    frozen,
    mixed,
    order_rows,
    text_of_pdf,
    with_effects,
)
from tests.service.presenter.every_kind import bare, csv_rows, page_text

pytestmark = pytest.mark.filterwarnings("ignore:.*:DeprecationWarning:openpyxl")


class Outputs:
    """Everything that one run leaves, as bare text; the tables by valve."""

    def __init__(self, screenings: list[Screening], made: ReportContext, folder) -> None:
        files = write_report(screenings, made, folder)
        self.ranking: Ranking = rank_valves(screenings, made)
        self.work_list: WorkList = work_list_of(screenings, made)
        self.report = page_text(files.html.read_text("utf-8"))
        self.maintenance = page_text(work_list_html(self.work_list).decode())
        self.pdf = bare(text_of_pdf(work_list_pdf(self.work_list, compress=False)))
        self.rows = {row["valve"]: row for row in csv_rows(files.csv)}
        objects = json.loads(files.json.read_text("utf-8"))
        self.objects = {object["valve"]: object for object in objects}
        self.orders = {row["functional_location"]: row for row in order_rows(self.work_list)}
        sheet = openpyxl.load_workbook(files.xlsx)["Read me"]
        self.read_me = bare(" ".join(str(cell.value) for row in sheet for cell in row))


@pytest.fixture(scope="module")
def outputs(tmp_path_factory: pytest.TempPathFactory) -> Outputs:
    """A run with valves of every kind, none of them with hostile letters."""
    screenings = [item for item in mixed() if "<script>" not in item.valve]
    return Outputs(screenings, context(screenings), tmp_path_factory.mktemp("out"))


def test_the_finding_reads_the_same_everywhere(outputs: Outputs) -> None:
    """Reason and next step of each valve, whichever way it comes."""
    for valve in outputs.ranking:
        answer, name = valve.finding, valve.screening.valve
        item, row = outputs.objects[name], outputs.rows[name]
        assert bare(answer.reason) == bare(item["reason"]) == bare(row["reason"])
        assert bare(answer.next_step) == bare(item["advice"]) == bare(row["advice"])
        assert bare(answer.reason) in outputs.report
        assert bare(answer.next_step) in outputs.report
        line = Text.from_markup(views.verdict_line(valve.screening)).plain
        assert bare(answer.reason) in bare(line)
        if valve.stands is not False:
            assert line.startswith(answer.decision.verdict.value)
        if answer.decision.has_page:
            assert bare(answer.reason) in outputs.maintenance
            assert bare(answer.reason) in outputs.pdf
        if answer.decision.has_order:
            assert bare(answer.reason) in bare(outputs.orders[name]["long_text"])


def test_severity_and_state_are_the_same_number_and_word(outputs: Outputs) -> None:
    """JSON, table and work order agree, and whoever has an order is told so in the table."""
    for valve in outputs.ranking:
        name, decision = valve.screening.valve, valve.decision
        verdict = decision.verdict.value
        assert outputs.objects[name]["verdict"] == outputs.rows[name]["verdict"] == verdict
        assert outputs.objects[name]["stem_verdict"] == valve.screening.verdict.value
        assert outputs.objects[name]["severity"] == decision.severity
        assert float(outputs.rows[name]["severity (0 to 100)"]) == decision.severity
        assert outputs.rows[name]["maintenance"] == decision.state.value
        assert (outputs.objects[name]["ne107"] or "") == outputs.rows[name]["NE 107"]
        if name in outputs.orders:
            assert outputs.orders[name]["ne107"] == outputs.rows[name]["NE 107"]
        if decision.ne107 is not None:
            assert bare(f"NE 107{decision.ne107}") in outputs.report
    for sheet in outputs.work_list.sheets:
        assert f"severity {sheet.finding.decision.severity:.0f} of 100" in sheet.priority.reason
    needing = {v.screening.valve for v in outputs.ranking if v.decision.needs_work}
    assert needing <= set(outputs.orders)
    assert len(needing) == outputs.ranking.counts.needs_work


def test_a_valve_without_a_verdict_has_no_state_of_ne107(outputs: Outputs) -> None:
    """Nor is anything but a healthy one normal."""
    states = {item["verdict"]: item["ne107"] for item in outputs.objects.values()}
    assert states["undetermined"] is None
    assert states["sticky"] == states["defective"] == "out of specification"
    assert [verdict for verdict, state in states.items() if state == "normal"] in ([], ["healthy"])


def test_response_figures_are_on_the_page_and_in_json_with_S_and_J(outputs: Outputs) -> None:
    """Dead band is the published S, resolution the published J."""
    for item in outputs.objects.values():
        response, known = item["response"], item["stiction"]
        assert response["dead_band"] == known["S"]
        assert response["resolution"] == known["J"]
        assert bool(response["steps"]) == (known["S"]["value"] is not None)
    assert bare("Response figures of a step of OP") in outputs.report


def test_the_count_of_valves_that_need_work_is_one_sentence(outputs: Outputs) -> None:
    """Report, maintenance as HTML and PDF, workbook and terminal."""
    counts = outputs.ranking.counts
    assert counts == outputs.work_list.counted
    assert bare(counts.headline) in outputs.report
    assert bare(counts.rest) in outputs.report
    for text in (outputs.maintenance, outputs.pdf, outputs.read_me):
        assert bare(counts.sentence) in text
    assert bare(str(views.summary(outputs.ranking).title)) == bare(counts.sentence)


def test_an_effect_reads_the_same_on_page_paper_terminal_and_in_a_mail(outputs: Outputs) -> None:
    """What was found and each step of what to check."""
    (valve,) = [item for item in outputs.ranking if item.screening.valve == "FIC-9"]
    effect = valve.finding.effects[0]
    mismatch = valve.screening.mismatch
    terminal = Console(width=200, file=io.StringIO(), record=True)
    terminal.print(explanation(Explained(source="a.csv", valve="FIC-9", mismatch=mismatch)))
    answer = {
        "page": outputs.report,
        "terminal": bare(terminal.export_text()),
        "mail": bare(mail_about(valve.screening)),
        "json": bare(" ".join(outputs.objects["FIC-9"]["mismatch"]["effects"][0][key]
                              for key in ("sentence", "check"))),
    }  # fmt: skip
    for where, text in answer.items():
        assert bare(effect.sentence) in text, where
        assert bare(effect.check) in text, where
    (sheet,) = [sheet for sheet in outputs.work_list.sheets if sheet.screening.valve == "FIC-9"]
    assert bare(effect.sentence) in outputs.pdf
    for step in sheet.steps:
        assert bare(step.text) in outputs.pdf
        assert bare(step.text) in outputs.maintenance
        assert bare(step.text) in bare(outputs.orders["FIC-9"]["long_text"])


def mail_about(screening: Screening) -> str:
    """The text of the mail about a screening whose effect three windows named."""
    end = screening.window[1]
    named = tuple(effect.members for effect in screening.mismatch.effects)
    days = [end - timedelta(days=day) for day in (2, 1, 0)]
    weeks = evidence_of_weeks(WindowEvidence(at=day, named=named) for day in days)
    judged = [
        JudgedScreening(
            id=number, run_id=number, window=screening.window, verdict=screening.verdict,
            reason=screening.reason, advice=screening.advice, severity=screening.severity,
            S=screening.S, J=screening.J.value, named=True, mismatch=screening.mismatch,
        )
        for number in (2, 1)
    ]  # fmt: skip
    record = ValveRecord(
        valve=StoredValve(id=screening.valve), screenings=judged, by_window=weeks, stands=True
    )
    raised = apply_rules(record, AlertRules())[0]
    (about,) = [item for item in raised if item.kind is AlertKind.MISMATCH]
    stored = StoredAlert(
        id=1, cause=about.cause, kind=about.kind, severity=about.severity, text=about.text,
        valve=about.valve, source=None, run_id=2, opened=end, seen=end,
        evidence=about.evidence, closed=None, closed_why="",
        acknowledged=None, acknowledged_by="", comment="", snoozed_until=None, snoozed_by="",
        false_alarm=False, told=None,
    )  # fmt: skip
    text: str = message_of([stored], "plant", 2)["text"]
    return text


def test_nothing_is_green_where_nothing_could_be_judged(tmp_path) -> None:
    """Forty recordings of two tags without a position: two valves that cannot be judged."""
    screenings = [frozen(f"PIC-{k % 2}") for k in range(8)]
    every = Outputs(screenings, context(screenings), tmp_path)
    text = (tmp_path / "report.html").read_text("utf-8")
    assert 'class="is-healthy">None' not in text
    assert bare("None of 2 valves can be judged") in every.report
    assert bare("2 with a work order to find out why") in every.report
    assert bare("8 recordings of 2 valves") in every.report
    assert len(every.orders) == 2


def test_a_valve_that_follows_but_lags_is_not_told_to_look_elsewhere(tmp_path) -> None:
    """Verdict healthy, an effect that stands: the next step is that effect's."""
    from stemwatch.models.verdict import Verdict

    screenings = [with_effects(verdict=Verdict.HEALTHY)]
    every = Outputs(screenings, context(screenings), tmp_path)
    (valve,) = every.ranking
    assert valve.decision.needs_work
    assert valve.finding.next_step == valve.finding.effects[0].check
    assert every.objects["FIC-9"]["advice"] == valve.finding.next_step
