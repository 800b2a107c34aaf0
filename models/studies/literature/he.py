"""The models of He and Wang, a residual force and no moving state: of 2007 (with Pottmann and Qin)
with two parameters, of 2010 and 2014 with an overshoot factor."""

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


def _run_he2(op: Floats, q: Floats, interval_s: float, y0: float, out: Floats) -> None:
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
        "J, whose size depends on the sampling interval.",
        "Said to fail ramp and step tests in the style of ISA-75.25 (from memory).",
    ),
    run=_run_he2,
    relation=not_above_breakaway,
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


def _run_he3(op: Floats, q: Floats, interval_s: float, y0: float, out: Floats) -> None:
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
        "Those of he2.",
        "That K of about 1.99 is an undamped spring is quoted from memory.",
    ),
    run=_run_he3,
    relation=not_above_breakaway,
)
