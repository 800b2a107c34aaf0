"""What OP and PV alone say of a valve is the same in every output."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from rich.text import Text

from stemwatch.models.mismatch.open_question import OpenQuestion
from stemwatch.models.verdict import Verdict
from stemwatch.service.cli import screening_views as views
from stemwatch.service.maintenance.work_list import work_list_of
from stemwatch.service.presenter.suspicion_words import SUSPECTED_NOTE
from stemwatch.service.report import write_report
from stemwatch.service.report.ranking import rank_valves
from tests.service.maintenance.example_work_list import context, frozen, mixed, order_rows
from tests.service.presenter.every_kind import (
    NO_POSITION,
    SHORT,
    blind,
    brief_ranking,
)
from tests.service.report.test_without_position import cannot_tell, no_sign, suspected

pytestmark = pytest.mark.filterwarnings("ignore:.*:DeprecationWarning:openpyxl")


def test_suspected_loops_and_those_without_a_sign_are_told_alike_everywhere(
    tmp_path: Path,
) -> None:
    """A loop to test first is marked in every ranking, leads the orders, and is nowhere among those
    of which nothing can be told; one without a sign is marked too and makes no work order, as its
    advice says. Page and order of the suspected one are called so and begin with its test. The
    terminal has the step for each answer."""
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
    assert [one.title for one in listed.to_work_on] == [SUSPECTED_NOTE, "no position feedback"]
    suspicious, dumb = (one.steps[0].text for one in listed.to_work_on)
    assert suspicious == "Do a bump test."
    assert dumb != suspicious
    orders = order_rows(listed)
    assert [row["short_text"] for row in orders] == [SUSPECTED_NOTE, "no position feedback"]
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


def test_what_is_next_is_only_what_can_be_done() -> None:
    """Work orders where there are any, and a planned test only at valves of which one can be
    planned: not without a position, nor with one that is to be mended."""
    open_one = OpenQuestion(op=50.0)
    still = replace(blind("FIC-3", SHORT), open_question=open_one)
    lacking = replace(
        blind("FIC-1", NO_POSITION), without_position=no_sign(), open_question=open_one
    )
    dead = replace(frozen("FIC-2"), open_question=open_one)
    (sound,) = [one for one in mixed() if one.verdict is Verdict.HEALTHY][:1]
    assert views.next_sentence(brief_ranking([lacking, sound])) == "open the report."
    orders = "open the report; the PDF and the work orders beside it go to whoever plans the work."
    assert views.next_sentence(brief_ranking([lacking, dead])) == orders
    assert views.next_sentence(brief_ranking([still])) == (
        "open the report. `stemwatch plan-test FIC-3` plans the test that tells what was left "
        "open there."
    )
    two = [still, replace(still, valve="FIC-4"), dead]
    assert views.next_sentence(brief_ranking(two)).endswith("left open there, as it can at 1 more.")


def test_a_frozen_transmitter_is_not_told_that_there_is_nothing_to_do() -> None:
    """Its order says to mend it; that OP and PV show no sign of sticking changes nothing."""
    dead = replace(frozen("FIC-1"), without_position=no_sign())
    sound = replace(blind("FIC-2", NO_POSITION), without_position=no_sign())
    (step,) = rank_valves([dead, sound], context([dead, sound])).next_steps
    assert step.loops == ("FIC-2",)
