"""The order of the report: worst first, each valve with its facts, trend and anchor."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import overload

from stemwatch.models.mismatch.findings import Mismatch, ResidualMap
from stemwatch.models.screening_result import Screening
from stemwatch.models.verdict import Verdict
from stemwatch.service.report.change_since_last_run import Change, change_since_last_run
from stemwatch.service.report.charts.valve_plots import ValvePlots
from stemwatch.service.report.false_discoveries import Discoveries, discoveries
from stemwatch.service.report.report_context import ReportContext, ValveFacts
from stemwatch.service.report.wording import WORST_FIRST, finite, printable

LONGEST_ANCHOR = 60


@dataclass(frozen=True, kw_only=True)
class RankedValve:
    """One screening in its place. ``rank`` counts from 1; ``anchor`` is unique in the report.

    ``stands`` is whether its effects stand among all valves of the run; ``None`` where nothing
    was named.
    """

    rank: int
    anchor: str
    screening: Screening
    facts: ValveFacts
    trend: Change
    stands: bool | None = None
    plots: Callable[[], ValvePlots | None] = lambda: None

    @property
    def evidence(self) -> ValvePlots | None:
        """What its plots draw, where its samples were let go; read when it is asked for."""
        return self.plots()


class Ranking(Sequence[RankedValve]):
    """The valves of a report, worst first: by verdict (sticky, watch, undetermined, healthy), then
    severity, then tag.

    A valve is made when it is asked for, from whatever ``screenings`` is: where that reads from a
    disk, only one valve is held at a time. ``evidence`` gives the plots of the screening at a place
    of ``screenings``. ``discovered`` is what stands of all that was named in the run.
    """

    def __init__(
        self,
        screenings: Sequence[Screening],
        context: ReportContext,
        evidence: Callable[[int], ValvePlots | None] = lambda _: None,
    ) -> None:
        self._screenings, self._context, self._evidence = screenings, context, evidence
        notes = [(worst_first(one), one.valve, light(one.mismatch)) for one in screenings]
        self._order = sorted(range(len(notes)), key=lambda place: notes[place][0])
        named = [notes[place][2] for place in self._order]
        self.discovered: Discoveries = discoveries(named, context.p_elsewhere)
        taken: Counter[str] = Counter()
        self._anchors = [anchor_of(notes[place][1], taken) for place in self._order]

    def __len__(self) -> int:
        return len(self._order)

    @overload
    def __getitem__(self, at: int) -> RankedValve: ...

    @overload
    def __getitem__(self, at: slice) -> list[RankedValve]: ...

    def __getitem__(self, at: int | slice) -> RankedValve | list[RankedValve]:
        """The valve of rank ``at + 1``, or those of a slice."""
        if isinstance(at, slice):
            return [self._valve(one) for one in range(*at.indices(len(self)))]
        return self._valve(range(len(self))[at])

    def _valve(self, at: int) -> RankedValve:
        place = self._order[at]
        screening = self._screenings[place]
        facts = self._context.facts(screening.valve)
        return RankedValve(
            rank=at + 1,
            anchor=self._anchors[at],
            screening=screening,
            facts=facts,
            trend=change_since_last_run(screening, facts.previous),
            stands=self.discovered.standing[at],
            plots=partial(self._evidence, place),
        )


def rank_valves(
    screenings: Sequence[Screening],
    context: ReportContext,
    evidence: Callable[[int], ValvePlots | None] = lambda _: None,
) -> Ranking:
    """By verdict (sticky, watch, undetermined, healthy), then severity, then tag."""
    return Ranking(screenings, context, evidence)


def discovered(ranked: Sequence[RankedValve], context: ReportContext) -> Discoveries:
    """What stands of all that was named in the run of ``ranked``."""
    if isinstance(ranked, Ranking):
        return ranked.discovered
    return discoveries([valve.screening.mismatch for valve in ranked], context.p_elsewhere)


def light(mismatch: Mismatch | None) -> Mismatch | None:
    """As much of a mismatch as it takes to say which effects stand."""
    if mismatch is None:
        return None
    nothing = ResidualMap()
    return replace(mismatch, before=nothing, after=nothing, runs=None, not_testable=())


def count_verdicts(screenings: Iterable[Screening]) -> dict[Verdict, int]:
    """How many valves there are of each verdict, worst first."""
    counted = Counter(screening.verdict for screening in screenings)
    return {verdict: counted[verdict] for verdict in WORST_FIRST}


def worst_first(screening: Screening) -> tuple[int, float, str]:
    """A key that sorts the worst to the front."""
    severity = finite(screening.severity) or 0.0
    return WORST_FIRST.index(screening.verdict), -severity, screening.valve


def anchor_of(valve: str, taken: Counter[str]) -> str:
    """An anchor for ``valve`` that is not among ``taken`` yet, and is from now on."""
    slug = re.sub(r"[^\w.-]+", "-", printable(valve)).strip("-")[:LONGEST_ANCHOR]
    anchor = f"valve-{slug or 'unnamed'}"
    # Case is folded because some readers compare anchors that way.
    taken[anchor.casefold()] += 1
    repeat = taken[anchor.casefold()]
    return anchor if repeat == 1 else f"{anchor}~{repeat}"
