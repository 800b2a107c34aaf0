"""Scores of terms and pairs on simulated nulls (valves with nothing hidden), and limits from them.

A term is named where its advantage on held-out blocks has a mean and a t value above limits. At
most a given share of *valves* with nothing hidden may pass them with any term, so they rest on the
null distribution of the maximum over all terms. What is beyond the limits in use is counted for
each kind of record and each friction of the plant.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from stemwatch.models.mismatch.acceptance_limits import (
    LEAST_OF_A_PAIR,
    MUCH_LEFT,
    NOISY,
    NOT_LITTLE_IN_NOISE,
    NOT_LITTLE_LEFT,
)
from stemwatch.models.mismatch.explain import explain
from stemwatch.models.recording import Floats
from stemwatch.models.studies.null_scores import null_scores
from stemwatch.models.studies.simulator.hidden import HiddenCase, draw_nulls
from stemwatch.service.executors import Executor, map_in_order

QUANTILES = (0.5, 0.9, 0.95, 0.97, 0.99, 1.0)
RATE = 0.03  # of the nulls that may exceed a limit
BATCH = 4
_ROUNDING = 1e-9

# (mean, t) of each term on each null, in the same order for all terms.
Scores = dict[str, list[tuple[float, float]]]
KARNOPP, LUGRE = "Karnopp", "LuGre"  # the frictions of the plant: a packing that gives is LuGre's


@dataclass(frozen=True, kw_only=True)
class NullValve:
    """What chance reached on one valve with nothing hidden.

    ``strongest`` is that of any term over its limits, ``pair`` that of the weaker of the best pair;
    ``named`` the strength of what is named in the end, 0 where nothing is; ``left`` is what S and J
    leave, ``noise`` the share of the breakaway level that the noise is, and ``likelihood`` the
    strength of the strongest term by the likelihood of the record (``NullScores``).
    """

    concealment: str
    friction: str
    scatter: float
    terms: dict[str, tuple[float, float]]
    strongest: float
    pair: float
    named: float = 0.0
    left: float = 0.0
    noise: float = 0.0
    likelihood: float = 0.0


@dataclass(frozen=True, kw_only=True)
class DerivedLimit:
    """A limit ``in_use``, and the least one that follows the ``rule``: what at most ``RATE`` of the
    nulls exceed. Where it is below the derived one, ``beyond`` of the nulls pass it."""

    name: str
    rule: str
    in_use: float
    derived: float
    beyond: int

    @property
    def follows(self) -> bool:
        """Whether the limit in use lets through no more nulls than the rule."""
        return self.in_use >= self.derived


def derived_limits(valves: Sequence[NullValve]) -> list[DerivedLimit]:
    """Each limit that nulls can tell, and the value that at most ``RATE`` of them exceed."""
    columns = (
        ("strength", "of what is named in the end", 1.0, [valve.named for valve in valves]),
        (
            "strength in the first round",
            "of the strongest term, before the guards",
            1.0,
            [valve.strongest for valve in valves],
        ),
        (
            "weaker of a pair",
            "of the strongest pair",
            LEAST_OF_A_PAIR,
            [valve.pair for valve in valves],
        ),
        (
            "strength by likelihood",
            "of the strongest term, before the guards",
            1.0,
            [valve.likelihood for valve in valves],
        ),
        (
            "not little left",
            "of what S and J leave",
            NOT_LITTLE_LEFT,
            [valve.left for valve in valves],
        ),
        (
            "not little left in noise",
            f"of what S and J leave behind noise of {100.0 * NOISY:.0f} % of the level",
            NOT_LITTLE_IN_NOISE,
            [valve.left for valve in valves if valve.noise >= NOISY] or [0.0],
        ),
        ("much left", "of what S and J leave", MUCH_LEFT, [valve.left for valve in valves]),
    )
    return [
        DerivedLimit(
            name=name,
            rule=rule,
            in_use=in_use,
            derived=float(np.quantile(values, 1.0 - RATE, method="higher")),
            beyond=sum(value >= in_use for value in values),
        )
        for name, rule, in_use, values in columns
    ]


@dataclass(frozen=True, kw_only=True)
class NullGroup:
    """Nulls of one kind: ``passing`` of ``of`` have a term beyond its limits, ``pairs`` of them a
    pair beyond the limit of pairs; quantiles at ``QUANTILES`` of both strengths."""

    kind: str
    of: int
    passing: int
    pairs: int
    strongest: tuple[float, ...]
    pair: tuple[float, ...]


def groups(valves: Sequence[NullValve]) -> list[NullGroup]:
    """All nulls together, then by friction and by kind of record."""
    members: dict[str, list[NullValve]] = defaultdict(list)
    for valve in valves:
        members["all"].append(valve)
    for valve in sorted(valves, key=lambda valve: valve.friction):
        members[f"friction {valve.friction}"].append(valve)
    for valve in sorted(valves, key=lambda valve: valve.concealment):
        members[valve.concealment].append(valve)
    return [_group(kind, of_kind) for kind, of_kind in members.items()]


def _group(kind: str, valves: Sequence[NullValve]) -> NullGroup:
    strongest = np.array([valve.strongest for valve in valves])
    pair = np.array([valve.pair for valve in valves])
    return NullGroup(
        kind=kind,
        of=len(valves),
        passing=int(np.sum(strongest >= 1.0)),
        pairs=int(np.sum(pair >= LEAST_OF_A_PAIR)),
        strongest=tuple(float(q) for q in np.quantile(strongest, QUANTILES)),
        pair=tuple(float(q) for q in np.quantile(pair, QUANTILES)),
    )


@dataclass(frozen=True, kw_only=True)
class TermNulls:
    """One term on nulls: quantiles of mean and t at ``QUANTILES``, and the limit of the mean.

    ``limit`` is the least mean that, with t at its limit, lets ``share`` of the nulls divided by
    the number of terms through.
    """

    slug: str
    of: int
    mean: tuple[float, ...]
    t: tuple[float, ...]
    limit: float


@dataclass(frozen=True, kw_only=True)
class CommonLimit:
    """A limit of the mean for all terms alike: the quantile of the maximum over the terms.

    ``passing`` of ``of`` nulls have a term whose t and mean are above both limits.
    """

    t_limit: float
    share: float
    mean_limit: float
    passing: int
    of: int


def term_nulls(scores: Scores, t_limit: float, share: float) -> list[TermNulls]:
    """One row for each term, the one with the highest limit first."""
    rows = []
    for slug, pairs in scores.items():
        means, ts = np.array(pairs).T
        rows.append(
            TermNulls(
                slug=slug,
                of=means.size,
                mean=tuple(float(q) for q in np.quantile(means, QUANTILES)),
                t=tuple(float(q) for q in np.quantile(ts, QUANTILES)),
                limit=_limit(np.where(ts >= t_limit, means, 0.0), share / len(scores)),
            )
        )
    return sorted(rows, key=lambda row: (-row.limit, row.slug))


def common_limit(scores: Scores, t_limit: float, share: float) -> CommonLimit:
    """The one limit of the mean that at most ``share`` of the nulls exceed with any term."""
    grid = np.array(list(scores.values()))
    highest = np.where(grid[:, :, 1] >= t_limit, grid[:, :, 0], 0.0).max(axis=0)
    limit = _limit(highest, share)
    return CommonLimit(
        t_limit=t_limit,
        share=share,
        mean_limit=limit,
        passing=int(np.sum(highest > limit + _ROUNDING)),
        of=highest.size,
    )


def _limit(values: Floats, share: float) -> float:
    """The least limit, in hundredths, that at most ``share`` of ``values`` exceed."""
    limit = float(np.quantile(values, 1.0 - share, method="higher"))
    return max(float(np.ceil(100.0 * (limit - _ROUNDING)) / 100.0), 0.0)


def calibrate(
    cases: int, seed: int, executor: Executor, on_progress: Callable[[int], None]
) -> list[NullValve]:
    """What chance reaches on each of ``cases`` nulls drawn with ``seed``, in the order drawn.

    ``on_progress`` hears how many are done.
    """
    null_cases = draw_nulls(cases, seed)
    batches = [
        tuple(null_cases[first : first + BATCH]) for first in range(0, len(null_cases), BATCH)
    ]
    return map_in_order(executor, _scored, batches, on_progress)


def scores_of(valves: Iterable[NullValve]) -> Scores:
    """(mean, t) by term; a term that a recording cannot test scores (0, 0) there."""
    rows = [valve.terms for valve in valves]
    slugs = sorted({slug for row in rows for slug in row})
    return {slug: [row.get(slug, (0.0, 0.0)) for row in rows] for slug in slugs}


def _scored(batch: Sequence[HiddenCase]) -> list[NullValve]:
    return [_null(case) for case in batch]


def _null(case: HiddenCase) -> NullValve:
    recording = case.simulated().recording
    scores, effects = null_scores(recording), explain(recording).effects
    valve = case.loop.valve
    return NullValve(
        concealment=case.concealment,
        friction=LUGRE if valve.packing.presliding_percent > 0.0 else KARNOPP,
        scatter=valve.scatter,
        terms={slug: (mean, t) for slug, (mean, t, _) in scores.terms.items()},
        strongest=max((strength for _, _, strength in scores.terms.values()), default=0.0),
        pair=scores.pair,
        named=max((effect.evidence.strength for effect in effects), default=0.0),
        left=scores.left,
        noise=scores.noise,
        likelihood=scores.likelihood,
    )
