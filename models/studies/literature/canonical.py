"""The canonical element: the product's own kernel as a ``ValveModel``."""

from __future__ import annotations

import numpy as np

from stemwatch.models.recording import Floats
from stemwatch.models.stickslip import kernel
from stemwatch.models.studies.literature.model import KernelModel
from stemwatch.models.studies.literature.shared_parameters import band, jump


def _run(op: Floats, q: Floats, interval_s: float, y0: float, out: Floats) -> None:
    marks = np.zeros(op.size, dtype=np.uint8)
    marks[0] = kernel.START
    chosen = np.zeros(kernel.N_PARAMETERS)
    chosen[kernel.S], chosen[kernel.J] = q
    chosen[kernel.RATE_UP] = chosen[kernel.RATE_DOWN] = np.inf
    chosen[kernel.GAIN] = 1.0
    kernel.simulate(op, np.full(op.size, y0), marks, interval_s, chosen, out)


CANONICAL = KernelModel(
    name="canonical",
    source=(
        "The reading of the two-parameter model of Choudhury, Thornhill and Shah (2005) that this "
        "product reports S and J by; identical to Kano's model, which was checked numerically."
    ),
    parameters=(band(), jump()),
    text=(
        "fs = (S + J)/2, fd = (S - J)/2. A resting stem lets go when |u - y| > fs, in the "
        "direction d of u - y; a moving one follows y = u - d fd and rests again when "
        "d (u[k] - u[k-1]) <= 0."
    ),
    limits=(
        "One repeated input sample stops the stem, which then needs a further J: a coarsely "
        "recorded command looks like sticking (A3, A10).",
        "J above S is an overshoot: without inertia no Coulomb friction produces it (A5).",
        "A first position further from the command than fs is moved to the edge of that band.",
    ),
    run=_run,
)
