"""The order of the report: worst first, each valve with its facts, its trend and its anchor."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from stemwatch.models.findings import Screening
from stemwatch.models.verdict import Verdict
from stemwatch.service.report.context import ReportContext, ValveFacts
from stemwatch.service.report.discoveries import Discoveries, discoveries
from stemwatch.service.report.trend import Trend, trend
from stemwatch.service.report.words import WORST_FIRST, finite, printable

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
    trend: Trend
    stands: bool | None = None


def rank_valves(screenings: Sequence[Screening], context: ReportContext) -> list[RankedValve]:
    """By verdict (sticky, watch, undetermined, healthy), then severity, then tag."""
    taken: Counter[str] = Counter()
    ranked = []
    ordered = sorted(screenings, key=_worst_first)
    standing = _discoveries(ordered, context).standing
    for place, (screening, stands) in enumerate(zip(ordered, standing, strict=True), start=1):
        facts = context.facts(screening.valve)
        ranked.append(
            RankedValve(
                rank=place,
                anchor=anchor_of(screening.valve, taken),
                screening=screening,
                facts=facts,
                trend=trend(screening, facts.previous),
                stands=stands,
            )
        )
    return ranked


def discovered(ranked: Sequence[RankedValve], context: ReportContext) -> Discoveries:
    """What stands of all that was named in the run of ``ranked``."""
    return _discoveries([valve.screening for valve in ranked], context)


def _discoveries(screenings: Sequence[Screening], context: ReportContext) -> Discoveries:
    return discoveries([one.mismatch for one in screenings], context.p_elsewhere)


def count_verdicts(screenings: Sequence[Screening]) -> dict[Verdict, int]:
    """How many valves there are of each verdict, worst first."""
    counted = Counter(screening.verdict for screening in screenings)
    return {verdict: counted[verdict] for verdict in WORST_FIRST}


def _worst_first(screening: Screening) -> tuple[int, float, str]:
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
