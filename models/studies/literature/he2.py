"""He, Wang, Pottmann and Qin (2007): a residual force, and no moving state."""

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
def run_he2(op: Floats, fs: float, fd: float, y0: float, out: Floats) -> None:
    """Free run over ``op`` (n,) from ``y0`` into ``out`` (n,), percent."""
    y, force = y0, op[0] - y0
    out[0] = y
    for k in range(1, op.size):
        force += op[k] - op[k - 1]
        if abs(force) > fs:
            force = fd if force > 0.0 else -fd
            y = op[k] - force
        out[k] = y


def _run(op: Floats, q: Floats, interval_s: float, y0: float, out: Floats) -> None:
    run_he2(op, q[0], q[1], y0, out)


HE2 = KernelModel(
    name="he2",
    source=(
        "He, Wang, Pottmann and Qin, A curve fitting method for detecting valve stiction in "
        "oscillating control loops, Ind. Eng. Chem. Res. 46 (2007) 4549-4560, "
        f"doi:10.1021/ie061219a; {UNREAD}, and the flow agrees with published code."
    ),
    parameters=(breakaway(), sliding()),
    text=(
        "e[k] = r[k-1] + u[k] - u[k-1]. Where |e| > fs the stem slips to y = u - sign(e) fd and "
        "r = sign(e) fd; elsewhere it stays and r = e."
    ),
    limits=(
        "The stem sticks again at every sample: a ramp becomes a staircase with steps of at least "
        "J, whose size depends on the sampling interval. It is the canonical element with "
        "'always re-stick'.",
        "Said to fail ramp and step tests in the style of ISA-75.25 (from memory).",
    ),
    run=_run,
    relation=not_above_breakaway,
)
