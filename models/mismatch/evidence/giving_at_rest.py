"""Whether the stem gives way to its command while it rests, as told before any search.

Within a rest of the fitted stem the force on it, ``f = OP - x``, would move a packing that gives
by ``c W``, ``W`` the way of LuGre's bristles (``stem_model.presliding``, doi:10.1109/9.376053)
added up over the changes of the force. ``c`` is the slope of the reading on ``W``, each rest about
its own means; its error is that of the rests, taken as independent:

    c = sum_i (W_i . y_i) / sum_i (W_i . W_i),   se^2 = sum_i (W_i . y_i - c W_i . W_i)^2 / (...)^2.

Of each rest the longest piece without a jump of the reading counts, up to where the force comes
near the breakaway level: a slip a little before or after the simulated one is not to look like
giving way.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.mismatch.evidence.conditioning import moving_stem, rests
from stemwatch.models.mismatch.stem_model.lanes import never_raises
from stemwatch.models.mismatch.stem_model.presliding import way_of_bristles
from stemwatch.models.recording import Bools, Floats

PRESLIDING = "presliding"

LEAST_RESTS = 3
LEAST_T = 2.5
_SETTLED = 3  # samples after a slip
_LONG = 8  # samples of a piece
_NEAR_LEVEL = 0.95  # share of the breakaway level
# A jump of the reading over two samples: of its noise, and of J (percent) where that is known.
_JUMP_SIGMA, _JUMP_SHARE, _MOST_J = 5.0, 0.25, 4.0


class GivingAtRest(NamedTuple):
    """``c`` in percent of travel for a percent of force, its ``t``, and the rests that told."""

    c: float
    t: float
    rests: int

    @property
    def shows(self) -> bool:
        """Whether the stem seems to give way; the fit decides."""
        return self.rests >= LEAST_RESTS and self.t >= LEAST_T


@never_raises
def _piece(
    force: Floats, mv: Floats, scored: Bools, span: tuple[int, int], level: float, jump: float
) -> tuple[int, int]:
    """The longest piece of a rest without a jump or a gap, before the force comes near the level;
    empty where the rest has none."""
    first = last = begin = span[0] + _SETTLED
    for k in range(begin, span[1]):
        near, gap = abs(force[k]) > _NEAR_LEVEL * level, not scored[k]
        if near or gap or abs(mv[k] - mv[k - 2]) > jump:
            begin = k + 1
        elif k + 1 - begin > last - first:
            first, last = begin, k + 1
        if near:
            break
    return first, last


@never_raises
def _products(
    force: Floats,
    mv: Floats,
    scored: Bools,
    spans: NDArray[np.int64],
    level: float,
    jump: float,
) -> Floats:
    """(m, 2) ``W . y`` and ``W . W`` of the pieces of rests ``spans`` (m, 2), zero where a rest has
    no piece."""
    products = np.zeros((spans.shape[0], 2))
    for row in range(spans.shape[0]):
        first, last = _piece(force, mv, scored, (spans[row, 0], spans[row, 1]), level, jump)
        n = last - first
        if n < _LONG:
            continue
        way = np.zeros(n)
        for i in range(1, n):
            k = first + i
            side = 1.0 if force[k] > force[k - 1] else -1.0
            way[i] = way[i - 1] + side * way_of_bristles(force[k - 1], force[k], level, 1.0)
        y = mv[first:last] - np.mean(mv[first:last])
        way -= np.mean(way)
        products[row, 0], products[row, 1] = np.sum(way * y), np.sum(way * way)
    return products


def giving_at_rest(
    op: Floats,
    mv: Floats,
    simulated: Floats,
    scored: Bools,
    interval_s: float,
    sigma: float,
    S: float,
    J: float,
) -> GivingAtRest:
    """Read ``c`` from the rests of the base fit ``simulated``; all arrays (n,), finite, percent;
    ``sigma`` is the noise of ``mv``, S and J are those of the base fit."""
    ends, lengths = rests(moving_stem(simulated, interval_s))
    spans = np.column_stack((ends - lengths, ends))
    jump = max(_JUMP_SIGMA * sigma, _JUMP_SHARE * min(J, _MOST_J))
    level = 0.5 * (S + J)
    products = _products(op - simulated, mv, scored, spans, level, jump)
    told, total = products[products[:, 1] > 0.0], float(products[:, 1].sum())
    if total == 0.0:
        return GivingAtRest(0.0, 0.0, 0)
    c = float(told[:, 0].sum()) / total
    error = float(np.linalg.norm(told[:, 0] - c * told[:, 1])) / total
    return GivingAtRest(c, c / error if error > 0.0 else 0.0, len(told))
