"""Xie, Cong and Horch (2013): He's force balance with a moving flag."""

from __future__ import annotations

from stemwatch.models.compiled import compiled
from stemwatch.models.recording import Floats
from stemwatch.models.studies.literature.model import KernelModel
from stemwatch.models.studies.literature.shared_parameters import (
    UNREAD,
    breakaway,
    not_above_breakaway,
    sliding,
)


@compiled()
def run_xch(op: Floats, fs: float, fd: float, y0: float, out: Floats) -> None:
    """Free run over ``op`` (n,) from ``y0`` into ``out`` (n,), percent."""
    y, moving, d = y0, False, 0.0
    out[0] = y
    for k in range(1, op.size):
        force = op[k] - y
        if moving and (op[k] - op[k - 1]) * d <= 0.0:
            moving = False
        if not moving and abs(force) > fs:
            moving, d = True, 1.0 if force > 0.0 else -1.0
            y = op[k] - d * fd
        elif moving and d * force > fd:
            y = op[k] - d * fd
        out[k] = y


def _run(op: Floats, q: Floats, interval_s: float, y0: float, out: Floats) -> None:
    run_xch(op, q[0], q[1], y0, out)


XCH = KernelModel(
    name="xch",
    source=(
        "Xie, Cong and Horch, An improved valve stiction simulation model based on ISA standard "
        f"tests, Control Engineering Practice 21 (2013); {UNREAD}, with low confidence in the "
        "details: a reconstruction."
    ),
    parameters=(breakaway(), sliding()),
    text=(
        "A moving stem follows y = u - d fd while the input keeps the direction d and "
        "d (u - y) > fd; a resting one lets go when |u - y| > fs."
    ),
    limits=(
        "The original may differ: this reconstruction is the canonical element on every signal "
        "tried, with its weakness for repeated samples (A3).",
    ),
    run=_run,
    relation=not_above_breakaway,
)
