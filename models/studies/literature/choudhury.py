"""Choudhury, Thornhill and Shah (2005): the flow chart in the two ways in which it is read.

The flow chart is quoted from memory; it is a reconstruction at the level of the text. The readings
differ in one place, the moment at which ``xss``, the input at which the stem stopped, is set: *as
drawn* at every change of the sign of the input's step, *as the text says* only when a moving stem
stops. The names of the defects, A1 to A10, are those of docs/models.md.
"""

from __future__ import annotations

import numpy as np

from stemwatch.models.compiled import compiled
from stemwatch.models.recording import Floats
from stemwatch.models.studies.literature.model import KernelModel
from stemwatch.models.studies.literature.shared_parameters import UNREAD, band, jump


@compiled()
def run_choudhury(op: Floats, S: float, J: float, y0: float, as_drawn: bool, out: Floats) -> None:
    """Free run over ``op`` (n,) from ``y0`` into ``out`` (n,), percent."""
    fd = 0.5 * (S - J)
    y = y0
    xss, threshold, stuck, before = op[0], S, True, 0.0
    out[0] = y
    for k in range(1, op.size):
        u = op[k]
        v = np.sign(u - op[k - 1])
        if u <= 0.0 or u >= 100.0:
            y = min(max(u, 0.0), 100.0)
            stuck, xss, threshold = True, u, S
        else:
            if v != before or v == 0.0:
                if as_drawn or not stuck:
                    xss = op[k - 1]
                if v == 0.0:
                    # A stem at rest that goes on in the same direction needs J only.
                    threshold = threshold if stuck else J
                elif before != 0.0:
                    threshold = S
                stuck = True
            if v != 0.0 and (not stuck or abs(u - xss) > threshold):
                if stuck:
                    stuck, threshold = False, S
                y = u - v * fd
        before = v
        out[k] = y


def _text(op: Floats, q: Floats, interval_s: float, y0: float, out: Floats) -> None:
    run_choudhury(op, q[0], q[1], y0, False, out)


def _simulate(op: Floats, q: Floats, interval_s: float, y0: float, out: Floats) -> None:
    run_choudhury(op, q[0], q[1], y0, True, out)


_SOURCE = (
    "Choudhury, Thornhill and Shah, Modelling valve stiction, Control Engineering Practice 13 "
    f"(2005) 641-658, doi:10.1016/j.conengprac.2004.05.005; {UNREAD}."
)
_FLOW = (
    "v = sign(x[k] - x[k-1]). The valve sticks where v is 0 or not what it was; x <= 0 and "
    "x >= 100 saturate it. It slips when |x - xss| > J after a stop with v = 0, > S after a "
    "reversal, and then follows y = x - v (S - J)/2. "
)
_SHARED_LIMITS = (
    "Thresholds without direction: a stem that stuck on the way up, dips and goes up again is "
    "asked for S, where the physics asks for J (A2).",
    "One repeated input sample makes a stop that did not happen, and a staircase (A3, A10).",
    "With noise the jump can land on the wrong side, an error of S - J (A4).",
    "J above S is an overshoot: without inertia no friction produces it (A5).",
    "Nothing before the first full slip counts (A6).",
    "At 0 and 100 % the stem is put where the command is (A7).",
)

CHOUDHURY_TEXT = KernelModel(
    name="choudhury_text",
    source=_SOURCE,
    parameters=(band(), jump()),
    text=_FLOW + "xss is the input at which a moving stem stopped.",
    limits=_SHARED_LIMITS,
    run=_text,
)
CHOUDHURY_AS_DRAWN = KernelModel(
    name="choudhury_as_drawn",
    source=_SOURCE,
    parameters=(band(), jump()),
    text=_FLOW + "xss is overwritten at every change of v, also while the valve is stuck.",
    limits=(
        "Noise on the input sets the accumulated force back again and again: not for plant data "
        "(A1).",
        *_SHARED_LIMITS,
    ),
    run=_simulate,
)
