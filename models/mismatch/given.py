"""What a run is given beside its stem: the record, and how it is scored."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.recording import Floats


class Record(NamedTuple):
    """What every candidate is run over, ``n`` samples every ``interval_s`` seconds.

    ``marks`` (n,): at START the whole state is taken from ``mv`` (n,), percent, at RESYNC only the
    place where a resting stem rests. ``next_up`` and ``next_down`` (n,) are the samples at which
    the recorded stem next lets go, or n; ``window`` (a share of ``fs``, 0: a free run) is how far
    from ``fs`` it may do so.
    """

    mv: Floats
    marks: NDArray[np.uint8]
    next_up: NDArray[np.int64]
    next_down: NDArray[np.int64]
    interval_s: float
    window: float


class Scoring(NamedTuple):
    """What a run costs: Cauchy's loss ``delta^2 log(1 + (r/delta)^2)`` of its samples, and more.

    ``block`` (n,) is the block number of a sample, negative where it is not scored; neighbours
    must be grouped. ``slack`` (n,) is how far a value may lie from ``mv`` at no cost, percent: 0
    where it was measured. A breakaway that was assimilated ``e`` percent from its level costs
    ``event`` times ``delta^2 log(1 + (e/scatter)^2)``.
    """

    block: NDArray[np.int64]
    slack: Floats
    delta: float
    scatter: float
    event: float
