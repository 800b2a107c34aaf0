"""A command that arrives later."""

from __future__ import annotations

from numba import njit

from stemwatch.models.recording import Floats
from stemwatch.models.stickslip.kernel import Marks

_START = 1


@njit(cache=True)
def delayed(command: Floats, marks: Marks, samples: float, out: Floats) -> None:
    """``command`` (n,) later by a delay in samples into ``out`` (n,), another array, percent.

    Linear between samples. What was before a START is not known: the command is held there.
    """
    whole, n = int(samples), command.size
    late = samples - whole
    first = 0
    while first < n:
        end = first + 1
        while end < n and marks[end] != _START:
            end += 1
        known = min(first + whole + 1, end)
        out[first:known] = command[first]
        came, to = command[known - whole - 1 : end - whole], out[known:end]
        for k in range(to.size):
            to[k] = came[k + 1] + late * (came[k] - came[k + 1])
        first = end
