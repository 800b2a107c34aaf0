"""Scores of every term on simulated nulls (valves with nothing hidden), and limits from them.

A term is named where its advantage on held-out blocks has a mean and a t value above limits. At
most a given share of *valves* with nothing hidden may pass them with any term, so they rest on the
null distribution of the maximum over all terms.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from stemwatch.models.mismatch.explain import scores
from stemwatch.models.recording import Floats
from stemwatch.models.studies.simulator.hidden import HiddenCase, draw_nulls, simulate_hidden
from stemwatch.service.executors import Executor, map_items

QUANTILES = (0.5, 0.9, 0.95, 0.97, 0.99, 1.0)
_ROUNDING = 1e-9

# (mean, t) of each term on each null, in the same order for all terms.
Scores = dict[str, list[tuple[float, float]]]


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


BATCH = 4


def calibrate(
    cases: int, seed: int, executor: Executor, on_progress: Callable[[int], None]
) -> Scores:
    """(mean, t) of each term on each of ``cases`` nulls drawn with ``seed``.

    A term that a recording cannot test scores (0, 0) there. ``on_progress`` hears how many are
    done.
    """
    null_cases = draw_nulls(cases, seed)
    batches = [
        tuple(null_cases[first : first + BATCH]) for first in range(0, len(null_cases), BATCH)
    ]
    rows_of_batch: dict[int, list[Mapping[str, tuple[float, float]]]] = {}
    for index, rows in map_items(executor, _scored, batches):
        rows_of_batch[index] = rows
        on_progress(sum(map(len, rows_of_batch.values())))
    return _aligned([row for index in sorted(rows_of_batch) for row in rows_of_batch[index]])


def _aligned(rows: Sequence[Mapping[str, tuple[float, float]]]) -> Scores:
    slugs = sorted({slug for row in rows for slug in row})
    return {slug: [row.get(slug, (0.0, 0.0)) for row in rows] for slug in slugs}


def _scored(batch: Sequence[HiddenCase]) -> list[Mapping[str, tuple[float, float]]]:
    return [scores(simulate_hidden(case)[1].recording) for case in batch]
