"""How often windows of weeks confirm effects that are present, and effects that are not, on
simulated valves.

Valves with nothing hidden over daily windows of a month, and valves with each effect of the
catalogue over some windows, through ``explain`` and ``models.history.evidence_over_windows``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from stemwatch.models.estimate import Estimate
from stemwatch.models.history.evidence_over_windows import (
    WindowEvidence,
    lasting_findings,
    pooled_stiction,
)
from stemwatch.models.mismatch.findings import EffectScore
from stemwatch.models.studies.simulator.hidden import (
    PHYSICS,
    HiddenCase,
    draw_effect,
    draw_nulls,
    simulate_hidden,
)
from stemwatch.models.studies.simulator.hidden.draws import windows_of
from stemwatch.service.executors import Executor, map_in_order
from stemwatch.service.studies.partial_results import append_line, stored_lines

_BEGIN = datetime(2026, 1, 5, tzinfo=UTC)


@dataclass(frozen=True)
class WatchedValve:
    """One valve to follow over ``windows`` windows, for a worker. What they say is kept in
    ``file``, where one is given, window by window: what was begun goes on from there."""

    case: HiddenCase
    windows: int
    file: Path | None = None


@dataclass(frozen=True, kw_only=True)
class FollowedValve:
    """One valve and what its windows say. ``hidden`` is empty for one with nothing hidden;
    ``testable`` in how many windows it could have shown; ``S`` and ``J`` as a person reads them,
    percent of span."""

    hidden: tuple[str, ...]
    concealment: str
    S: float
    J: float
    testable: int
    windows: tuple[WindowEvidence, ...]

    def right_name(self, slug: str) -> bool:
        """Whether ``slug`` is what is hidden, by class: that, or what some window could not tell
        from it."""
        classes = [set(members) for window in self.windows for members in window.named]
        hidden = set(self.hidden)
        return slug in hidden or any(slug in members and members & hidden for members in classes)


def follow(
    nulls: int,
    days: int,
    valves: int,
    windows: int,
    seed: int,
    executor: Executor,
    on_progress: Callable[[int], None] = lambda _: None,
    effects: Sequence[str] = PHYSICS,
    keep: Path | None = None,
    concealment: str | None = None,
) -> list[FollowedValve]:
    """``nulls`` valves with nothing hidden over ``days`` windows, and ``valves`` with each of
    ``effects`` over ``windows``, in ``concealment`` or in all of them in turn. ``on_progress``
    hears how many valves are done. What windows say is kept in the folder ``keep``, and is not
    explained again."""

    def watched(name: str, case: HiddenCase, count: int) -> WatchedValve:
        return WatchedValve(case, count, None if keep is None else keep / f"{seed}-{name}.jsonl")

    jobs = [
        watched(f"{case.concealment}-null-{n}", case, days)
        for n, case in enumerate(draw_nulls(nulls, seed, concealment))
    ]
    jobs += [
        watched(f"{case.concealment}-{slug}-{n}", case, windows)
        for slug in effects
        for n, case in enumerate(draw_effect(slug, valves, seed, concealment))
    ]
    return map_in_order(executor, _follow, [(job,) for job in jobs], on_progress)


def _follow(jobs: Sequence[WatchedValve]) -> list[FollowedValve]:
    return [_followed(job) for job in jobs]


def _followed(job: WatchedValve) -> FollowedValve:
    windows = [_read(line) for line in stored_lines(job.file)[: job.windows]]
    for index, case in enumerate(windows_of(job.case, job.windows)):
        if index >= len(windows):
            window, could = _explained(case, index)
            append_line(job.file, _kept(window, could))
            windows.append((window, could))
    valve = job.case.loop.valve
    return FollowedValve(
        hidden=job.case.hidden,
        concealment=job.case.concealment,
        S=valve.S_read,
        J=valve.J_read,
        testable=sum(could for _, could in windows),
        windows=tuple(window for window, _ in windows),
    )


# The evidence of a window, and whether the hidden effect could have shown in it.
Said = tuple[WindowEvidence, bool]


def _explained(case: HiddenCase, day: int) -> Said:
    from stemwatch.models.mismatch.explain import explain

    shown, run = simulate_hidden(case)
    at = _BEGIN + timedelta(days=day)
    mismatch = explain(run.recording)
    # Names are what is counted, also of effects that are too small to need work.
    window = WindowEvidence.of(
        mismatch, at, start=at - timedelta(hours=1), effects=mismatch.effects
    )
    return window, shown.excited and all(window.looked_for(slug) for slug in case.hidden)


def _kept(window: WindowEvidence, could: bool) -> dict[str, Any]:
    """As a line of JSON, in which no key is a pair."""
    sizes = [[*place, asdict(size)] for place, size in window.sizes.items()]
    return {**asdict(replace(window, sizes={})), "sizes": sizes, "could": could}


def _read(kept: dict[str, Any]) -> Said:
    could = bool(kept.pop("could"))
    kept["sizes"] = {(slug, name): Estimate(**size) for slug, name, size in kept["sizes"]}
    kept |= {name: Estimate(**kept[name]) for name in ("S", "J") if kept[name] is not None}
    kept |= {name: datetime.fromisoformat(kept[name]) for name in ("at", "start")}
    kept["named"] = tuple(tuple(members) for members in kept["named"])
    kept["scores"] = tuple(EffectScore(**score) for score in kept["scores"])
    return WindowEvidence(**kept), could


@dataclass(frozen=True, kw_only=True)
class CountedOver:
    """Counts after so many ``windows``: nulls on which something was ever confirmed, valves with an
    effect that is confirmed by class, confirmed effects and how many of them are right."""

    windows: int
    false: int
    nulls: int
    found: int
    valves: int
    right: int
    named: int


def counted(followed: Sequence[FollowedValve]) -> list[FollowedValve]:
    """The valves whose effect could have shown in two of their windows at least."""
    return [valve for valve in followed if valve.hidden and valve.testable >= 2]


def count_over(followed: Sequence[FollowedValve], windows: int) -> CountedOver:
    """What stands after the first ``windows`` windows."""
    nulls = [valve for valve in followed if not valve.hidden and len(valve.windows) >= windows]
    others = counted(followed)
    false = sum(
        any(finding.confirmed is not None for finding in lasting_findings(valve.windows[:windows]))
        for valve in nulls
    )
    confirmed = [
        [finding.slug for finding in lasting_findings(valve.windows[:windows]) if finding.holds]
        for valve in others
    ]
    right = [
        sum(valve.right_name(slug) for slug in slugs)
        for valve, slugs in zip(others, confirmed, strict=True)
    ]
    return CountedOver(
        windows=windows,
        false=false,
        nulls=len(nulls),
        found=sum(count > 0 for count in right),
        valves=len(others),
        right=sum(right),
        named=sum(len(slugs) for slugs in confirmed),
    )


@dataclass(frozen=True, kw_only=True)
class SizeErrors:
    """Median error of S and J, percent of span, and in how many of ``of`` the interval holds the
    truth."""

    name: str
    median: float
    holds: int
    of: int


def size_errors(followed: Sequence[FollowedValve]) -> list[SizeErrors]:
    """Of single windows, and pooled over those of one valve, where an effect is confirmed."""
    single: list[tuple[Estimate | None, float]] = []
    pooled: list[tuple[Estimate | None, float]] = []
    for valve in followed:
        findings = lasting_findings(valve.windows)
        pooled_sizes = pooled_stiction(valve.windows, findings)
        holds = any(finding.holds for finding in findings)
        if not valve.hidden or not holds or pooled_sizes is None:
            continue
        pooled += [(pooled_sizes.S, valve.S), (pooled_sizes.J, valve.J)]
        single += [(window.S, valve.S) for window in valve.windows if window.named]
        single += [(window.J, valve.J) for window in valve.windows if window.named]
    return [_errors("one window", single), _errors("windows together", pooled)]


def _errors(name: str, pairs: Sequence[tuple[Estimate | None, float]]) -> SizeErrors:
    known = [(estimate.with_interval, truth) for estimate, truth in pairs if estimate is not None]
    intervals = [(*interval, truth) for interval, truth in known if interval is not None]
    errors = [abs(value - truth) for value, _, _, truth in intervals]
    return SizeErrors(
        name=name,
        median=float(np.median(errors)) if errors else float("nan"),
        holds=sum(low <= truth <= high for _, low, high, truth in intervals),
        of=len(intervals),
    )
