"""Whether the steps of an OP are the command's own, as in a stroke test, or those of its recorder.

A recorder that rounds OP to 2 % and an operator who sets it by 2 % store the same values. The stem
tells them apart. It follows what the valve was told: after an operator's step it moves, and then it
rests until the next one. Where the recorder rounded, the command went on between two stored values,
and so did the stem.
"""

from __future__ import annotations

import numpy as np

from stemwatch.models.recording import Floats, Recording, kept
from stemwatch.models.statistics.quantiles import median

FEWEST_STEPS = 8
LONGEST_ANSWER = 10  # samples after a step within which the stem has answered it
MOST_OF_HOLD = 0.4  # of the time between two steps, for that answer
# How much of the stem's way lies after steps, over what lies between: 1 or less where it goes on at
# one speed, and at most so much more where slips come at any time.
OVER_REST = 4.0


@kept
def op_is_set_in_steps(recording: Recording) -> bool:
    """True where OP is held, set anew in a sample and held again, and the stem moves after its
    steps and rests between."""
    if recording.mv is None:
        return False
    usable = recording.usable
    op, mv = recording.op.values[usable], recording.mv.values[usable]
    return set_in_steps(op, mv)


def set_in_steps(op: Floats, mv: Floats) -> bool:
    """The same of OP and position (n,) themselves, both finite."""
    at = np.flatnonzero(np.diff(op) != 0.0) + 1
    if at.size < FEWEST_STEPS:
        return False
    holds = np.diff(at, append=op.size)
    answer = min(LONGEST_ANSWER, int(MOST_OF_HOLD * median(holds)))
    long_enough = holds * MOST_OF_HOLD >= answer
    if answer < 1 or np.mean(long_enough) < 0.5:
        return False
    first, last = at[long_enough], (at + holds)[long_enough] - 1
    after = np.abs(mv[first + answer] - mv[first - 1]).sum()
    between = np.abs(mv[last] - mv[first + answer]).sum()
    return bool(after > OVER_REST * between)
