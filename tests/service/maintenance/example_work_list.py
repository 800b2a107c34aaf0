"""A plant for the maintenance report: valves of every kind, hostile ones among them."""

from __future__ import annotations

import csv
import io
import re
from dataclasses import replace
from datetime import UTC, datetime, timedelta

from stemwatch.models.screening_result import PreviousFinding, Screening
from stemwatch.models.verdict import NoVerdict, Verdict
from stemwatch.service.maintenance import ValveHistory
from stemwatch.service.maintenance.work_list import WorkList
from stemwatch.service.maintenance.work_orders import orders_csv
from stemwatch.service.presenter.advice import catalogue
from stemwatch.service.report import ReportContext, ValveFacts
from stemwatch.service.store.screenings.records import Remark
from tests.service.example_mismatches import named
from tests.service.report.conftest import context_of, plant, screening

HOSTILE = '=1+1|<script>alert("x")</script>&\u202e\x00 ÄÖŁЖΩ 弁 밸브 🙂'
BEGAN = datetime(2026, 2, 23, 6, 0, tzinfo=UTC)


def frozen(valve: str = "PIC-7") -> Screening:
    """A valve whose position stands still, without samples."""
    reason = "Cannot tell: the position did not change by one digit while OP moved over 9 %."
    blind = screening(valve, Verdict.UNDETERMINED, samples=60)
    return replace(
        blind, reason=reason, no_verdict=NoVerdict.POSITION_FROZEN, still_seen=()
    ).without_samples()


def with_effects(valve: str = "FIC-9", verdict: Verdict = Verdict.WATCH) -> Screening:
    """A valve with an effect beyond chance."""
    result = screening(valve, verdict, S=2.0, J=0.5)
    return replace(result, mismatch=replace(named(result.recording), p_value=1e-9))


def mixed() -> list[Screening]:
    """A dozen valves, and one of each kind beside."""
    return [*plant(12), frozen(), with_effects(), screening(HOSTILE, S=7.0)]


def context(screenings: list[Screening], **changes: object) -> ReportContext:
    """The plant's context; every valve of criticality 3 with a stroke of 40 mm."""
    result = context_of(screenings)
    facts = {
        valve: replace(item, criticality="3", stroke="40 mm")
        for valve, item in result.valves.items()
    }
    return replace(result, valves=facts, **changes)


def earlier(result: Screening) -> list[PreviousFinding]:
    """Sticky for two weeks, healthy before."""
    verdicts = (Verdict.STICKY, Verdict.STICKY, Verdict.HEALTHY)
    return [
        PreviousFinding(
            at=BEGAN - timedelta(days=7 * week), run=40 - week, verdict=verdict, S=4.0, J=1.5
        )
        for week, verdict in enumerate(verdicts)
    ]


def work(valve: str) -> list[Remark]:
    """The packing was renewed in January."""
    at = datetime(2026, 1, 10, 8, 0, tzinfo=UTC)
    return [Remark(valve=valve, at=at, note="packing renewed", who="M. Weiß")]


BACKGROUND = ValveHistory(earlier=earlier, work=work, run=41)


def longest() -> tuple[list[Screening], ReportContext, ValveHistory]:
    """Pages that ask for more room than there is: every kind, every text far too long."""
    kinds = list(catalogue())
    matching = []
    for first in range(0, len(kinds), 3):
        item = with_effects("W" * 60 + str(first), Verdict.STICKY)
        assert item.mismatch is not None
        effect = item.mismatch.effects[0]
        effects = tuple(
            replace(
                effect,
                slug=kind,
                members=(kind, "actuator_lag", "dead_time"),
                sentence=f"A long sentence about {kind} " * 8,
                decide="Step it this way and that way. " * 12,
            )
            for kind in kinds[first : first + 3]
        )
        quality = replace(item.quality, reasons=("remark " * 90,))
        mismatch = replace(item.mismatch, effects=effects)
        matching.append(
            replace(item, mismatch=mismatch, reason="long reason " * 150, quality=quality)
        )
    report_context = context(matching)
    facts = {valve: _long(item) for valve, item in report_context.valves.items()}
    note = [Remark(valve="", at=BEGAN, note="packing renewed " * 60, who="")]
    background = replace(BACKGROUND, work=lambda _: note)
    return matching, replace(report_context, valves=facts), background


def _long(facts: ValveFacts) -> ValveFacts:
    return replace(facts, description="d " * 300, area="a " * 200)


def text_of_pdf(pdf: bytes) -> str:
    """The ASCII letters of an uncompressed PDF in their order; words of a line in one piece."""
    parts = re.findall(rb"\((.*?)(?<!\\)\) Tj", pdf)
    return re.sub(r"\\([()\\])", r"\1", b" ".join(parts).decode("latin-1"))


def order_rows(work_list: WorkList) -> list[dict[str, str]]:
    """The work orders as the CSV has them."""
    return list(csv.DictReader(io.StringIO(orders_csv(work_list).decode("utf-8-sig"))))
