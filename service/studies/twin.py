"""How well the twin of a loop predicts changes, on simulated loops with a sticking valve.

The plant is the force-balance simulator, which shares no code with the twin. The truth of a change
is that plant run again with it, with the same loads, noise and set points.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stemwatch.models.closed_loop.fitted_loop import LoopRun
from stemwatch.models.closed_loop.what_if import (
    NUMBERS,
    REPAIRED,
    LoopChange,
    LoopFigures,
    figures_of,
    predict,
)
from stemwatch.models.estimate import Estimate
from stemwatch.models.recording import Role
from stemwatch.models.screening.repair import loop_of
from stemwatch.models.screening.screen import Case, Options, screen
from stemwatch.models.studies.simulator.draws import draw_sticky
from stemwatch.models.studies.simulator.loop import PlantLoop
from stemwatch.models.studies.simulator.simulate import simulate_loop

FALL = "variance_fall"
FIGURES = (FALL, *(name for name in NUMBERS if name != "off_target"))


@dataclass(frozen=True, kw_only=True)
class PredictedFigure:
    """One figure of one change of one loop: predicted, and as it truly came. ``None`` is a period
    where nothing oscillates regularly."""

    change: str
    figure: str
    predicted: Estimate
    truth: float | None

    @property
    def error(self) -> float | None:
        """The size of the error as a share of the truth; a fall of the variance in percent counts
        as at least 5 percent."""
        if self.predicted.value is None or self.truth is None:
            return None
        least = 5.0 if self.figure == FALL else 1e-9
        return abs(self.predicted.value - self.truth) / max(abs(self.truth), least)

    @property
    def holds(self) -> bool | None:
        """Whether the interval holds the truth; ``None`` where either is not known."""
        low, high = self.predicted.low, self.predicted.high
        if self.truth is None or low is None or high is None:
            return None
        return low <= self.truth <= high


@dataclass(frozen=True, kw_only=True)
class PredictedLoop:
    """One loop: its figures, or why it has no twin."""

    tag: str
    figures: tuple[PredictedFigure, ...] = ()
    reason: str = ""


def run_twin_study(loops: int, seed: int) -> Iterator[PredictedLoop]:
    """Draw ``loops`` with a sticking valve, fit the twin of each, and hold it to the plant."""
    for index, loop in enumerate(draw_sticky(loops, seed)):
        yield _judged(loop, seed + index)


def _judged(loop: PlantLoop, seed: int) -> PredictedLoop:
    recording = simulate_loop(loop, seed).recording
    screening = screen([Case(recording=recording)], Options(narx=False))[0]
    twin = loop_of(recording, screening)
    if isinstance(twin, str):
        return PredictedLoop(tag=loop.tag, reason=twin)
    valve, controller = loop.valve, loop.controller
    S, J = twin.valve.S, twin.valve.J
    half = replace(valve, S=valve.S / 2.0, J=valve.J / 2.0)
    changes = (
        ("repaired", REPAIRED, replace(loop, valve=replace(valve, S=0.0, J=0.0))),
        ("half the friction", LoopChange(S=S / 2.0, J=J / 2.0), replace(loop, valve=half)),
        (
            "half the gain",
            LoopChange(gain_times=0.5),
            replace(loop, controller=replace(controller, gain=controller.gain / 2.0)),
        ),
        (
            "twice the reset time",
            LoopChange(reset_times=2.0),
            replace(loop, controller=replace(controller, reset_s=2.0 * controller.reset_s)),
        ),
    )
    figures: list[PredictedFigure] = []
    for name, change, changed in changes:
        prediction, truth = predict(twin, change), _truth(changed, seed, twin.valve.noise)
        falls = 100.0 * (1.0 - (truth.error_std / prediction.recorded.error_std) ** 2)
        predicted = {FALL: prediction.fall("error_std", squared=True), **prediction.predicted}
        came = {FALL: falls, **vars(truth)}
        figures += [
            PredictedFigure(change=name, figure=key, predicted=predicted[key], truth=came[key])
            for key in FIGURES
        ]
    return PredictedLoop(tag=loop.tag, figures=tuple(figures))


def _truth(loop: PlantLoop, seed: int, noise: float) -> LoopFigures:
    recording = simulate_loop(loop, seed).recording
    pv, sp, mv = recording.signals[Role.PV], recording.signals[Role.SP], recording.signals[Role.MV]
    return figures_of(
        LoopRun(
            op=recording.op.values,
            x=mv.values,
            pv=pv.values,
            sp=sp.values,
            interval_s=recording.interval_s,
        ),
        noise=noise,
    )


@dataclass(frozen=True, kw_only=True)
class PredictionRow:
    """One figure of one change over all twins: how many have it, the median ``error`` as a share
    of the truth (``None`` where none has one), and in how many of ``of`` the interval holds."""

    change: str
    figure: str
    figures: int
    error: float | None
    holds: int
    of: int


def figure_rows(twins: Sequence[PredictedLoop]) -> Iterator[PredictionRow]:
    """A row for each figure of each change, in the order in which they were asked for."""
    figures = [figure for twin in twins for figure in twin.figures]
    for change in dict.fromkeys(figure.change for figure in figures):
        for name in FIGURES:
            chosen = [each for each in figures if (each.change, each.figure) == (change, name)]
            errors = [figure.error for figure in chosen if figure.error is not None]
            holds = [figure.holds for figure in chosen if figure.holds is not None]
            yield PredictionRow(
                change=change,
                figure=name,
                figures=len(errors),
                error=float(np.median(errors)) if errors else None,
                holds=sum(holds),
                of=len(holds),
            )
