"""The response figures of a valve as people read them: two sentences and a table."""

from __future__ import annotations

from dataclasses import dataclass

from stemwatch.models.estimate import Estimate
from stemwatch.models.health_indicators.response_figures import (
    ResponseFigures,
    StepFigures,
    response_figures,
)
from stemwatch.models.screening_result import Screening
from stemwatch.service.presenter.physics_words import effect_name
from stemwatch.service.presenter.wording import figure, finite, share

STANDARD = "ANSI/ISA-75.25.01 and ISA-TR75.25.02"


@dataclass(frozen=True, kw_only=True)
class ResponseRow:
    """One step: its size and direction, then each figure as text; only ``moves`` is set where the
    stem does not move."""

    step: str
    moves: str
    gain: str = ""
    dead_time: str = ""
    t86: str = ""
    overshoot: str = ""


@dataclass(frozen=True, kw_only=True)
class ResponseTable:
    """What the page shows of ``figures``."""

    sentences: tuple[str, ...]
    rows: tuple[ResponseRow, ...]


def response_table(screening: Screening) -> ResponseTable | None:
    """The figures of ``screening`` in words; ``None`` where S and J are not known."""
    figures = response_figures(screening)
    if not figures.steps:
        return None
    alike = figures.both_ways_alike
    return ResponseTable(
        sentences=tuple(_sentences(figures)),
        rows=tuple(_row(step, alike) for step in figures.distinct_steps),
    )


def _sentences(figures: ResponseFigures) -> list[str]:
    sentences = [
        f"Dead band {figures.dead_band} of OP, resolution {figures.resolution}, in the words of "
        f"{STANDARD}: a step the same way as the last moves the stem if it is larger than the "
        "resolution, one the other way if it is larger than the dead band. Computed from the model "
        "that was fitted, without a test in the field."
    ]
    if figures.simulated:
        names = ", ".join(effect_name(slug) for slug in figures.simulated)
        sentences.append(f"The steps were run on the fitted model, with: {names}.")
    if figures.left_out:
        names = ", ".join(effect_name(slug) for slug in figures.left_out)
        sentences.append(f"Not in these figures: {names}.")
    return sentences


def _row(step: StepFigures, same_both_ways: bool) -> ResponseRow:
    direction = "" if same_both_ways else f", position {'rising' if step.rising else 'falling'}"
    name = f"{step.step_percent:g} %, {step.way.value}{direction}"
    if step.dead_time.value is None:
        return ResponseRow(step=name, moves="does not move")
    moves = "moves" if step.moves > 0.99 else f"moves in {share(step.moves)} of draws"
    return ResponseRow(
        step=name,
        moves=moves,
        gain=_spread(step.travel_gain),
        dead_time=_spread(step.dead_time),
        t86=_spread(step.t86),
        overshoot=_spread(step.overshoot),
    )


def _spread(estimate: Estimate) -> str:
    """A number with its interval in brackets, where it is one."""
    value, low, high = (finite(number) for number in (estimate.value, estimate.low, estimate.high))
    value_text = figure(_tidy(value), 2)
    if low is None or high is None or figure(_tidy(low), 2) == figure(_tidy(high), 2):
        return value_text
    return f"{value_text} ({figure(_tidy(low), 2)} to {figure(_tidy(high), 2)})"


def _tidy(value: float | None) -> float | None:
    """The value without residues below a millisecond or a thousandth."""
    return 0.0 if value is not None and abs(value) < 1e-3 else value
