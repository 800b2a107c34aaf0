"""The valves of a report in their order, each with its facts, trend and anchor."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, tzinfo
from functools import partial
from typing import overload

from stemwatch.models.history.trend_over_weeks import TrendOverWeeks
from stemwatch.models.mismatch.findings import ResidualMap
from stemwatch.models.screening_result import Screening
from stemwatch.models.verdict import WORST_FIRST, Verdict
from stemwatch.service.presenter.cost_of_sticking import (
    CostOfSticking,
    RankBy,
    cost_of_sticking,
    money_a_month,
    total_in_words,
)
from stemwatch.service.presenter.false_discoveries import Discoveries, discoveries
from stemwatch.service.presenter.finding import PresentedFinding, present
from stemwatch.service.presenter.suspicion_words import next_steps
from stemwatch.service.presenter.urgency import Priority, UrgencyKey, priority_of, urgency_of
from stemwatch.service.presenter.wording import instant, printable
from stemwatch.service.presenter.work_counts import WorkCounts, count_valves
from stemwatch.service.presenter.work_decision import WorkDecision, decide
from stemwatch.service.report.change_since_last_run import Change, change_since_last_run
from stemwatch.service.report.charts.valve_plots import ValvePlots
from stemwatch.service.report.report_context import ReportContext, ValveFacts
from stemwatch.service.report.summary_lines import summary_lines

LONGEST_ANCHOR = 60


@dataclass(frozen=True, kw_only=True)
class RankedValve:
    """One screening in its place. ``rank`` counts from 1; ``anchor`` is unique in the report.

    ``stands`` is whether its effects stand among all valves of the run; ``None`` where nothing
    was named; ``confirmed`` what the windows of weeks confirm; ``finding`` is the finding in the
    words that every output uses.
    """

    rank: int
    anchor: str
    screening: Screening
    facts: ValveFacts
    trend: Change
    finding: PresentedFinding
    stands: bool | None = None
    confirmed: tuple[str, ...] | None = None
    cost: CostOfSticking | None = None
    recordings: int = 1  # of this valve in the report
    zone: tzinfo = UTC
    plots: Callable[[], ValvePlots | None] = lambda: None

    @property
    def decision(self) -> WorkDecision:
        """What it asks of maintenance, and how bad it is."""
        return self.finding.decision

    @property
    def verdict(self) -> Verdict:
        """The verdict on the valve, as every output shows it."""
        return self.finding.decision.verdict

    @property
    def priority(self) -> Priority | None:
        """How urgent its work order is; ``None`` where it has none."""
        return priority_of(self.decision, self.facts.criticality)

    @property
    def recording(self) -> str:
        """Which of its valve's recordings it is of: the file's name, and when it begins; empty
        where there is only one."""
        if self.recordings == 1:
            return ""
        name = re.split(r"[\\/]", self.screening.provenance.source)[-1]
        return f"{name}, {self.begins}" if self.begins else name

    @property
    def begins(self) -> str:
        """When its recording begins; empty where that is not known."""
        start = self.screening.window[0]
        return "" if start is None else instant(start, self.zone)

    @property
    def weeks(self) -> TrendOverWeeks | None:
        """How its S goes over weeks."""
        return self.facts.weeks

    @property
    def evidence(self) -> ValvePlots | None:
        """The data of its plots, where its samples were released; read on access."""
        return self.plots()


class Ranking(Sequence[RankedValve]):
    """The valves of a report, the one to work on first at the front (``urgency_of``); by cost
    where the context says so, and then by urgency. Its attributes count and sum up the whole run,
    so that every file of the report says the same.

    A valve is created on access from ``screenings``; where that sequence reads from a disk, only
    one valve is held in memory at a time. ``evidence`` gives the plots of the screening at a
    position of ``screenings``.

    Attributes:
        verdicts: The verdict of each screening, in the order in which they were given.
        recordings_of: How many recordings have each verdict, worst first.
        counts: How many valves need work, and where the others stand.
        units: The same for each unit, those with most to do first; empty where there are not two.
        cost_of_sticking: What it costs a month in all; empty where no price is known.
        discovered: What stands of all that was named, by false-discovery control over the run.
        summary: The lines of the first screen beside the verdicts.
        next_steps: What to do next at the valves of which only OP and PV are known.
    """

    def __init__(
        self,
        screenings: Sequence[Screening],
        context: ReportContext,
        evidence: Callable[[int], ValvePlots | None] = lambda _: None,
    ) -> None:
        self._screenings, self._context, self._evidence = screenings, context, evidence
        notes, costs = [], {}
        for screening in screenings:
            notes.append(reduced_for_ranking(screening))
            cost = self._cost(screening)
            if cost is not None:  # of several recordings the last counts
                costs[screening.valve] = cost
        run = discoveries(
            [note.mismatch for note in notes],
            context.p_elsewhere,
            [context.facts(note.valve).by_window for note in notes],
        )
        decided = [
            decide(note, stands=stands, confirmed=confirmed, groups=context.groups)
            for note, stands, confirmed in zip(notes, run.standing, run.confirmed, strict=True)
        ]
        self._order = _order_of(notes, decided, costs, context)
        self.discovered: Discoveries = replace(
            run,
            standing=tuple(run.standing[index] for index in self._order),
            confirmed=tuple(run.confirmed[index] for index in self._order),
        )
        self.verdicts = tuple(decision.verdict for decision in decided)
        recordings = Counter(self.verdicts)
        self.recordings_of = {verdict: recordings[verdict] for verdict in WORST_FIRST}
        self.counts = count_valves(
            (note.valve, decision) for note, decision in zip(notes, decided, strict=True)
        )
        self.cost_of_sticking = total_in_words(costs)
        self.units = _by_unit(
            [
                (context.facts(note.valve), note.valve, decision)
                for note, decision in zip(notes, decided, strict=True)
            ],
            costs,
        )
        self.summary = summary_lines(
            notes,
            self.verdicts,
            {note.valve: context.facts(note.valve).weeks for note in notes},
            self.cost_of_sticking,
        )
        self.next_steps = next_steps(notes, context.groups)
        self._recordings = Counter(note.valve for note in notes)
        used_anchors: Counter[str] = Counter()
        self._anchors = [anchor_of(notes[index].valve, used_anchors) for index in self._order]
        # Texts only, so that they may stay in memory: every file of a report asks for each valve.
        self._findings: dict[int, PresentedFinding] = {}

    def __len__(self) -> int:
        return len(self._order)

    @overload
    def __getitem__(self, at: int) -> RankedValve: ...

    @overload
    def __getitem__(self, at: slice) -> list[RankedValve]: ...

    def __getitem__(self, at: int | slice) -> RankedValve | list[RankedValve]:
        """The valve of rank ``at + 1``, or those of a slice."""
        if isinstance(at, slice):
            return [self._valve(rank) for rank in range(*at.indices(len(self)))]
        return self._valve(range(len(self))[at])

    def _cost(self, screening: Screening) -> CostOfSticking | None:
        prices = self._context.facts(screening.valve).prices
        return cost_of_sticking(screening.indicators, prices, self._context.currency)

    def _valve(self, rank: int) -> RankedValve:
        index = self._order[rank]
        screening = self._screenings[index]
        facts = self._context.facts(screening.valve)
        stands, confirmed = self.discovered.standing[rank], self.discovered.confirmed[rank]
        remark = self.discovered.remark(facts.by_window) if stands is False else ""
        finding = self._findings.get(rank)
        if finding is None:
            finding = self._findings[rank] = present(
                screening,
                stands=stands,
                confirmed=confirmed,
                held_back=remark,
                groups=self._context.groups,
            )
        return RankedValve(
            rank=rank + 1,
            anchor=self._anchors[rank],
            screening=screening,
            facts=facts,
            trend=change_since_last_run(
                screening, finding.decision.verdict, facts.previous, facts.weeks
            ),
            finding=finding,
            stands=stands,
            confirmed=confirmed,
            cost=self._cost(screening),
            recordings=self._recordings[screening.valve],
            zone=self._context.tz,
            plots=partial(self._evidence, index),
        )


def _order_of(
    notes: Sequence[Screening],
    decided: Sequence[WorkDecision],
    costs: Mapping[str, CostOfSticking],
    context: ReportContext,
) -> list[int]:
    """The places of ``notes`` in the order of the report."""
    by_cost = context.rank_by is RankBy.COST
    keys = [
        (
            -_a_month(costs.get(note.valve)) if by_cost else 0.0,
            urgency_of(note, decision, context.facts(note.valve).criticality),
        )
        for note, decision in zip(notes, decided, strict=True)
    ]
    return sorted(range(len(notes)), key=lambda index: keys[index])


def _a_month(cost: CostOfSticking | None) -> float:
    """Its cost a month; 0 where that is not known, so that it sorts behind all known costs."""
    return 0.0 if cost is None else max(cost.money.value or 0.0, 0.0)


def rank_valves(
    screenings: Sequence[Screening],
    context: ReportContext,
    evidence: Callable[[int], ValvePlots | None] = lambda _: None,
) -> Ranking:
    """The screenings as a ranking."""
    return Ranking(screenings, context, evidence)


def reduced_for_ranking(screening: Screening) -> Screening:
    """The screening reduced to what is needed to rank it and to decide which effects stand."""
    mismatch = screening.mismatch
    if mismatch is not None:
        empty_map = ResidualMap()
        mismatch = replace(mismatch, before=empty_map, after=empty_map, runs=None, not_testable=())
    return replace(screening.without_samples(), mismatch=mismatch, indicators={})


@dataclass(frozen=True, kw_only=True)
class UnitWork:
    """How the valves of one unit stand with maintenance, and what their sticking costs a month."""

    area: str
    unit: str
    work: WorkCounts
    cost: str


def _by_unit(
    decided: Iterable[tuple[ValveFacts, str, WorkDecision]], costs: Mapping[str, CostOfSticking]
) -> tuple[UnitWork, ...]:
    by_unit: dict[tuple[str, str], list[tuple[str, WorkDecision]]] = {}
    for facts, valve, decision in decided:
        by_unit.setdefault((facts.area, facts.unit), []).append((valve, decision))
    if sum(bool(unit) for _, unit in by_unit) < 2:
        return ()
    units = [
        UnitWork(
            area=area,
            unit=unit,
            work=count_valves(of_unit),
            cost=money_a_month({valve: costs[valve] for valve, _ in of_unit if valve in costs}),
        )
        for (area, unit), of_unit in by_unit.items()
    ]
    return tuple(
        sorted(units, key=lambda one: (-one.work.needs_work, -one.work.watch, one.area, one.unit))
    )


def provisional_urgency(screening: Screening, criticality: str) -> UrgencyKey:
    """Its place before the run is over, as if all that was named stood among all valves."""
    return urgency_of(screening, decide(screening, stands=None), criticality)


def anchor_of(valve: str, used_anchors: Counter[str]) -> str:
    """An anchor for ``valve`` that is not among ``used_anchors`` yet, and is from now on."""
    slug = re.sub(r"[^\w.-]+", "-", printable(valve)).strip("-")[:LONGEST_ANCHOR]
    anchor = f"valve-{slug or 'unnamed'}"
    # Case is folded because some readers compare anchors that way.
    used_anchors[anchor.casefold()] += 1
    repeat = used_anchors[anchor.casefold()]
    return anchor if repeat == 1 else f"{anchor}~{repeat}"
