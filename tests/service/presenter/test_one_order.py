"""Whoever reads the report, the work orders, the pages on paper or a mail begins with one valve."""

from __future__ import annotations

import html
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from stemwatch.models.verdict import Verdict
from stemwatch.models.without_position.suspicion import SMALL_S_PERCENT, Suspicion
from stemwatch.service.alerts.digest import message_of
from stemwatch.service.maintenance.maintenance_html import work_list_html
from stemwatch.service.maintenance.pdf import work_list_pdf
from stemwatch.service.maintenance.stored import report_of_store
from stemwatch.service.presenter.finding import present
from stemwatch.service.presenter.suspicion_words import next_steps
from stemwatch.service.report.ranking import rank_valves
from stemwatch.service.report.report_context import ReportContext, ValveFacts
from stemwatch.service.store.alerts.alerts import AlertKind, AlertSeverity, RaisedAlert
from stemwatch.service.store.screenings.ranking import RankingFilter
from stemwatch.service.store.screenings.records import StoredValve
from stemwatch.service.store.store import open_store
from tests.service.maintenance.example_work_list import context, order_rows, text_of_pdf
from tests.service.presenter.every_kind import (
    NO_POSITION,
    blind,
    every_kind,
    needed,
    save_run,
)
from tests.service.report.conftest import START, screening
from tests.service.report.test_without_position import no_sign, suspected
from tests.service.web import example_plant


def test_maintenance_alerts_and_mail_have_the_order_of_the_ranking(tmp_path) -> None:
    """Pages on paper and on screen, work orders, what a run shows first, the alerts and their
    mail."""
    order = [valve.screening.valve for valve in rank_valves(every_kind(), needed(every_kind()))]
    with open_store(f"sqlite:///{tmp_path / 'plant.db'}") as store:
        run = save_run(store)
        book = report_of_store(store, tmp_path / "out", run=run, all_valves=True).work_list
        assert [sheet.screening.valve for sheet in book.sheets] == order
        paper = text_of_pdf(work_list_pdf(book, compress=False))
        screen = html.unescape(re.sub(r"<[^>]+>", " ", work_list_html(book).decode()))
        assert tags_in(paper, order) == tags_in(screen, order) == order

        rows = order_rows(book)
        ordered = [row["functional_location"] for row in rows]
        assert ordered == [valve for valve in order if valve in ordered]
        priorities = [int(row["priority"]) for row in rows]
        assert priorities == sorted(priorities)
        assert len(set(priorities)) > 2

        assert store.worst_of_run(run, len(order)) == order
        store.alerts.raise_all([an_alert(valve, run) for valve in sorted(order)])
        alerted = store.alerts.in_state("open", example_plant.NOW)
        assert [alert.valve for alert in alerted] == order
        mail = message_of(store.deliveries.undelivered(), "plant", run)
        assert tags_in(mail["text"], order) == order


def test_the_list_of_next_steps_says_what_each_valve_is_told(tmp_path) -> None:
    """What to do next where there is no verdict, from the report and from the store."""
    ranking = rank_valves(every_kind(), needed(every_kind()))
    answers = {valve.screening.valve: valve.finding for valve in ranking}
    with open_store(f"sqlite:///{tmp_path / 'plant.db'}") as store:
        save_run(store)
        assert next_steps(store.without_verdict()) == ranking.next_steps
    open_steps = [step for step in ranking.next_steps if step.verdict is not Suspicion.NO_SIGN]
    assert {loop for step in open_steps for loop in step.loops} == {"PIC-5", "PIC-8"}
    for step in open_steps:
        for loop in step.loops:
            assert step.step in answers[loop].next_step, loop


@pytest.mark.parametrize("shows_from", [2.0, 2.1])
def test_no_sign_makes_no_order_only_where_a_small_S_would_have_shown(tmp_path, shows_from) -> None:
    """In the report and in the store alike: where only more would have shown, a position is asked
    for, also where another recording of the valve leaves nothing to do."""
    told = replace(no_sign(), shows_from=shows_from, advice="Do a bump test.")
    both = [
        replace(blind("FIC-2", NO_POSITION), without_position=answer)
        for answer in (no_sign(), told, no_sign())
    ]
    told_alone, orders = both[1], int(shows_from > SMALL_S_PERCENT)
    assert rank_valves([told_alone], context([told_alone])).counts.orders == orders
    with open_store(f"sqlite:///{tmp_path / 'plant.db'}") as store:
        run = store.begin_run(software_version="1")
        store.save(told_alone.without_samples(), run)
        store.finish_run(run)
        assert store.ranking(RankingFilter()).orders == orders
    if orders:
        (step,) = next_steps(both)
        assert step.step == "Do a bump test."


@pytest.mark.parametrize("criticality", [1, 2, 3])
def test_a_suspected_loop_is_tested_before_any_other_without_a_position(
    tmp_path: Path, criticality: int
) -> None:
    """As its own text says, however critical each is; its order does not wait for the next stop,
    and it is no more urgent than a stem that was seen to stick. Report and store agree."""
    suspicious = replace(blind("B-LOOP", NO_POSITION), without_position=suspected())
    other, sticky = blind("A-LOOP", NO_POSITION), screening("C-LOOP", Verdict.STICKY, S=1.5)
    every = [other, suspicious, replace(sticky, severity=58.5)]
    assert "Test it before other loops without a position" in " ".join(
        present(suspicious, stands=None).still_seen
    )
    levels = {"A-LOOP": 3, "B-LOOP": criticality, "C-LOOP": criticality}
    facts = {valve: ValveFacts(criticality=str(level)) for valve, level in levels.items()}
    ranked = rank_valves(every, ReportContext(started=START, valves=facts))
    valves = [StoredValve(id=valve, criticality=level) for valve, level in levels.items()]
    with open_store(f"sqlite:///{tmp_path / 'plant.db'}") as store:
        store.save_valves(valves)
        run = store.begin_run(software_version="1")
        for one in every:
            store.save(one.without_samples(), run)
        store.finish_run(run)
        lines = store.ranking(RankingFilter()).lines
    told = {valve.screening.valve: valve.priority for valve in ranked}
    assert [line.valve for line in lines] == list(told) == ["C-LOOP", "B-LOOP", "A-LOOP"]
    assert {line.valve: line.priority for line in lines} == told
    assert told["C-LOOP"].code <= told["B-LOOP"].code <= 3


def tags_in(text: str, tags: Sequence[str]) -> list[str]:
    """The tags in the order in which ``text`` has them first."""
    longest_first = sorted(tags, key=len, reverse=True)
    return list(dict.fromkeys(re.findall("|".join(map(re.escape, longest_first)), text)))


def an_alert(valve: str, run: int) -> RaisedAlert:
    """That the valve sticks; not of the same severity everywhere."""
    severity = AlertSeverity.HIGH if valve < "FIC-5" else AlertSeverity.LOW
    return RaisedAlert(
        cause=f"sticky {valve}",
        kind=AlertKind.STICKY,
        severity=severity,
        text=f"{valve}: sticks.",
        valve=valve,
        run_id=run,
        evidence={},
    )
