"""Chen, Tan and Huang (2008): the two-layer binary tree."""

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
def run_chen(op: Floats, fs: float, fd: float, y0: float, out: Floats) -> None:
    """Free run over ``op`` (n,) from ``y0`` into ``out`` (n,), percent."""
    y, moving, d = y0, False, 1.0
    out[0] = y
    # A stem that moved is at u[k-1] - d fd. So d (u - y) > max(fd, 0), the condition to move on, is
    # d (u[k] - u[k-1]) > max(0, -fd); written out it is a matter of rounding on repeated samples.
    ahead = max(0.0, -fd)
    for k in range(1, op.size):
        force = op[k] - y
        if moving and d * (op[k] - op[k - 1]) > ahead:
            y = op[k] - d * fd
        elif abs(force) > fs:
            moving, d = True, 1.0 if force > 0.0 else -1.0
            y = op[k] - d * fd
        else:
            moving = False
        out[k] = y


def _run(op: Floats, q: Floats, interval_s: float, y0: float, out: Floats) -> None:
    run_chen(op, q[0], q[1], y0, out)


CHEN_TREE = KernelModel(
    name="chen_tree",
    source=(
        "Chen, Tan and Huang, Two-layer binary tree data-driven model for valve stiction, Ind. "
        f"Eng. Chem. Res. 47 (2008); {UNREAD}, with medium to low confidence: a reconstruction, "
        "not to be presented as the original."
    ),
    parameters=(breakaway(), sliding()),
    text=(
        "First layer: did the stem move in the sample before? Second layer: a moving stem goes on "
        "while the force keeps its direction and |u - y| > fd, a resting one lets go when "
        "|u - y| > fs; either then follows y = u - d fd."
    ),
    limits=(
        "Li et al. (2015) state that the original mishandles instantaneous commands on reverse "
        "motion (from their abstract); this reconstruction does not, and so probably differs.",
    ),
    run=_run,
    relation=not_above_breakaway,
)
