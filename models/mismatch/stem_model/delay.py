"""A command that arrives later."""

from __future__ import annotations

from stemwatch.models.compiled import compiled
from stemwatch.models.recording import Floats
from stemwatch.models.stickslip.kernel import Marks

_START = 1
_CHUNK = 64


@compiled()
def _next_start(marks: Marks, k: int) -> int:
    """The first START from ``k`` on, or the end; searched in chunks, so that the compiler uses
    vector instructions.
    """
    n = marks.size
    while k + _CHUNK <= n:
        starts = 0
        for mark in marks[k : k + _CHUNK]:
            starts += mark == _START
        if starts > 0:
            break
        k += _CHUNK
    while k < n and marks[k] != _START:
        k += 1
    return k


@compiled()
def delayed(command: Floats, marks: Marks, samples: float, out: Floats) -> None:
    """``command`` (n,) later by a delay in samples into ``out`` (n,), another array, percent.

    Linear between samples. The command before a START is not known and is taken as constant.
    """
    whole_samples, n = int(samples), command.size
    late = samples - whole_samples
    first = 0
    while first < n:
        end = _next_start(marks, first + 1)
        first_known = min(first + whole_samples + 1, end)
        out[first:first_known] = command[first]
        came, target = (
            command[first_known - whole_samples - 1 : end - whole_samples],
            out[first_known:end],
        )
        for k in range(target.size):
            target[k] = came[k + 1] + late * (came[k] - came[k + 1])
        first = end
