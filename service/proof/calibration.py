"""What nothing hidden looks like: the scores of every term on simulated nulls.

A term is named where its advantage on blocks that it was not fitted to has a mean and a t-like
value above limits. The limits are to let through at most a given share of *valves* on which nothing
is hidden, whatever the term: they rest on the null distribution of the maximum over all terms.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from stemwatch.models.mismatch.explain import scores
from stemwatch.models.plant.hidden import HiddenCase, draw_nulls, simulate_hidden
from stemwatch.service.executors import Executor, map_items
from stemwatch.service.proof.nulls import Scores

BATCH = 4


def calibrate(cases: int, seed: int, executor: Executor, tell: Callable[[int], None]) -> Scores:
    """(mean, t) of each term on each of ``cases`` nulls drawn with ``seed``.

    A term that a recording cannot test scores (0, 0) there. ``tell`` hears how many are done.
    """
    drawn = draw_nulls(cases, seed)
    batches = [tuple(drawn[first : first + BATCH]) for first in range(0, len(drawn), BATCH)]
    done: dict[int, list[Mapping[str, tuple[float, float]]]] = {}
    for place, rows in map_items(executor, _scored, batches):
        done[place] = rows
        tell(sum(map(len, done.values())))
    return _aligned([row for place in sorted(done) for row in done[place]])


def _aligned(rows: Sequence[Mapping[str, tuple[float, float]]]) -> Scores:
    slugs = sorted({slug for row in rows for slug in row})
    return {slug: [row.get(slug, (0.0, 0.0)) for row in rows] for slug in slugs}


def _scored(batch: Sequence[HiddenCase]) -> list[Mapping[str, tuple[float, float]]]:
    return [scores(simulate_hidden(case)[1].recording) for case in batch]
