"""A motor drive: its lag, inertia and load are looked for together, from the force balance.

One by one they are not found: without the load a fit explains its pull as friction, and without the
lag it explains the lag as a dead band as wide as the swing. The force balance gives starting values
for all of them together; the common evaluator then decides on unseen blocks of time whether they
are needed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import product

import numpy as np

from stemwatch.models.mismatch.acceptance_limits import MEAN, convincing
from stemwatch.models.mismatch.fit import base_coordinate
from stemwatch.models.mismatch.fit.base_fit import BaseFit, breakaway_scatter, scale
from stemwatch.models.mismatch.fit.batched_search import Search, conclude
from stemwatch.models.mismatch.fit.crossfit import (
    CAREFUL,
    POLISH,
    Fitted,
    crossfit,
    gain,
    refit,
    scored,
)
from stemwatch.models.mismatch.fit.evaluator import (
    DRIVE,
    LOAD,
    CoordinateLayout,
    Evaluator,
    TermSet,
)
from stemwatch.models.mismatch.search.explaining_terms import AS_GOOD
from stemwatch.models.mismatch.search.named_terms import Named, Needed, SelectionStage, TermScore
from stemwatch.models.mismatch.search.reading_errors import pinned
from stemwatch.models.mismatch.search.term_scores import reduced
from stemwatch.models.mismatch.term import Term
from stemwatch.models.recording import Floats
from stemwatch.models.stickslip.force_balance import ForceBalance, balance_of_part
from stemwatch.models.stickslip.parameters import Bounds

TERMS = (DRIVE, LOAD)
NOT_RESOLVED = (
    "the samples do not resolve how the stem gathers speed, as those of a motor drive that is "
    "recorded many times while it moves"
)
NEAR, LEAST_NEAR = 0.1, 0.03  # of S, percent
RUN_UP = 1  # among the coordinates of the drive
# Of the run-up, and of a sample: a delay of a sample or two can take the place of all of it.
LEAST_OF_RUN_UP = 0.5
RATIOS = (0.0, 0.4)  # J/S
DELAYS = (0.0, 2.0, 4.0)  # samples
# Mean log ratio of the losses on unseen blocks, and its t, by which other physics refutes a drive:
# three valves whose position was stored 5 s late have 1.2, 2.0 and 2.0 (t 11 and more), recordings
# of a servo drive at most 0.55 (t 2.4).
REFUTED_MEAN, REFUTED_T = 0.8, 4.0
# Times the fastest motion that was seen, where the balance knows of no limit of the voltage.
TOP_SPEEDS = (1.0, 1.15, np.inf)
NEAR_LIMIT = (0.95, 1.0, 1.05)  # times the limit that it knows


def name_drive(base: BaseFit, balance: ForceBalance, terms: Mapping[str, Term]) -> Named | None:
    """What the drive needs beyond S and J; ``None`` where lag and inertia are not needed.

    ``terms`` are those that the recording can show. The load stays in the fit where it is too small
    to be named: else the reading's gain would take its place.
    """
    hypothesis = TermSet()
    for slug in TERMS:
        hypothesis = hypothesis.plus(terms[slug])
    evaluator, fitted = _fitted(base, balance, hypothesis)
    # The force balance has shown inertia; the unseen blocks must show that the drive as a whole is
    # needed. Without the motor the fit makes up for much of it by a wide dead band.
    drive_alone = conclude(evaluator, _fit_drive_alone(evaluator, base))
    explains_all = convincing(
        gain(evaluator, drive_alone, fitted), evaluator.measured_counts, DRIVE
    )
    needed = []
    for term in hypothesis.terms:
        without_drive = conclude(evaluator, _fit_without(evaluator, fitted, term))
        score = TermScore(term, fitted, gain(evaluator, without_drive, fitted))
        still_needed = (
            explains_all and score.advantage.mean >= MEAN and score.advantage.t >= AS_GOOD
            if term.slug == DRIVE
            else convincing(score.advantage, evaluator.measured_counts, term.slug)
        )
        if still_needed and term.material(score.values, evaluator.summary):
            stage = SelectionStage(without_drive, (score,), (score,))
            needed.append(Needed(stage, without_drive, score.advantage))
    if DRIVE not in {needed_term.term.slug for needed_term in needed}:
        return None
    stages = tuple(needed_term.stage for needed_term in needed)
    return Named(
        evaluator=evaluator, base=base.fitted, fitted=fitted, needed=tuple(needed), stages=stages
    )


def of_the_valve(terms: Mapping[str, Term]) -> list[Term]:
    """The terms that are looked for one by one: no drive's, and none of the base's own."""
    return [term for slug, term in terms.items() if slug not in TERMS and not term.in_base]


def is_refuted(drive: Named, term_by_term: Named) -> bool:
    """Whether what was found term by term predicts the unseen blocks so much better that no drive
    moves this stem.

    A position that is stored some seconds late in even steps looks as if a motor moved it, without
    any friction; a dead time and friction then predict it much better.
    """
    as_drive = drive.fitted
    followed = conclude(term_by_term.evaluator, scored(as_drive.layout, as_drive.candidates))
    advantage = gain(term_by_term.evaluator, followed, term_by_term.fitted)
    return advantage.mean >= REFUTED_MEAN and advantage.t >= REFUTED_T


def _fitted(base: BaseFit, balance: ForceBalance, hypothesis: TermSet) -> tuple[Evaluator, Fitted]:
    """The drive fitted to both folds, by a loss on the scale of what it leaves."""
    # Runs are free: where the motion is resolved, breakaways are not the most informative samples.
    evaluator = replace(base.evaluator, window=0.0, _layouts={})
    layout = _near_balance(evaluator.layout(hypothesis), balance, evaluator.problem.interval_s)
    starts = _starts(evaluator, layout, balance)
    fitted = conclude(evaluator, crossfit(evaluator, layout, starts, CAREFUL))
    middle = fitted.candidates.mean(axis=0)
    simulated, early_late = evaluator.assimilated(layout, middle)
    S = float(middle[base_coordinate.S_PERCENT])
    level = 0.5 * S * (1.0 + float(middle[base_coordinate.RATIO]))
    evaluator = replace(
        evaluator,
        delta=scale(evaluator, simulated),
        scatter=breakaway_scatter(early_late, level, evaluator.problem.sigma),
        summary=replace(evaluator.summary, S=S, J=S * float(middle[base_coordinate.RATIO])),
        _layouts={},
    )
    layout = _near_balance(evaluator.layout(hypothesis), balance, evaluator.problem.interval_s)
    fitted = conclude(evaluator, scored(layout, fitted.candidates))
    fitted = conclude(evaluator, refit(evaluator, fitted, CAREFUL))
    return evaluator, conclude(evaluator, refit(evaluator, fitted, POLISH))


def _near_balance(
    layout: CoordinateLayout, balance: ForceBalance, sample: float
) -> CoordinateLayout:
    """``layout`` with S and run-up held near those of the force balance, to which every moving
    sample contributes; in a free run only the few samples near a turn of the stem do.
    """
    low, high = layout.bounds.low.copy(), layout.bounds.high.copy()
    low[base_coordinate.S_PERCENT] = max((1.0 - NEAR) * balance.S - LEAST_NEAR, 0.0)
    high[base_coordinate.S_PERCENT] = (1.0 + NEAR) * balance.S + LEAST_NEAR
    high[base_coordinate.RATIO] = 1.0
    low[layout.places[DRIVE]][RUN_UP] = LEAST_OF_RUN_UP * min(balance.run_up_s, sample)
    return replace(layout, bounds=Bounds(low, high))


def _starts(evaluator: Evaluator, layout: CoordinateLayout, balance: ForceBalance) -> Floats:
    """(m, size) starts at the numbers of the force balance, with and without jump, delay and top
    speed.
    """
    dt = evaluator.problem.interval_s
    rows = []
    top_speeds = [times * balance.top_speed for times in TOP_SPEEDS]
    if np.isfinite(balance.most_error):
        top_speeds = [times * balance.most_error / balance.lag_s for times in NEAR_LIMIT]
    for ratio, delay, top in product(RATIOS, DELAYS, top_speeds):
        row = np.zeros(layout.size)
        row[base_coordinate.S_PERCENT], row[base_coordinate.RATIO] = balance.S, ratio
        row[base_coordinate.ZERO], row[base_coordinate.DELAY] = balance.zero, delay * dt
        lag_s = max(balance.lag_s - delay * dt, 0.3 * balance.lag_s)
        row[layout.places[DRIVE]] = lag_s, balance.run_up_s, 1.0 / top
        row[layout.places[LOAD]] = balance.load
        rows.append(row)
    return layout.bounds.clip(np.array(rows))


def starts_of_first_part(evaluator: Evaluator, layout: CoordinateLayout) -> Floats | None:
    """(m, size) starts of a drive's fit to the first part, computed from that part alone; ``None``
    for a hypothesis without a drive, or where the stem hardly moves in that part.
    """
    if DRIVE not in layout.places:
        return None
    problem = evaluator.problem
    early = evaluator.within(problem.training_blocks())
    balance = balance_of_part(replace(problem, block=early))
    return None if balance is None else _starts(evaluator, layout, balance)


def _fit_drive_alone(evaluator: Evaluator, base: BaseFit) -> Search[Fitted]:
    """S, J and the reading alone, by the loss on the scale of what the drive leaves."""
    layout = evaluator.layout(TermSet())
    start = yield from scored(layout, base.fitted.candidates)
    drive_alone = yield from refit(evaluator, start, CAREFUL)
    return drive_alone


def _fit_without(evaluator: Evaluator, fitted: Fitted, term: Term) -> Search[Fitted]:
    """The best fit that lacks ``term``, from the richer one."""
    lacking = fitted.layout.hypothesis.without(term.slug)
    layout = evaluator.layout(lacking)
    if term.slug == LOAD:  # of which a span error would be the straight part
        layout = pinned(layout, base_coordinate.GAIN, 0.0)
    start = yield from scored(layout, layout.bounds.clip(reduced(evaluator, fitted, lacking)))
    without_drive = yield from refit(evaluator, start, CAREFUL)
    return without_drive
