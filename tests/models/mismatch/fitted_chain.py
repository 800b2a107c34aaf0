"""Recordings simulated by the fitted model chain, plus noise: the fit must recover their
parameters.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from stemwatch.models.mismatch.fit import base_coordinate
from stemwatch.models.mismatch.fit.base_fit import base_bounds, first_scatter
from stemwatch.models.mismatch.fit.evaluator import (
    CoordinateLayout,
    Evaluator,
    TermSet,
    make_evaluator,
)
from stemwatch.models.mismatch.measurement.record_effects import measured_record
from stemwatch.models.mismatch.prepared_recording import problem_of, summary_of
from stemwatch.models.mismatch.stem_model.kernel import Record, Scoring, follow
from stemwatch.models.mismatch.stem_model.stem import Tables
from stemwatch.models.mismatch.terms import catalogue
from stemwatch.models.recording import Floats, Recording, Role, Signal
from stemwatch.models.stickslip.evaluator import CANONICAL

NOISE = 0.05  # percent of span, one sigma
HALF_AN_HOUR = 1800


def recorded(op, mv=None, *, interval_s=1.0) -> Recording:
    """A recording in percent; NaN becomes a missing sample."""
    signals = {Role.OP: Signal.good(np.asarray(op, dtype=float), "V.OP")}
    if mv is not None:
        signals[Role.MV] = Signal.good(np.asarray(mv, dtype=float), "V.ZT")
    return Recording(valve="V", signals=signals, interval_s=interval_s)


@cache
def command(samples: int = HALF_AN_HOUR, seed: int = 1) -> Floats:
    """(samples,) steps, ramps of all speeds and holds over about 25 to 75 %; read only."""
    rng = np.random.default_rng(seed)
    knots, places = [0.0], [50.0]
    while knots[-1] < samples:
        over, held = rng.choice([1.0, 5.0, 12.0, 40.0]), rng.choice([4.0, 9.0, 16.0])
        place = float(np.clip(rng.normal(50.0, 10.0), 25.0, 75.0))
        knots += [knots[-1] + over, knots[-1] + over + held]
        places += [place, place]
    op = np.interp(np.arange(float(samples)), knots, places)
    op.flags.writeable = False
    return op


def hypothesis(*slugs: str) -> TermSet:
    """The base and the terms of the catalogue named."""
    created = TermSet()
    for slug in slugs:
        created = created.plus(catalogue()[slug])
    return created


def evaluator_of(recording: Recording, *, delta: float = 0.15) -> Evaluator:
    """The evaluator of a recording before any fit."""
    problem = problem_of(recording, measured_record(recording))
    summary = summary_of(problem, problem.interval_s)
    bounds = base_bounds(problem, summary)
    return make_evaluator(problem, summary, bounds, delta, CANONICAL, first_scatter(summary))


def candidate(layout: CoordinateLayout, S=4.0, J=1.2, base=None, **terms) -> Floats:
    """Coordinates of S and J in percent, other coordinates of the base, and those of terms."""
    result = np.zeros(layout.size)
    result[base_coordinate.S_PERCENT], result[base_coordinate.RATIO] = S, J / S
    for place, value in (base or {}).items():
        result[place] = value
    for slug, values in terms.items():
        result[layout.places[slug]] = values
    return result


def simulated_by_chain(
    S=4.0, J=1.2, *, noise=NOISE, samples=HALF_AN_HOUR, seed=1, base=None, **terms
):
    """The recording of a valve of S and J with ``base`` coordinates and the values of terms."""
    op = command(samples, seed)
    evaluator = evaluator_of(recorded(op, op))
    layout = evaluator.layout(hypothesis(*terms))
    mv = evaluator.simulate(layout, candidate(layout, S, J, base, **terms))
    return recorded(op, mv + noise * np.random.default_rng(seed + 100).standard_normal(op.size))


def rescaled(recording: Recording, mv: Floats) -> Recording:
    """The recording with another position."""
    signals = {**recording.signals, Role.MV: Signal.good(mv, "V.ZT")}
    return replace(recording, signals=signals)


def followed(stem, p, mv, marks, seen, window=0.0, scoring=None, blocks=1):
    """MV, ``early_late`` and losses of one stem over the force ``p``; ``seen`` are the samples at
    which it next lets go, up and down."""
    n = p.size
    record = Record(mv, marks, *seen, stem.interval_s, window)
    unscored = Scoring(np.full(n, -1), np.zeros(n), 1.0, 1.0, 1.0)
    tables = Tables(*(t[None] for t in (stem.friction, stem.force, stem.breakaway, stem.wander)))
    out, early_late = np.full((n, 1), np.nan), np.full((1, n), np.nan)
    losses = np.full((1, blocks), np.nan)
    follow(
        p[None],
        np.zeros(1, dtype=np.int64),
        stem.numbers[None],
        tables,
        record,
        scoring or unscored,
        losses,
        out,
        early_late,
    )
    # ``early_late`` must be 0 except where the stem was seen to break away.
    early_late[0, (seen[0] != np.arange(n)) & (seen[1] != np.arange(n))] = 0.0
    return out[:, 0], early_late[0], losses[0]
