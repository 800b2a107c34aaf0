"""The four cases of the paper, what it published of them, and the element that makes the data."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stemwatch.models.recording import Floats
from stemwatch.models.stickslip import kernel
from stemwatch.models.verdict import Shape

# The paper gives neither S, J, amplitude nor sampling. These S and J, for a sine of amplitude 1,
# show each shape clearly; the errors of static maps are then about two thirds of the paper's.
AMPLITUDE = 1.0
SAMPLES_PER_PERIOD = 150
PERIODS = 4  # after a first one, in which the initial state decays; all are alike
INTERVAL_S = 1.0


@dataclass(frozen=True, kw_only=True)
class Published:
    """The paper's figures for one network: RMSE, and CDC in percent where it gives a number."""

    rmse: float
    cdc_percent: float | None


@dataclass(frozen=True, kw_only=True)
class PaperCase:
    """One shape: ``S`` and ``J`` in units of the sine's amplitude, and the paper's two results."""

    shape: Shape
    S: float
    J: float
    feedforward: Published
    narx: Published

    def respond(self, u: Floats) -> Floats:
        """(n,) stem position for the input ``u`` (n,), from rest as near to 0 as the band allows.

        The canonical element of ``stickslip.kernel``, without actuator: Choudhury's two-parameter
        model in the reading that equals Kano's. One sample is one step; nothing lies in between.
        """
        u = np.ascontiguousarray(u, dtype=np.float64)
        start = np.zeros(u.size, dtype=np.uint8)
        start[0] = kernel.START
        q = np.array([self.S, self.J, 0.0, 0.0, 0.0, np.inf, np.inf, 0.0, 1.0, 0.0])
        out = np.empty(u.size)
        kernel.simulate(u, np.zeros(u.size), start, INTERVAL_S, q, out)
        return out


CASES = (
    PaperCase(
        shape=Shape.DEADBAND,
        S=0.5,
        J=0.0,
        feedforward=Published(rmse=0.2336, cdc_percent=None),
        narx=Published(rmse=0.0869, cdc_percent=None),
    ),
    PaperCase(
        shape=Shape.UNDERSHOOT,
        S=0.6,
        J=0.3,
        feedforward=Published(rmse=0.1990, cdc_percent=61.0),
        narx=Published(rmse=0.0907, cdc_percent=59.0),
    ),
    PaperCase(
        shape=Shape.NO_OFFSET,
        S=0.5,
        J=0.5,
        feedforward=Published(rmse=0.1793, cdc_percent=62.0),
        narx=Published(rmse=0.1262, cdc_percent=62.0),
    ),
    PaperCase(
        shape=Shape.OVERSHOOT,
        S=0.4,
        J=0.6,
        feedforward=Published(rmse=0.2179, cdc_percent=None),
        narx=Published(rmse=0.1428, cdc_percent=None),
    ),
)
