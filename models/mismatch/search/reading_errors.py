"""Errors of the position reading (zero, span, drift), which every hypothesis has; a finding only
where they are material.

A zero error, a span error and a stem that sticks again at speed are fitted along with everything.
Each is a finding where the hypothesis is clearly worse on unseen blocks of time without it.
Sticking again at low speed is named alone only where sticking again at every speed, because slips
overshoot, fits worse; else the record does not tell the two apart.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from stemwatch.models.mismatch.acceptance_limits import NEAR, convincing, strength
from stemwatch.models.mismatch.fit import base_coordinate
from stemwatch.models.mismatch.fit.base_coordinate import S_and_J
from stemwatch.models.mismatch.fit.base_fit import RESTICK_REACH
from stemwatch.models.mismatch.fit.batched_search import conclude
from stemwatch.models.mismatch.fit.crossfit import CAREFUL, Fitted, gain, refit, scored
from stemwatch.models.mismatch.fit.evaluator import CoordinateLayout, Evaluator
from stemwatch.models.mismatch.search.explaining_terms import AS_GOOD
from stemwatch.models.mismatch.search.named_terms import TermScore
from stemwatch.models.mismatch.search.reading_rivals import (
    BOW,
    SAG,
    SPAN,
    WHAT_TELLS,
    ZERO,
    bent_instead,
    leans,
    sags_instead,
    slips_instead,
)
from stemwatch.models.mismatch.term import Term
from stemwatch.models.mismatch.terms._common import CALIBRATE_FROM_PERCENT
from stemwatch.models.mismatch.terms.flow_force import OWN_SLOPE
from stemwatch.models.mismatch.terms.sensor_drift import course
from stemwatch.models.recording import Floats
from stemwatch.models.stickslip.advantage import Advantage
from stemwatch.models.stickslip.parameters import Bounds

# Coordinate of each, and the largest value that is not material.
COORDINATES = {
    SPAN: (base_coordinate.GAIN, 0.0),
    ZERO: (base_coordinate.ZERO, 0.0),
    "low_speed_restick": (base_coordinate.RESTICK, 0.12),
}
# %/s, from which a stem that sticks again is compared with one that does at every speed: where it
# does, the speed up to which it was fitted says little.
LEAST_RESTICK = 0.15
RESTICK, OVERSHOOT = "low_speed_restick", "slip_overshoot"
STICKS_AGAIN = (RESTICK, OVERSHOOT)
DRIFT, FLOW, UNEVEN = "sensor_drift", "flow_force", "asymmetric_slip"
LEAST_ZERO = 0.4  # percent, at every time of a drift
TELLS_FRICTION = (
    "Slips of one direction may be larger than those of the other, and friction that is larger one "
    "way shifts the stem as well; a reading at a stop tells which."
)
HALF_STROKE = 50.0  # percent of travel from the middle, where the zero is counted, to either end
# A zero error, in shares of U, that a flow force has as its mean: one that is none at the ends of
# travel moves the stem by U at mid-travel. It is off by as much as its shape is another than the
# term's: of four simulated ones, 1.03 to 1.18.
OWN_MEAN = 1.25


@dataclass(frozen=True)
class ReadingError:
    """A material error of the reading; ``beside`` are the slugs that the record cannot separate
    from it.
    """

    term: Term
    advantage: Advantage
    without: Fitted  # the hypothesis with the number held at neutral
    beside: tuple[str, ...] = ()
    tells: str = ""  # what would tell it from these, a sentence

    @property
    def members(self) -> tuple[str, ...]:
        """The slugs that explain it as well, its own first."""
        return (self.term.slug, *self.beside)


def pinned(layout: CoordinateLayout, coordinate: int, largest: float) -> CoordinateLayout:
    """``layout`` with one base coordinate held at neutral, or below ``largest``."""
    low, high = layout.bounds.low.copy(), layout.bounds.high.copy()
    low[coordinate], high[coordinate] = 0.0, min(largest, float(high[coordinate]))
    return replace(layout, bounds=Bounds(low, high))


def values_of(slug: str, candidate: Floats) -> Floats:
    """(1,) the coordinate of a reading's term in a candidate."""
    if slug == OVERSHOOT:
        return np.array([RESTICK_REACH])
    return np.asarray(candidate[[COORDINATES[slug][0]]])


def findings(
    evaluator: Evaluator,
    fitted: Fitted,
    terms: dict[str, Term],
    shown: Collection[str] = (),
    more: Collection[TermScore] = (),
) -> tuple[list[ReadingError], Fitted]:
    """The material errors, and ``fitted`` with the gain held at 1 where that is not a finding;
    those ``shown`` by something else need not be shown by the residual. ``more`` are the scores of
    the terms on top of ``fitted``, none of which is named.

    The gain goes first: away from mid-travel, a gain that noise has bent looks like a zero error.
    """
    offs: list[ReadingError] = []
    leaning = None if BOW in fitted.layout.places or FLOW in fitted.layout.places else fitted
    for slug, (coordinate, largest) in COORDINATES.items():
        if slug not in terms or (slug == ZERO and _explained(fitted, offs)):
            continue
        if slug == SPAN and BOW in fitted.layout.places:
            continue  # how much of the slope belongs to the bow cannot be told
        reading_error = _dropped(evaluator, fitted, terms[slug], coordinate, largest, slug in shown)
        if reading_error is not None and slug == SPAN and _leans_with_force(fitted):
            continue
        if reading_error is not None:
            at_every_speed = _at_every_speed(evaluator, fitted, reading_error, terms)
            if _is_material(evaluator, fitted, at_every_speed.term):
                bent = _or_bent(evaluator, fitted, at_every_speed, terms)
                sagging = _or_sagging(evaluator, fitted, bent, terms)
                leaning_too = _or_leaning(evaluator, fitted, leaning, sagging)
                offs.append(_or_uneven(evaluator, fitted, leaning_too, terms, more))
        elif slug == SPAN:
            fitted = without_error(evaluator, fitted, coordinate, largest)
    return offs, fitted


def _is_material(evaluator: Evaluator, fitted: Fitted, term: Term) -> bool:
    """True where the error is as large as its term asks for."""
    return term.material(values_of(term.slug, fitted.candidates.mean(axis=0)), evaluator.summary)


def _leans_with_force(fitted: Fitted) -> bool:
    """True where a flow force may have the slope of the reading as a part of its shape."""
    if FLOW not in fitted.layout.places:
        return False
    U = float(fitted.values(FLOW)[:, 0].mean())
    over_stroke = 100.0 * float(fitted.candidates[:, base_coordinate.GAIN].mean())
    return abs(over_stroke) <= OWN_SLOPE * abs(U)


def _explained(fitted: Fitted, offs: list[ReadingError]) -> bool:
    """True where a zero error is part of another finding: a span error turns about some point of
    the stroke, so that mid-travel is off by as much as the ends of the stroke are at most; friction
    whose slips are uneven may be the larger one way altogether; the mean of a flow force moves the
    stem everywhere; and a reading that wanders and was right at some time is off at others."""
    if any(reading_error.term.slug == SPAN for reading_error in offs):
        zero, gain = (
            abs(float(fitted.candidates[:, place].mean()))
            for place in (base_coordinate.ZERO, base_coordinate.GAIN)
        )
        return zero - HALF_STROKE * gain < CALIBRATE_FROM_PERCENT
    if off_by_uneven_friction(fitted) is not None or _is_mean_of_force(fitted):
        return True
    if DRIFT not in fitted.layout.places:
        return False
    zero = float(fitted.candidates[:, base_coordinate.ZERO].mean())
    off = zero + course(fitted.values(DRIFT).mean(axis=0))
    return float(np.abs(off).min()) < LEAST_ZERO or float(off.min()) < 0.0 < float(off.max())


def _is_mean_of_force(fitted: Fitted) -> bool:
    """True where a zero error may be the mean of a flow force (``OWN_MEAN``)."""
    if FLOW not in fitted.layout.places:
        return False
    U = float(fitted.values(FLOW)[:, 0].mean())
    zero = float(fitted.candidates[:, base_coordinate.ZERO].mean())
    return U * zero < 0.0 and abs(zero) <= OWN_MEAN * abs(U)


def off_by_uneven_friction(fitted: Fitted) -> float | None:
    """By how much the stem is off its command, percent, as by a zero error, where friction that is
    uneven as its slips are does the same; ``None`` where it does not.

    An ``S (1 + b)`` rising and ``S (1 - b)`` falling is the same as a zero of ``-S b/2``, with
    ``b`` from -1 to 1. From the zero on that asks for work it is a finding of its own all the same.
    """
    if UNEVEN not in fitted.layout.places:
        return None
    middle = fitted.candidates.mean(axis=0)
    (S, _), zero = S_and_J(middle), float(middle[base_coordinate.ZERO])
    return zero if abs(zero) < min(0.5 * S, CALIBRATE_FROM_PERCENT) else None


def zero_or_uneven_friction(evaluator: Evaluator, fitted: Fitted, zero: Term) -> str:
    """A sentence on the ``zero`` error that uneven friction may make; empty where it makes none of
    a material size.
    """
    off = off_by_uneven_friction(fitted)
    if off is None or not zero.material(np.array([off]), evaluator.summary):
        return ""
    return (
        f"Over both directions the position lies {abs(off):.2g} % "
        f"{'below' if off < 0.0 else 'above'} its command: friction that is larger one way makes "
        "that, as a zero error of the reading does; a reading at a stop tells which."
    )


def without_error(evaluator: Evaluator, fitted: Fitted, coordinate: int, largest: float) -> Fitted:
    """``fitted`` with one base coordinate held at neutral, refitted."""
    layout = pinned(fitted.layout, coordinate, largest)
    start = conclude(evaluator, scored(layout, layout.bounds.clip(fitted.candidates)))
    return conclude(evaluator, refit(evaluator, start, CAREFUL))


def _at_every_speed(
    evaluator: Evaluator, fitted: Fitted, found: ReadingError, terms: dict[str, Term]
) -> ReadingError:
    """``found``, or a slip overshoot in its place where the record fits a stem that sticks at every
    speed as well as one that sticks at low speed only.
    """
    overshoot = terms.get(OVERSHOOT)
    if found.term.slug != RESTICK or overshoot is None:
        return found
    low, high = fitted.layout.bounds.low.copy(), fitted.layout.bounds.high.copy()
    low[base_coordinate.RESTICK] = high[base_coordinate.RESTICK] = RESTICK_REACH
    layout = replace(fitted.layout, bounds=Bounds(low, high))
    begun = conclude(evaluator, scored(layout, layout.bounds.clip(fitted.candidates)))
    always = conclude(evaluator, refit(evaluator, begun, CAREFUL))
    if gain(evaluator, always, fitted).t >= AS_GOOD:
        return found
    advantage = gain(evaluator, found.without, always)
    return ReadingError(overshoot, advantage, found.without, (RESTICK,))


def _or_bent(
    evaluator: Evaluator, fitted: Fitted, found: ReadingError, terms: dict[str, Term]
) -> ReadingError:
    """``found``, and the bow of a linkage beside a span error that the record cannot tell from
    it."""
    bow = terms.get(BOW)
    if found.term.slug != SPAN or bow is None:
        return found
    tells = bent_instead(evaluator, fitted, bow)
    return found if tells is None else replace(found, beside=(BOW,), tells=tells)


def _or_sagging(
    evaluator: Evaluator, fitted: Fitted, found: ReadingError, terms: dict[str, Term]
) -> ReadingError:
    """``found``, and a supply sag beside a zero error that the record cannot tell from it."""
    sag = terms.get(SAG)
    if found.term.slug != ZERO or sag is None or not sags_instead(evaluator, fitted, sag):
        return found
    return replace(found, beside=(SAG,))


def _or_leaning(
    evaluator: Evaluator, fitted: Fitted, leaning: Fitted | None, found: ReadingError
) -> ReadingError:
    """``found``, and a span error beside a zero error that the record cannot tell from it;
    ``leaning`` is the hypothesis with a free gain, without a force that may have a slope itself.
    """
    if found.term.slug != ZERO or leaning is None:
        return found
    # Where the stem moved too little for a span error, its gain is free in what was fitted.
    level = without_error(evaluator, fitted, *COORDINATES[SPAN]) if fitted is leaning else fitted
    if not leans(evaluator, level, leaning):
        return found
    return replace(found, beside=(*found.beside, SPAN), tells=WHAT_TELLS)


def _or_uneven(
    evaluator: Evaluator,
    fitted: Fitted,
    found: ReadingError,
    terms: dict[str, Term],
    more: Collection[TermScore],
) -> ReadingError:
    """``found``, and uneven slips beside a zero error that uneven friction may make: where the
    record comes near to showing such slips by the scores of ``more`` terms, or they do as well in
    its place.

    Of 24 valves with a zero error (`draw_effect`, seeds 4065 and 4076, development) none comes to
    0.1 of the limits by uneven slips.
    """
    slips = terms.get(UNEVEN)
    if found.term.slug != ZERO or slips is None or UNEVEN in fitted.layout.places:
        return found
    if not (_nearly_shown(evaluator, more) or slips_instead(evaluator, fitted, slips)):
        return found
    tells = f"{found.tells} {TELLS_FRICTION}".lstrip()
    return replace(found, beside=(*found.beside, UNEVEN), tells=tells)


def _nearly_shown(evaluator: Evaluator, more: Collection[TermScore]) -> bool:
    """Whether uneven slips come near to being named beside a zero error that uneven friction may
    make."""
    score = next((score for score in more if score.slug == UNEVEN), None)
    if score is None or off_by_uneven_friction(score.fitted) is None:
        return False
    return strength(score.advantage, evaluator.measured_counts, UNEVEN) >= NEAR


def _dropped(
    evaluator: Evaluator,
    fitted: Fitted,
    term: Term,
    coordinate: int,
    largest: float,
    is_shown: bool,
) -> ReadingError | None:
    value = fitted.candidates.mean(axis=0)[coordinate]
    may_be_overshoot = term.slug == RESTICK and value >= LEAST_RESTICK
    if not (may_be_overshoot or _is_material(evaluator, fitted, term)):
        return None
    neutral_fit = without_error(evaluator, fitted, coordinate, largest)
    advantage = gain(evaluator, neutral_fit, fitted)
    if not (is_shown or convincing(advantage, evaluator.measured_counts, term.slug)):
        return None
    return ReadingError(term, advantage, neutral_fit)
