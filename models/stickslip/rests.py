"""Which of two signals rests while the other goes on: a sticking stem does, a controller's output
does not.

A stem that sticks stays where it is while its command moves on, slips, and rests again. If OP and
position are exchanged, the other name rests. A late clock shifts one signal against the other and
leaves the rests unchanged. So rests separate a late OP from an exchanged one, which a free run
cannot do reliably.

A rest is a run of samples that stay within a tenth of the band between the two signals (its 2nd to
98th percentile) and their noise. It counts where the other signal meanwhile goes on by more than a
third of the band, in more than one step: the one step of a slip falls between two samples of OP.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.compiled import compiled
from stemwatch.models.recording import Bools, Floats
from stemwatch.models.signals.forensics import medians_of_three, noise_sigma
from stemwatch.models.stickslip.problem import FitProblem

BAND = (2.0, 98.0)  # percentiles of MV - OP
STAYS, GOES_ON = 0.1, 0.3  # shares of the band
NOISE = 4.0  # standard deviations, of the one that rests and of the one that goes on
SHORTEST = 6  # samples; the first and last are left out, where the other may slip
# Of 372 simulated valves wired up rightly and as many with OP and MV exchanged (`draw_valves`,
# seeds 6161, 8383, 9393; `draw_healthy`, `draw_sticky`, seeds 5151, 7171, 9393) none has its rests
# on the wrong side; 129 of the 156 sticking ones have them on the right one, the others too few.
FEWEST, TIMES = 5, 4.0


@dataclass(frozen=True)
class Rests:
    """How often the ``position`` rested while the command went on, and the ``command`` while the
    position went on."""

    position: int
    command: int

    @classmethod
    def of(cls, problem: FitProblem) -> Rests:
        """The rests among the scored samples; OP and position in percent of travel both."""
        op, mv, scored = problem.op, problem.mv, problem.scored
        if not scored.any():
            return cls(0, 0)
        low, high = np.percentile((mv - op)[scored], BAND)
        band = float(high - low)
        return cls(_rests(mv, op, scored, band), _rests(op, mv, scored, band))

    @property
    def of_position(self) -> bool:
        """Whether it is the position that rests, as a stem does."""
        return self.position >= FEWEST and self.position > TIMES * self.command

    @property
    def of_command(self) -> bool:
        """Whether it is the command that rests, as a stem does."""
        return self.command >= FEWEST and self.command > TIMES * self.position


def _rests(resting: Floats, moving: Floats, usable: Bools, band: float) -> int:
    """How often ``resting`` (n,) stayed while ``moving`` (n,) went on."""
    stays = STAYS * band + NOISE * noise_sigma(resting)
    farthest = GOES_ON * band + stays + NOISE * noise_sigma(moving)
    ends = _runs(resting, usable, stays)
    return sum(_path_length(moving[first:last]) > farthest for first, last in _long(ends))


def _long(ends: NDArray[np.int64]) -> Iterator[tuple[int, int]]:
    """Begin and end of the inner part of each run that is long enough; ``ends`` (m,) are those of
    all runs.
    """
    begins = np.concatenate(([0], ends[:-1]))
    for index in np.flatnonzero(ends - begins >= SHORTEST):
        yield int(begins[index]) + 1, int(ends[index]) - 1


def _path_length(values: Floats) -> float:
    """The range of the medians of three ``values`` each, less the largest step between them."""
    middle = medians_of_three(values)
    return float(np.ptp(middle) - np.abs(np.diff(middle)).max())


@compiled()
def _runs(values: Floats, usable: Bools, stays: float) -> NDArray[np.int64]:
    """(m,) where each run ends that stays within ``stays``; the next one begins there."""
    ends = np.empty(values.size, dtype=np.int64)
    count = 0
    low = high = values[0]
    for k in range(1, values.size):
        low, high = min(low, values[k]), max(high, values[k])
        if not usable[k] or high - low > stays:
            ends[count] = k
            count += 1
            low = high = values[k]
    ends[count] = values.size
    return ends[: count + 1]
