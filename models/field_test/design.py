"""``design``: the programme of OP that discriminates best between rival models, and its probability
of success.

T-optimal (Atkinson and Fedorov 1975, doi:10.1093/biomet/62.1.57): of each ordered pair of rivals
one generates the response and the other is refitted to it; the loss that remains is the pair's
gain, a log likelihood ratio. The pair with the least gain decides. Moves are added one by one, each
time the one that raises this gain most, while there is time. For the programme found, responses are
drawn from every rival with noise, scattering breakaways and uncertain parameters, and the
probability is the share of them that the generating rival fits best.
"""

from __future__ import annotations

from collections.abc import Container, Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np

from stemwatch.models.field_test.programme import (
    Move,
    MoveKind,
    Programme,
    TestLimits,
    possible_moves,
)
from stemwatch.models.field_test.rival_runs import RivalRuns
from stemwatch.models.mismatch.open_question import OpenQuestion, RivalModel
from stemwatch.models.recording import Floats

MOST_MOVES = 6
BEST_SINGLE_MOVES = 8  # the best single moves, which are tried as further ones
REPLICATES = 20  # responses drawn from each rival
MOST_SAMPLES = 2400  # of a programme; more are thinned


@dataclass(frozen=True, kw_only=True)
class DesignedTest:
    """A programme, the predicted responses of the rivals, and how probably it discriminates between
    them.

    ``predicted`` (m, n) MV in percent every ``interval_s`` seconds, about ``change`` (n,) of OP.
    ``gains`` (m, m): the loss of rival ``j`` fitted to the response of ``i``. ``wins`` (m, m): the
    share of the responses of ``i`` that ``j`` fits best. ``upset`` is the largest change of PV that
    any rival predicts, ``None`` where the gain of PV is not known.
    """

    programme: Programme
    models: tuple[RivalModel, ...]
    interval_s: float
    change: Floats
    predicted: Floats
    gains: Floats
    wins: Floats
    upset: float | None

    @property
    def probability(self) -> float:
        """The probability that the right rival wins, with all rivals equally likely, 0 to 1."""
        return min(float(np.mean(np.diag(self.wins))), 1.0)  # shares of tenths may sum beyond 1

    def pair_probability(self, i: int, j: int) -> float:
        """The probability that the right one of two rivals wins."""
        won = self.wins
        first = won[i, i] / max(won[i, i] + won[i, j], 1e-9)
        second = won[j, j] / max(won[j, j] + won[j, i], 1e-9)
        return float(0.5 * (first + second))


def _worst(gains: Floats) -> float:
    off_diagonal = gains[~np.eye(gains.shape[0], dtype=bool)]
    return float(off_diagonal.min()) if off_diagonal.size else 0.0


@dataclass(frozen=True)
class _TestSite:
    """The operating point and the clock of the test."""

    question: OpenQuestion
    models: tuple[RivalModel, ...]
    limits: TestLimits
    op: float

    @property
    def interval_s(self) -> float:
        interval_s = self.question.interval * self.question.unit_s
        return max(interval_s, self.limits.duration_s / MOST_SAMPLES)

    def runs(self, programme: Programme) -> RivalRuns:
        op = self.op + programme.changes(self.interval_s)
        curve = self.question.curve
        travel = op if curve is None else curve.command(op)
        interval_units = self.interval_s / self.question.unit_s
        return RivalRuns(self.question, self.models, np.ascontiguousarray(travel), interval_units)

    def gains(self, runs: RivalRuns, predicted: Floats) -> Floats:
        """(m, m) the loss of each model on the response of each other."""
        costs = np.array([runs.costs(answer) for answer in predicted])
        coordinates_cost = np.array([runs.coordinates_cost(model) for model in self.models])
        cost_differences = costs - coordinates_cost
        return np.asarray(np.maximum(cost_differences - np.diag(cost_differences)[:, None], 0.0))

    def upset(self, predicted: Floats) -> float | None:
        """The largest change of PV that any of the models predicts."""
        process = self.question.process
        if process is None:
            return None
        moved = [process.upset(answer, self.interval_s) for answer in predicted]
        known_upsets = [value for value in moved if value is not None]
        return max(known_upsets) if known_upsets else None


def allowed_upset(question: OpenQuestion, limits: TestLimits) -> float | None:
    """The largest change of PV that is allowed: the limit, else as far as PV moved either way in
    the recording; ``None`` where neither is known."""
    if limits.pv_upset is not None:
        return limits.pv_upset
    usual_range = None if question.process is None else question.process.usual_range
    return None if usual_range is None or usual_range <= 0.0 else usual_range


def design(
    question: OpenQuestion,
    models: tuple[RivalModel, ...],
    limits: TestLimits,
    op: float,
    kinds: Container[MoveKind] = tuple(MoveKind),
) -> DesignedTest | None:
    """The best programme from ``op`` (percent) within ``limits``, of moves of ``kinds``; ``None``
    where no move fits."""
    site = _TestSite(question, models, limits, op)
    down, up = limits.room(op)
    moves = possible_moves(down, up, limits.duration_s, site.interval_s)
    single_moves = [_scored(site, Programme().plus(move)) for move in moves if move.kind in kinds]
    fitting = sorted(
        (candidate for candidate in single_moves if candidate is not None),
        key=lambda candidate: candidate.sort_key,
    )
    if not fitting:
        return None
    best, first = (
        fitting[0],
        [candidate.programme.moves[0] for candidate in fitting[:BEST_SINGLE_MOVES]],
    )
    while len(best.programme.moves) < MOST_MOVES:
        longer = [
            candidate for candidate in _longer(site, best.programme, first) if candidate is not None
        ]
        richer = min(longer, key=lambda candidate: candidate.sort_key, default=None)
        if richer is None or richer.sort_key >= best.sort_key:
            break
        best = richer
    return _with_probabilities(site, best)


@dataclass(frozen=True)
class _ScoredProgramme:
    """A programme with the gains of its pairs."""

    programme: Programme
    predicted: Floats
    gains: Floats
    upset: float | None

    @property
    def worst(self) -> float:
        return _worst(self.gains)

    @property
    def sort_key(self) -> tuple[float, float]:
        """Sort key of programmes: the worst pair decides, the others count a little, and of equal
        ones the shortest is the best.
        """
        separation = _worst(self.gains) + 0.05 * float(self.gains.mean())
        return -round(separation, 2), self.programme.duration_s


def _scored(site: _TestSite, programme: Programme) -> _ScoredProgramme | None:
    """The programme with its gains; ``None`` where it upsets PV more than is allowed."""
    runs = site.runs(programme)
    predicted = runs.predicted_each(site.models)
    upset, allowed = site.upset(predicted), allowed_upset(site.question, site.limits)
    if upset is not None and allowed is not None and upset > allowed:
        return None
    return _ScoredProgramme(programme, predicted, site.gains(runs, predicted), upset)


def _longer(
    site: _TestSite, programme: Programme, moves: list[Move]
) -> Iterator[_ScoredProgramme | None]:
    """``programme`` and one more of ``moves``, where time is left for it.

    Each move is used once: no model is exact, and a move that discriminates by a model error would
    do so again.
    """
    for move in moves:
        if move in programme.moves:
            continue
        longer = programme.plus(move)
        if longer.duration_s <= site.limits.duration_s + 1e-9:
            yield _scored(site, longer)


def _with_probabilities(site: _TestSite, best: _ScoredProgramme) -> DesignedTest:
    runs = site.runs(best.programme)
    rng = np.random.default_rng(1975)
    wins = np.zeros((len(site.models),) * 2)
    for (i, model), _ in product(enumerate(site.models), range(REPLICATES)):
        wins[i, int(np.argmin(runs.costs(runs.draw_response(model, rng))))] += 1.0 / REPLICATES
    return DesignedTest(
        programme=best.programme,
        models=site.models,
        interval_s=site.interval_s,
        change=best.programme.changes(site.interval_s),
        predicted=best.predicted,
        gains=best.gains,
        wins=wins,
        upset=best.upset,
    )
