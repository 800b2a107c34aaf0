"""Stenman, Gustafsson and Forsman (2003): one parameter; the stem stays or jumps all the way."""

from __future__ import annotations

from stemwatch.models.compiled import compiled
from stemwatch.models.recording import Floats
from stemwatch.models.studies.literature.model import KernelModel, Parameter
from stemwatch.models.studies.literature.shared_parameters import MOST, UNREAD


@compiled()
def run_stenman(op: Floats, d: float, y0: float, out: Floats) -> None:
    """Free run over ``op`` (n,) from ``y0`` into ``out`` (n,), percent."""
    y = y0
    out[0] = y
    for k in range(1, op.size):
        if abs(op[k] - y) > d:
            y = op[k]
        out[k] = y


def _run(op: Floats, q: Floats, interval_s: float, y0: float, out: Floats) -> None:
    run_stenman(op, q[0], y0, out)


STENMAN = KernelModel(
    name="stenman",
    source=(
        "Stenman, Gustafsson and Forsman, A segmentation-based method for detection of stiction in "
        "control valves, Int. J. Adapt. Control Signal Process. 17 (2003) 625-634; "
        f"{UNREAD}."
    ),
    parameters=(
        Parameter(
            name="d",
            unit="%",
            lower=0.0,
            upper=MOST,
            default=3.5,
            meaning="stick band: distance of the command at which the stem jumps to it",
            per_percent=1.0,
        ),
    ),
    text="y[k] = y[k-1] where |u[k] - y[k-1]| <= d, else y[k] = u[k].",
    limits=(
        "There is no kinetic friction, and no dead band: after each jump the stem is exactly where "
        "the command is.",
    ),
    run=_run,
)
