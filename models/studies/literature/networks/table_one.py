"""The paper's networks of Table 1, trained on a recording."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from stemwatch.models.decision.decision import shape_of
from stemwatch.models.recording import Bools, Floats
from stemwatch.models.studies.literature.networks.network import TrainedNetwork, TrainingInput
from stemwatch.models.verdict import Shape

SOURCE = (
    "Table 1 of Zabiri et al. for the layers' transfer functions; sizes 10, 10, 1, scaling, seeds "
    "and training are ours, because the paper gives none."
)
SHARED_LIMITS = (
    "Near a border of two shapes, another record of the same valve can be given another network.",
    "What lies outside the training part's range is extrapolated, and where the last layer is a "
    "log sigmoid, held within 1.25 half ranges of its middle.",
    "A long record is thinned: at most 1,500 samples, in pieces spread evenly over it, are "
    "trained on, and as many watched.",
)


@dataclass(frozen=True, kw_only=True)
class Range:
    """Scaling of signals to about -1 ... 1: the middle is subtracted, then divided by the larger
    half range of the training part.
    """

    op_middle: float
    mv_middle: float
    half: float

    @classmethod
    def of(cls, op: Floats, mv: Floats) -> Range:
        """The scaling from the samples (n,) of the training part, percent."""
        half = max(float(np.ptp(op)), float(np.ptp(mv))) / 2.0
        middles = [float(x.max() + x.min()) / 2.0 for x in (op, mv)]
        return cls(op_middle=middles[0], mv_middle=middles[1], half=half)


@dataclass(frozen=True, kw_only=True)
class TableOne:
    """One column of the table; see ``Network``. ``recurrent``: NARX, otherwise feedforward."""

    name: str
    recurrent: bool
    text: str
    own_limits: tuple[str, ...]
    source: str = SOURCE

    @property
    def limits(self) -> tuple[str, ...]:
        """The known faults, a sentence each: its own first, then those of both columns."""
        return self.own_limits + SHARED_LIMITS

    def equation(self) -> str:
        """The network in a line."""
        return self.text

    def learn(self, lesson: TrainingInput) -> TrainedNetwork:
        """Train several seeds side by side and keep the best one on the watched block of time."""
        from stemwatch.models.studies.literature.networks import (
            training,  # torch takes two seconds to import
        )

        S, J = (lesson.element.parameters[name].value or 0.0 for name in ("S", "J"))
        shape = shape_of(S, J)
        problem, learned = lesson.problem, lesson.learned
        scale = Range.of(problem.op[learned], problem.mv[learned])
        u = (problem.op - scale.op_middle) / scale.half
        y = (problem.mv - scale.mv_middle) / scale.half
        trained = training.train(shape, u, y, _runs(lesson), recurrent=self.recurrent)
        if isinstance(trained, str):
            return TrainedNetwork(outcome=trained)
        step, weights = trained
        run, diverged = training.run(step, weights, u, y, lesson.stretches)
        return TrainedNetwork(
            weights=weights,
            simulated=scale.mv_middle + scale.half * run,
            outcome=_outcome(shape, S, J, diverged),
        )


def _runs(lesson: TrainingInput) -> list[Bools]:
    """(n,) samples of each training stretch that may be learned from."""
    index = np.arange(lesson.learned.size)
    within_learned = partial(np.logical_and, lesson.learned)
    return [
        within_learned((index >= first) & (index < last))
        for first, last in lesson.stretches
        if first < lesson.train_until
    ]


def _outcome(shape: Shape, S: float, J: float, diverged: bool) -> str:
    sentence = f"Layers of Table 1 for {shape.value}, by the fitted S {S:.3g} % and J {J:.3g} %."
    if diverged:
        sentence += (
            " The free run diverges: it went to 3 half ranges from the middle, and was held there."
        )
    return sentence


FEEDFORWARD_PAPER = TableOne(
    name="feedforward (paper)",
    recurrent=False,
    text="y(t) = f3(W3 f2(W2 f1(W1 u(t) + b1) + b2) + b3)",
    own_limits=(
        "Without memory it draws one line through the loop, with neither dead band nor stick.",
    ),
)
NARX_PAPER = TableOne(
    name="NARX (paper)",
    recurrent=True,
    text="y(t) = f3(W3 f2(W2 f1(W1 [u(t-1), u(t-2), y(t-1), y(t-2)] + b1) + b2) + b3)",
    own_limits=(
        "Fed its own output it can diverge or drift; for no offset all three layers are linear, "
        "and the network cannot stick.",
        "It does not see the command at the same sample, as in the paper's equation (1).",
    ),
)
