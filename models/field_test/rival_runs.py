"""Runs of rival models over a programme of OP, and the cost of each on a recorded response.

A model is run freely to predict a response. To judge a response the model is refitted to it, within
the uncertainty that the recording left in its parameters, by the loss with which it was named:
breakaways are assimilated and charged for their distance from the level (see
``mismatch.fit.evaluator``).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from stemwatch.models.estimate import Estimate
from stemwatch.models.field_advice import FieldAdvice, FieldTest
from stemwatch.models.mismatch.fit import base_coordinate
from stemwatch.models.mismatch.fit.base_fit import base_bounds
from stemwatch.models.mismatch.fit.batched_search import conclude
from stemwatch.models.mismatch.fit.evaluator import (
    CoordinateLayout,
    Evaluator,
    TermSet,
    make_evaluator,
)
from stemwatch.models.mismatch.fit.least_squares import descend
from stemwatch.models.mismatch.open_question import SLOW, OpenQuestion, RivalModel
from stemwatch.models.mismatch.stem_model import stem as stem_number
from stemwatch.models.mismatch.stem_model.stem import Stem
from stemwatch.models.mismatch.term import Coordinate, RecordingSummary, Words
from stemwatch.models.mismatch.terms import catalogue
from stemwatch.models.mismatch.terms._common import StemTerm
from stemwatch.models.recording import Floats
from stemwatch.models.stickslip.kernel import START
from stemwatch.models.stickslip.parameters import Bounds
from stemwatch.models.stickslip.problem import FitProblem

ROUNDS = 4  # of descent when a model is fitted to a response
LEAST_DELTA = 0.05  # percent
# twice the cost of one more coordinate: ln(20), as if 20 samples determined it
LOGARITHM_OF_SAMPLES = 3.0
# Least uncertainty of a fitted parameter, either way: as a share, and for the base in percent.
OPEN_SHARE = 0.1
OPEN_BASE = np.array([0.0, 0.05, 0.2, 0.01, 0.0, 0.0])
NO_ADVICE = FieldAdvice(title="", steps=(), parts=(), damage="", cause="", part="")
SCATTER_HOLD_S = 10.0  # of rest, for which one breakaway level is drawn


class BreakawayScatter(StemTerm):
    """Not a physical effect: draws the level of each breakaway anew, by how long the stem has
    rested.

    One coordinate, the number of the draw. ``percent`` is the standard deviation of the level.
    """

    slug = "breakaway_scatter"
    order = 99
    words = Words(plain="", decide="", advice=NO_ADVICE)

    def __init__(self, percent: float) -> None:
        self.percent = percent

    def coordinates(self, summary: RecordingSummary) -> tuple[Coordinate, ...]:
        """The number of the draw, which seeds its breakaway levels."""
        return (Coordinate(name="draw", low=0.0, high=1e6),)

    def starts(self, summary: RecordingSummary) -> Floats:
        """The draw of levels number 0; a simulation takes another, and none is searched for."""
        return np.zeros((1, 1))

    def fill(self, stem: Stem, values: Floats) -> None:
        """Draw another level for each ten seconds of rest."""
        size = stem.breakaway.size
        hold = max(round(SCATTER_HOLD_S / stem.interval_s), 1)
        rng = np.random.default_rng([41, int(values[0])])
        levels = np.clip(rng.standard_normal(size // hold + 1), -2.5, 2.5) * self.percent
        stem.breakaway += np.repeat(levels, hold)[:size]
        stem.numbers[stem_number.BY_REST] = 1.0

    def material(self, values: Floats, summary: RecordingSummary) -> bool:
        """Never: scatter belongs to simulated responses and is no effect to be named."""
        return False

    def parameters(self, values: Floats) -> Mapping[str, tuple[float, str]]:
        return {}

    def sentence(self, parameters: Mapping[str, Estimate], rising: str, falling: str) -> str:
        return ""

    def field_test(self, parameters: Mapping[str, Estimate]) -> FieldTest:
        return FieldTest(do="", fails="", passes="")


@dataclass(frozen=True, kw_only=True)
class RivalFit:
    """One rival fitted to a response.

    ``cost``: half the robust loss in variances of the noise plus the cost of its coordinates, as a
    negative log likelihood. ``followed`` (n,) MV in percent by its free run.
    """

    cost: float
    followed: Floats


@dataclass(frozen=True)
class RivalRuns:
    """The rival models of ``question`` over the commands ``travel`` (n,), percent of travel, every
    ``interval`` units of the own clock."""

    question: OpenQuestion
    models: tuple[RivalModel, ...]
    travel: Floats
    interval: float

    @cached_property
    def free(self) -> Evaluator:
        """Runs from rest, with nothing measured."""
        return replace(self._evaluator(self.travel), window=0.0, _layouts={})

    def _evaluator(self, mv: Floats) -> Evaluator:
        question, n = self.question, self.travel.size
        start = np.zeros(n, dtype=np.uint8)
        start[0] = START
        low, high = float(self.travel.min()), float(self.travel.max())
        problem = FitProblem(
            op=self.travel,
            mv=np.ascontiguousarray(mv),
            start=start,
            block=np.zeros(n, dtype=np.int64),
            n_blocks=1,
            interval_s=self.interval,
            sigma=question.sigma,
            swing=high - low,
            mv_is_percent=True,
            unit_s=question.unit_s,
        )
        summary = RecordingSummary(
            interval_s=self.interval,
            duration_s=n * self.interval,
            unit_s=question.unit_s,
            op_low=low,
            op_high=high,
            mv_low=low,
            mv_high=high,
            sigma=question.sigma,
            S=0.0,
            J=0.0,
        )
        return make_evaluator(
            problem,
            summary,
            base_bounds(problem, summary),
            # No model fits a valve more closely than its breakaways repeat.
            max(3.0 * question.sigma, question.scatter, LEAST_DELTA),
            question.restick,
            max(question.scatter, 0.03),
        )

    def layout(self, evaluator: Evaluator, model: RivalModel) -> CoordinateLayout:
        """The coordinates of ``model``, bounded by the uncertainty that the recording left."""
        terms_by_slug = catalogue()
        hypothesis = TermSet()
        for slug in model.terms:
            hypothesis = hypothesis.plus(terms_by_slug[slug])
        layout = evaluator.layout(hypothesis)
        middle, width = self._middle_and_half(layout, model)
        low, high = middle - width, middle + width
        # Levels and sizes keep their sign, however uncertain they are.
        low[base_coordinate.S_PERCENT] = max(low[base_coordinate.S_PERCENT], 0.0)
        low[base_coordinate.RATIO] = max(low[base_coordinate.RATIO], 0.0)
        return replace(layout, bounds=Bounds(low, high))

    def _middle_and_half(
        self, layout: CoordinateLayout, model: RivalModel
    ) -> tuple[Floats, Floats]:
        """(size,) middle and half width of the uncertain range of each coordinate."""
        halves = np.empty((2, layout.size))
        halves[:, : base_coordinate.N_BASE] = np.array(model.base)
        share = self.travel.size * self.interval / max(self.question.duration, 1e-9)
        for slug, coordinate_slice in layout.places.items():
            halves[:, coordinate_slice] = np.array(model.terms[slug]) * (
                share if slug in SLOW else 1.0
            )
        middle = halves.mean(axis=0)
        width = np.abs(halves[0] - halves[1])
        width = np.maximum(width, OPEN_SHARE * np.abs(middle))
        width[: base_coordinate.N_BASE] = np.maximum(width[: base_coordinate.N_BASE], OPEN_BASE)
        width[base_coordinate.RESTICK] = 0.0
        return middle, width

    def predicted(self, model: RivalModel) -> Floats:
        """(n,) MV in percent predicted by ``model`` with its own parameters."""
        return np.asarray(self.predicted_each([model])[0])

    def predicted_each(self, models: Sequence[RivalModel]) -> Floats:
        """(m, n) what each of ``models`` predicts."""
        layouts = [self.layout(self.free, model) for model in models]
        middles = [0.5 * (layout.bounds.low + layout.bounds.high) for layout in layouts]
        return self.free.simulate_each(list(zip(layouts, middles, strict=True)))

    def draw_response(self, model: RivalModel, rng: np.random.Generator) -> Floats:
        """(n,) a response drawn from ``model``: parameters within their uncertainty, scattering
        breakaways, noise.
        """
        start_layout = self.layout(self.free, model)
        scatter = BreakawayScatter(self.question.scatter)
        layout = self.free.layout(start_layout.hypothesis.plus(scatter))
        middle = 0.5 * (start_layout.bounds.low + start_layout.bounds.high)
        half = 0.5 * (start_layout.bounds.high - start_layout.bounds.low)
        drawn = start_layout.bounds.clip(middle + 0.5 * half * rng.standard_normal(middle.size))
        candidate = np.zeros(layout.size)
        candidate[: base_coordinate.N_BASE] = drawn[: base_coordinate.N_BASE]
        for slug, coordinate_slice in start_layout.places.items():
            candidate[layout.places[slug]] = drawn[coordinate_slice]
        candidate[layout.places[scatter.slug]] = float(rng.integers(1_000_000))
        noise = self.question.sigma * rng.standard_normal(self.travel.size)
        return np.asarray(self.free.simulate(layout, candidate) + noise)

    def coordinates_cost(self, model: RivalModel) -> float:
        """The cost of a model's coordinates, as a negative log likelihood."""
        layout = self.layout(self.free, model)
        return 0.5 * LOGARITHM_OF_SAMPLES * (layout.size - base_coordinate.N_BASE)

    def costs(self, answer: Floats) -> Floats:
        """(m,) the cost of each model on ``answer`` (n,), see ``RivalFit``."""
        evaluator = self._evaluator(answer)
        return np.array([self._fit(evaluator, model)[1] for model in self.models])

    def fit(self, model: RivalModel, answer: Floats) -> RivalFit:
        """``model`` fitted to ``answer`` (n,)."""
        evaluator = self._evaluator(answer)
        candidate, cost = self._fit(evaluator, model)
        layout = self.layout(evaluator, model)
        return RivalFit(cost=cost, followed=evaluator.simulate(layout, candidate))

    def _fit(self, evaluator: Evaluator, model: RivalModel) -> tuple[Floats, float]:
        layout = self.layout(evaluator, model)
        middle = 0.5 * (layout.bounds.low + layout.bounds.high)
        all_blocks = np.ones(1, dtype=bool)
        fit = conclude(evaluator, descend(evaluator, layout, all_blocks, middle, ROUNDS))
        scale = (evaluator.delta / 3.0) ** 2
        cost = fit.loss * self.travel.size / (2.0 * scale) + self.coordinates_cost(model)
        return fit.candidate, cost
