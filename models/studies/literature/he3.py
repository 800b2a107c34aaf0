"""He and Wang (2010, 2014): the two-parameter model with an overshoot factor."""

from __future__ import annotations

from stemwatch.models.compiled import compiled
from stemwatch.models.recording import Floats
from stemwatch.models.studies.literature.model import KernelModel, Parameter
from stemwatch.models.studies.literature.shared_parameters import (
    UNREAD,
    breakaway,
    not_above_breakaway,
    sliding,
)


@compiled()
def run_he3(op: Floats, fs: float, fd: float, K: float, y0: float, out: Floats) -> None:
    """Free run over ``op`` (n,) from ``y0`` into ``out`` (n,), percent."""
    y, force = y0, op[0] - y0
    out[0] = y
    for k in range(1, op.size):
        force += op[k] - op[k - 1]
        if abs(force) > fs:
            y += K * (force - (fd if force > 0.0 else -fd))
            force = op[k] - y
        out[k] = y


def _run(op: Floats, q: Floats, interval_s: float, y0: float, out: Floats) -> None:
    run_he3(op, q[0], q[1], q[2], y0, out)


HE3 = KernelModel(
    name="he3",
    source=f"He and Wang, the semi-physical three-parameter model (2010, 2014); {UNREAD}.",
    parameters=(
        breakaway(),
        sliding(),
        Parameter(
            name="K",
            unit="",
            lower=0.5,
            upper=2.0,
            default=1.0,
            meaning="overshoot factor of a slip: 1 none, about 1.99 an undamped spring",
        ),
    ),
    text=(
        "e[k] = e[k-1] + u[k] - u[k-1]. Where |e| > fs the stem slips by K (e - sign(e) fd) and "
        "e = u - y; elsewhere it stays."
    ),
    limits=(
        "With K = 1 it is he2 and shares its limits.",
        "That K of about 1.99 is an undamped spring is quoted from memory.",
    ),
    run=_run,
    relation=not_above_breakaway,
)
