"""What every network is to a comparison: a description, and weights learned from a recording."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from stemwatch.models.recording import Bools, Floats, Recording
from stemwatch.models.stickslip.problem import FitProblem
from stemwatch.models.studies.literature.fit import ModelFit


@dataclass(frozen=True, kw_only=True)
class Lesson:
    """A recording made ready: what may be learned from, and where a free run starts.

    ``stretches`` are (first, last) of runs without a hole, cut at ``train_until``. ``learned`` (n,)
    are the samples of the training part that may be fitted. ``element`` is the canonical
    stick-slip element fitted to the same samples.
    """

    recording: Recording
    train_until: int
    problem: FitProblem
    stretches: tuple[tuple[int, int], ...]
    learned: Bools
    element: ModelFit


@dataclass(frozen=True, kw_only=True)
class Learned:
    """``weights`` (P,) of all networks together and their free run ``simulated`` (n,), percent;
    both ``None`` where nothing was learned. ``outcome``: why not, or what to know of it."""

    weights: Floats | None = None
    simulated: Floats | None = None
    outcome: str = ""


class Network(Protocol):
    """A network from command to stem position, both in percent.

    ``learn`` must look at no position outside ``lesson.learned`` but for those a free run starts
    from, give the same numbers for the same recording, and refuse with a sentence.
    """

    @property
    def name(self) -> str:
        """The name by which a comparison is asked for it."""
        ...

    @property
    def source(self) -> str:
        """Whose network it is, and how well that is known."""
        ...

    @property
    def limits(self) -> tuple[str, ...]:
        """What is wrong with it, a sentence each."""
        ...

    def equation(self) -> str:
        """The network in a line."""
        ...

    def learn(self, lesson: Lesson) -> Learned:
        """Weights from the samples that may be learned from and a free run, or why not."""
        ...
