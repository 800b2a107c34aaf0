"""``response_figures``: the figures of a step test by ANSI/ISA-75.25.01 and TR75.25.02, from what
was fitted to a recording of normal operation.

A stick-slip element with S and J, behind a delay ``theta``, a lag ``tau`` and a speed limit ``v``,
has a dead band S and a resolution J in the standard's sense. The force on a stem that was pushed
one way stays at the sliding level when the command halts, so a further step the same way moves it
from J on, and a step back from S on. For a step of ``a`` percent of OP, which the stem answers
from ``b`` (J or S) on and of which it misses ``m`` (0 or S - J) in the end::

    gain   1 - m / a
    Td     theta + g(b)
    T86    theta + g(max(b, m + 0.865 (a - m)))
    g(q)   q / v                                     while q <= a - v tau
           (a - v tau) / v + tau ln(v tau / (a - q)) after that; tau ln(a / (a - q)) without limit

``g`` is when the actuator has gone ``q`` percent of the way. Where other physics was named that
shapes a step, the steps are run on the model that was fitted (``field_test.rival_runs``).

Published definitions: ISA-TR75.25.02-2000 (R2010), "Control Valve Response Measurement from Step
Inputs"; T86 is the time to 86.5 percent of the final change.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from stemwatch.models.estimate import Estimate
from stemwatch.models.field_test.rival_runs import RivalRuns
from stemwatch.models.mismatch.findings import Effect, Mismatch
from stemwatch.models.mismatch.fit import base_coordinate
from stemwatch.models.mismatch.open_question import OpenQuestion, RivalModel
from stemwatch.models.recording import Floats
from stemwatch.models.screening_result import Screening
from stemwatch.models.stickslip.interval import REPLICATES, intervals, spread_of

STEPS_PERCENT = (0.5, 1.0, 2.0, 5.0, 10.0)  # of OP, as the technical report has them
SETTLED = 0.865  # of the final change: 1 - exp(-2)
# Named effects that are in the formula, by the parameter that takes the place of which number.
IN_FORMULA: Mapping[str, Mapping[str, tuple[str, ...]]] = {
    "dead_time": {"theta": ("theta",)},
    "actuator_lag": {"tau": ("tau_rising", "tau_falling")},
    "asymmetric_lag": {"tau_rising": ("tau_rising",), "tau_falling": ("tau_falling",)},
    "rate_limit": {"rate": ("rate_rising", "rate_falling")},
    "asymmetric_rate_limit": {
        "rate_rising": ("rate_rising",),
        "rate_falling": ("rate_falling",),
    },
}
# Effects that a step from rest does not show: errors of the reading, and those over hours or many
# strokes.
NOT_IN_A_STEP = frozenset({"zero_shift", "sensor_drift", "growing_stiction", "span_error"})
# Indicators of a fit that needed more than friction, and the model parameter of each.
OF_FIT = {
    "dead_time_s": "theta",
    "lag_rising_s": "tau_rising",
    "lag_falling_s": "tau_falling",
    "speed_rising_percent_per_s": "rate_rising",
    "speed_falling_percent_per_s": "rate_falling",
}
FREE_PERCENT_PER_S = 99.0  # a speed from here on counts as no limit
RUNS = 16  # of the fitted model, for the intervals of steps that are run
SAMPLES = 1200  # of one simulated step, and as many before it
SEED = 23


class StepWay(StrEnum):
    """Which way a step goes, against the one before it."""

    SAME = "same direction"
    REVERSED = "after a reversal"


@dataclass(frozen=True, kw_only=True)
class StepFigures:
    """The response to a step of ``step_percent`` of OP. ``rising``: whether the position rises.

    ``travel_gain`` (percent of travel for a percent of OP), ``dead_time`` Td and ``t86`` in seconds
    from the step, ``overshoot`` in percent of the final change; each unknown where the stem does
    not move. ``moves`` is the probability that it does, 0 to 1.
    """

    step_percent: float
    way: StepWay
    rising: bool
    moves: float
    travel_gain: Estimate
    dead_time: Estimate
    t86: Estimate
    overshoot: Estimate


@dataclass(frozen=True, kw_only=True)
class ResponseFigures:
    """The response figures of one valve.

    ``dead_band`` (S) and ``resolution`` (J) in percent of OP. ``simulated`` are named effects for
    which the steps were simulated with the fitted model; ``left_out`` are those that no stored
    model holds, so that the figures do not include them.
    """

    dead_band: Estimate
    resolution: Estimate
    steps: tuple[StepFigures, ...] = ()
    simulated: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()

    @property
    def both_ways_alike(self) -> bool:
        """Whether the position rises and falls with the same figures."""
        rising = [replace(step, rising=True) for step in self.steps if not step.rising]
        return rising == [step for step in self.steps if step.rising]

    @property
    def distinct_steps(self) -> tuple[StepFigures, ...]:
        """The steps once where both ways are alike, else those that raise the position first."""
        alike = self.both_ways_alike
        return tuple(step for step in self.steps if step.rising or not alike)


@dataclass(frozen=True)
class StepNumbers:
    """(m,) draws of S and J in percent of OP, of delay, lag in s and speed limit in %/s of OP by
    direction, and travel for a percent of OP."""

    S: Floats
    J: Floats
    theta: Floats
    tau: Floats
    rate: Floats
    slope: float = 1.0
    interval_s: float = 0.0  # of the recording: faster responses cannot be resolved


def response_figures(screening: Screening) -> ResponseFigures:
    """The response figures of a screened valve: those of the S, J and effects that are published.

    Unknown with the screening's own reason where S and J are. Seeded.
    """
    S, J, mismatch = screening.S, screening.J, screening.mismatch
    figures = ResponseFigures(dead_band=S, resolution=J)
    if S.value is None or J.value is None or not np.isfinite([S.value, J.value]).all():
        return figures
    effects = () if mismatch is None else mismatch.effects
    shaping = [e for e in effects if e.slug not in IN_FORMULA and e.slug not in NOT_IN_A_STEP]
    slugs = tuple(effect.slug for effect in shaping)
    if shaping and mismatch is not None and (steps := _steps_run(mismatch, screening)):
        return replace(figures, steps=steps, simulated=slugs)
    rises, falls = (_numbers(screening, effects, rising) for rising in (True, False))
    rising = _steps(rises, rising=True)
    if all(map(np.array_equal, vars(rises).values(), vars(falls).values())):
        falling = tuple(replace(step, rising=False) for step in rising)
    else:
        falling = _steps(falls, rising=False)
    return replace(figures, steps=rising + falling, left_out=slugs)


def _steps(numbers: StepNumbers, *, rising: bool) -> tuple[StepFigures, ...]:
    return tuple(
        step_figures(numbers, step_percent, step_way, rising=rising)
        for step_way in StepWay
        for step_percent in STEPS_PERCENT
    )


def _numbers(screening: Screening, effects: tuple[Effect, ...], rising: bool) -> StepNumbers:
    """Draws of the published numbers: the value first, then draws that have its interval."""
    rng = np.random.default_rng(SEED)
    curve = screening.stroke_curve
    slope = 1.0 if curve is None else abs(curve.slope)
    estimates: dict[str, Estimate] = {}
    for effect in effects:
        for parameter, names in IN_FORMULA.get(effect.slug, {}).items():
            if parameter in effect.parameters:
                estimates |= {name: effect.parameters[parameter] for name in names}
    if not effects:
        indicators = screening.indicators
        estimates = {
            number: Estimate(value=indicators[name].value, unit=indicators[name].unit)
            for name, number in OF_FIT.items()
            if name in indicators
        }

    def draws_of(estimate: Estimate | None, missing: float) -> Floats:
        if estimate is None or estimate.value is None:
            return np.full(REPLICATES + 1, missing)
        spread = spread_of(estimate)
        if not spread.size:
            spread = np.full(REPLICATES, estimate.value)
        return np.concatenate(([estimate.value], np.maximum(rng.permutation(spread), 0.0)))

    direction = "rising" if rising else "falling"
    rate = draws_of(estimates.get(f"rate_{direction}"), np.inf)
    return StepNumbers(
        S=draws_of(screening.S, 0.0),
        J=draws_of(screening.J, 0.0),
        theta=draws_of(estimates.get("theta"), 0.0),
        tau=draws_of(estimates.get(f"tau_{direction}"), 0.0),
        rate=np.where(rate >= FREE_PERCENT_PER_S, np.inf, rate) / slope,
        slope=slope,
        interval_s=0.0 if screening.seen is None else screening.seen.interval_s,
    )


def step_figures(
    numbers: StepNumbers, step_percent: float, step_way: StepWay, *, rising: bool
) -> StepFigures:
    """The figures of one step by the formula above; the first of ``numbers`` is the value."""
    from_percent = numbers.J if step_way is StepWay.SAME else numbers.S
    missed = np.zeros_like(numbers.J) if step_way is StepWay.SAME else numbers.S - numbers.J
    moves = from_percent < step_percent
    final = step_percent - missed
    settled = np.maximum(from_percent, missed + SETTLED * final)
    return _figures(
        step_percent,
        step_way,
        rising,
        moves,
        gain=numbers.slope * final / step_percent,
        dead_time=numbers.theta + time_to_go(from_percent, step_percent, numbers),
        t86=numbers.theta + time_to_go(settled, step_percent, numbers),
        # The stem overshoots its final place where J is above S.
        overshoot=np.zeros_like(final),
        interval_s=numbers.interval_s,
    )


def time_to_go(q: Floats, step_percent: float, numbers: StepNumbers) -> Floats:
    """(m,) seconds in which the actuator has gone ``q`` (m,) percent of a step: ``g`` above."""
    tau, rate = np.maximum(numbers.tau, 1e-9), numbers.rate
    bounded = np.clip(q, 0.0, step_percent * (1.0 - 1e-9))
    with np.errstate(invalid="ignore", divide="ignore"):
        limited = np.isfinite(rate)
        # The part at full speed, up to where the lag alone becomes slower than the limit.
        fast = np.where(limited, np.maximum(step_percent - np.where(limited, rate, 0) * tau, 0), 0)
        at_full_speed = np.where(limited, np.minimum(bounded, fast) / rate, 0.0)
        remaining = np.maximum(bounded - fast, 0.0)
        slowing = tau * np.log((step_percent - fast) / (step_percent - fast - remaining))
    return np.asarray(at_full_speed + slowing)


def _figures(
    step_percent: float,
    step_way: StepWay,
    rising: bool,
    moves: np.ndarray[tuple[int], np.dtype[np.bool_]],
    *,
    gain: Floats,
    dead_time: Floats,
    t86: Floats,
    overshoot: Floats,
    interval_s: float,
) -> StepFigures:
    """Estimates from draws, the first of which is the value; draws in which the stem does not move
    are left out.
    """

    draws = np.array([gain, dead_time, t86, overshoot])
    units, least = ("", "s", "s", "%"), (0.0, interval_s, interval_s, 0.0)
    if moves[0]:
        estimates = [
            Estimate(value=float(value), low=low, high=max(high, smallest), unit=unit)
            for value, (low, high), unit, smallest in zip(
                draws[:, 0], intervals(draws[:, moves], draws[:, 0]), units, least, strict=True
            )
        ]
    else:
        level = "resolution" if step_way is StepWay.SAME else "dead band"
        reason = f"the stem does not move: the step is within the {level}"
        estimates = [Estimate.unknown(reason, unit) for unit in units]
    return StepFigures(
        step_percent=step_percent,
        way=step_way,
        rising=rising,
        moves=float(np.mean(moves)),
        **dict(zip(("travel_gain", "dead_time", "t86", "overshoot"), estimates, strict=True)),
    )


def _steps_run(mismatch: Mismatch, screening: Screening) -> tuple[StepFigures, ...]:
    """The steps on the model that was fitted; empty where it was not stored."""
    question = mismatch.open_question
    if question is None or question.published is None:
        return ()
    curve = screening.stroke_curve
    slope = 1.0 if curve is None else abs(curve.slope)
    models = _drawn_models(question.published, screening, slope)
    return tuple(
        _run(question, models, step_percent, slope, step_way, rising=rising)
        for rising in (True, False)
        for step_way in StepWay
        for step_percent in STEPS_PERCENT
    )


def _drawn_models(model: RivalModel, screening: Screening, slope: float) -> tuple[RivalModel, ...]:
    """The fitted model with the published S and J, then draws of all its numbers."""
    rng = np.random.default_rng(SEED)
    S, J = screening.S, screening.J
    assert S.value is not None
    assert J.value is not None

    def normal(estimate: Estimate) -> Floats:
        spread = spread_of(estimate)
        return spread if spread.size else np.full(REPLICATES, estimate.value)

    levels = [(S.value, J.value)]
    levels += list(zip(rng.choice(normal(S), RUNS), rng.choice(normal(J), RUNS), strict=True))
    models = []
    for number, (S_percent, J_percent) in enumerate(levels):
        shift = 0.0 if number == 0 else 1.0

        def between(halves: tuple[tuple[float, ...], ...], shift: float = shift) -> Floats:
            pair = np.array(halves)
            spread = 0.5 * np.abs(pair[0] - pair[1])
            return np.asarray(pair.mean(axis=0) + shift * spread * rng.standard_normal(spread.size))

        base = between(model.base)
        base[base_coordinate.S_PERCENT] = max(S_percent, 0.0) * slope
        base[base_coordinate.RATIO] = max(J_percent, 0.0) / max(S_percent, 1e-6)
        terms = {slug: (tuple(between(halves)),) * 2 for slug, halves in model.terms.items()}
        models.append(RivalModel(slug=model.slug, base=(tuple(base),) * 2, terms=terms))
    return tuple(models)


def _run(
    question: OpenQuestion,
    models: tuple[RivalModel, ...],
    step_percent: float,
    slope: float,
    step_way: StepWay,
    *,
    rising: bool,
) -> StepFigures:
    """Simulate one step with ``models``, from rest after a stroke; the first model gives the
    values.
    """
    up = 1.0 if rising else -1.0
    before = up if step_way is StepWay.SAME else -up
    size = step_percent * slope
    centre = (
        50.0
        if question.op is None
        else 0.5 * (question.op_low or 0) + 0.5 * (question.op_high or 100)
    )
    stroke = before * np.minimum(np.arange(SAMPLES) / (0.4 * SAMPLES), 1.0) * 15.0
    travel = np.concatenate((centre - before * 15.0 + stroke, np.full(SAMPLES, centre + up * size)))
    runs = RivalRuns(question, models, travel, question.interval)
    answers = runs.predicted_each(models)
    final_answers = answers[:, SAMPLES - 1 : SAMPLES]
    moved = up * (answers[:, SAMPLES:] - final_answers)
    final = moved[:, -1]
    seconds = question.interval * question.unit_s
    least = 0.02 * size

    def first(is_reached: np.ndarray[tuple[int, int], np.dtype[np.bool_]]) -> Floats:
        return np.asarray(seconds * np.argmax(is_reached, axis=1), dtype=float)

    return _figures(
        step_percent,
        step_way,
        rising,
        final > least,
        gain=slope * final / size,
        dead_time=first(moved > least),
        t86=first(moved >= SETTLED * final[:, None]),
        interval_s=seconds,
        overshoot=100.0 * np.maximum(moved.max(axis=1) - final, 0.0) / np.maximum(final, least),
    )
