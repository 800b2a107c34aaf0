"""Whether PV answers the position that was recorded, or OP alone.

A process knows nothing of OP: it answers where the stem stands. So with the valve's own position,
OP tells nothing of PV's next move that the position does not tell as well; and where the stem
sticks, less. With the position of another valve it is the other way round: OP tells much, the
position nothing, however well it goes with OP because both loops follow one programme.

Which of two signals moves a third is asked as Granger does (doi:10.2307/1912791). The move of PV
over the next samples is predicted by least squares from the past of PV and from the set point, past
and to come (what both loops share), then with the past of OP, of the position, or of both:

    OP_alone = (left with the position - left with both) / (left with neither - left with both)

It is near 0 for the valve's own position, near 1 for another's. The position may have a late clock,
so it is shifted earlier by up to twelve samples, and the shift that speaks most for it counts; a
position that is another's gains nothing by it.

It is asked only where a set point moves: that is the programme which another loop can share. Where
loads move the loop, OP stands for the load, which nobody records, and tells of PV whatever the
position is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.recording import Floats, Recording, Role, Signal
from stemwatch.models.signals.excitation import swing

AHEAD = 5  # samples over which PV's move is predicted
PAST = (1, 2, 4, 8, 16, 32, 64)  # samples
PAST_OF_SP = (1, 2, 3, 4, 5, 6, 8, 10, 12, 14, 16, 20, 24, 28, 32, 40, 48, 56, 64)
NEXT_OF_SP = (1, 2, 3, 4, 5, 6, 8, 10, 12)
EARLIER = (0, 1, 2, 3, 5, 8, 12)  # samples, of the position
FEWEST = 200  # samples
# Swing of the set point, as a share of PV's, from which a programme moves the loop. Under loads
# alone it is 0, and OP alone tells up to 0.86 of PV beside the valve's own position: six of 120
# sticking valves of `stemwatch trial --seed 777` had lost their verdict by that.
PROGRAMME = 0.3
# `stemwatch calibrate-wiring` derives these from recordings whose tags are right, of valves that
# stick by so much: a healthy stem stands where OP says, so that either tells the same.
OP_ALONE, EVIDENT, STICKS_PERCENT = 0.65, 100.0, 0.75


@dataclass(frozen=True)
class PvAnswers:
    """Share of what OP and position tell of PV that ``op_alone`` tells (0 to 1), and how
    ``evident`` that is: the squares it explains over the mean square that is left. NaN where there
    are too few samples, no set point moves, or neither tells anything.
    """

    op_alone: float = np.nan
    evident: float = np.nan

    @property
    def of_op_only(self) -> bool:
        """Whether PV follows OP and not this position."""
        return self.op_alone >= OP_ALONE and self.evident >= EVIDENT

    @classmethod
    def of(cls, recording: Recording) -> PvAnswers:
        """What OP and position of a ``recording`` tell of its PV; all with the clocks as stored."""
        pv, mv, sp = recording.get(Role.PV), recording.mv, recording.get(Role.SP)
        samples = np.arange(PAST[-1], len(recording) - max(AHEAD, *NEXT_OF_SP, *EARLIER))
        if pv is None or mv is None or sp is None or samples.size < FEWEST:
            return cls()
        values, programme = _known(pv), _known(sp)
        if swing(programme) <= PROGRAMME * swing(values):
            return cls()
        rest = [*_past(values, samples, PAST), *_past(programme, samples, PAST_OF_SP)]
        rest += [programme[samples + later] - programme[samples] for later in NEXT_OF_SP]
        command, position = _known(recording.op), _known(mv)
        groups = [rest, _past(command, samples, PAST)]
        groups += [_past(position, samples + earlier, PAST) for earlier in EARLIER]
        left = _Regression.of(groups, values[samples + AHEAD] - values[samples])
        if left is None:
            return cls()
        neither = left.by(0)
        shifts = []
        for group in range(2, len(groups)):
            with_position, with_both = left.by(0, group), left.by(0, 1, group)
            told = with_position - with_both
            shifts.append(
                cls(
                    op_alone=told / max(neither - with_both, 1e-12),
                    evident=left.samples * told / max(with_both, 1e-12),
                )
            )
        return min(shifts, key=lambda shift: shift.op_alone)


def _known(signal: Signal) -> Floats:
    return np.where(signal.usable, signal.values, np.nan)


def _past(values: Floats, samples: NDArray[np.int64], past: tuple[int, ...]) -> list[Floats]:
    """The value at each of ``samples`` (m,), and its moves since each of ``past``."""
    return [values[samples], *(values[samples] - values[samples - earlier] for earlier in past)]


@dataclass(frozen=True)
class _Regression:
    """Normal equations of all groups of columns together; any of the groups can be fitted."""

    products: Floats  # (p, p)
    with_target: Floats  # (p,)
    squares: float
    samples: int
    columns: list[NDArray[np.int64]]

    @classmethod
    def of(cls, groups: list[list[Floats]], target: Floats) -> _Regression | None:
        """From columns (m,) and a ``target`` (m,); ``None`` where too little of them is known."""
        table = np.column_stack([column for group in groups for column in group])
        known = np.isfinite(table).all(axis=1) & np.isfinite(target)
        if np.count_nonzero(known) < FEWEST:
            return None
        table, target = table[known], target[known] - target[known].mean()
        table = table - table.mean(axis=0)
        scale = np.sqrt(np.mean(table**2, axis=0))
        table = table / np.where(scale > 0.0, scale, 1.0)
        squares = float(target @ target)
        if squares <= 0.0:
            return None
        ends = np.cumsum([len(group) for group in groups])
        columns = np.split(np.arange(ends[-1]), ends[:-1])
        return cls(table.T @ table, table.T @ target, squares, target.size, columns)

    def by(self, *groups: int) -> float:
        """Share of the target's squares that the best line through these groups leaves."""
        index = np.concatenate([self.columns[group] for group in groups])
        part, target = self.products[np.ix_(index, index)], self.with_target[index]
        weights = np.linalg.lstsq(part, target, rcond=1e-10)[0]
        return max(self.squares - float(weights @ target), 0.0) / self.squares
