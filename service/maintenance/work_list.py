"""``WorkList``: a page for each valve that needs work, in the order of the report, and the rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from stemwatch.models.screening_result import Screening
from stemwatch.models.verdict import Verdict
from stemwatch.service.maintenance.valve_history import NOTHING_KNOWN, ValveHistory
from stemwatch.service.maintenance.work_compared import WorkCompared, newest_first
from stemwatch.service.maintenance.work_sheet import WorkSheet, brief_of, work_sheet_of
from stemwatch.service.presenter.work_counts import WorkCounts
from stemwatch.service.report.ranking import rank_valves
from stemwatch.service.report.report_context import ReportContext


@dataclass(frozen=True, kw_only=True)
class ValveWithoutPage:
    """A valve without a page, and the line that is said of it."""

    valve: str
    verdict: Verdict
    line: str


@dataclass(frozen=True, kw_only=True)
class WorkList:
    """``sheets`` and ``others`` in the order of the report, which is that in which to work, one a
    valve: of several recordings the most urgent one's. ``discovered`` is what
    stands of all that was named in the run; ``done`` the last work on its valves that has a window
    before and one after it, the newest of ``worked``."""

    sheets: tuple[WorkSheet, ...]
    others: tuple[ValveWithoutPage, ...]
    counted: WorkCounts
    context: ReportContext
    discovered: str = ""
    done: tuple[WorkCompared, ...] = ()
    worked: int = 0
    run: int | None = None

    @property
    def to_work_on(self) -> tuple[WorkSheet, ...]:
        """Those of ``sheets`` that make a work order."""
        return tuple(sheet for sheet in self.sheets if sheet.has_order)

    @property
    def done_title(self) -> str:
        """What stands over ``done``."""
        only_newest = self.worked > len(self.done)
        count_text = f" ({len(self.done)} newest of {self.worked})" if only_newest else ""
        return f"Before and after the last work{count_text}"

    @property
    def counts(self) -> str:
        """What is in it, in one sentence."""
        return self.counted.sentence


def work_list_of(
    screenings: Sequence[Screening],
    context: ReportContext,
    background: ValveHistory = NOTHING_KNOWN,
    *,
    everything: bool = False,
) -> WorkList:
    """The work list of a run. With ``everything`` each valve gets a page, healthy ones too."""
    ranked = rank_valves(screenings, context)
    sheets, others = [], []
    for valve in ranked:
        if everything or valve.decision.has_page:
            sheets.append(work_sheet_of(valve, background, context.tz))
        else:
            screening = valve.screening
            brief = ValveWithoutPage(
                valve=screening.valve, verdict=valve.verdict, line=brief_of(valve)
            )
            others.append(brief)
    by_valve: dict[str, WorkSheet] = {}
    for sheet in sheets:
        by_valve.setdefault(sheet.screening.valve, sheet)
    without: dict[str, ValveWithoutPage] = {}
    for other in others:
        if other.valve not in by_valve:
            without.setdefault(other.valve, other)
    works = background.compared({valve.screening.valve for valve in ranked})
    return WorkList(
        sheets=tuple(by_valve.values()),
        others=tuple(without.values()),
        counted=ranked.counts,
        context=context,
        discovered=ranked.discovered.sentence,
        done=newest_first(works),
        worked=len(works),
        run=background.run,
    )
