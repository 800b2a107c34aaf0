"""S by the network and by how well the element predicts with it.

The network that reads the numbers of ``features`` says s = ln(S/amplitude) with a spread; on
loops of another kind than it was trained on it leans towards what is usual. How the held-out error
falls with S does not. The estimate is the mean of

    p(s) ~ exp(-(s - m)^2/(2 d^2) + WEIGHT G(s)),   |s - m| <= REACH

with m and d of the network and G the gain ln(linear/with the element), averaged over both models
and both scales. The number of samples does not count: the errors that are left are mostly the
models' own, not chance.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from stemwatch.models.recording import Floats
from stemwatch.models.without_position.features import Evidence

WEIGHT = 4.0
REACH = 0.4  # farther away the element has other minima, near half of S and twice of it
_VALUES = 41


def weighed_log_S(loop_evidence: Evidence, log_S: float, spread: float) -> float:
    """ln(S/amplitude) by ``log_S`` and ``spread`` of the network and by the element's gains."""
    shares = np.log(loop_evidence.sizes / loop_evidence.amplitude)
    tried = log_S + np.linspace(-REACH, REACH, _VALUES)
    gain: Floats = np.zeros(_VALUES)
    for scale in (loop_evidence.coarse, loop_evidence.fine):
        of_models = CubicSpline(shares, 0.5 * (scale.curve + scale.curve_of_both))
        gain += 0.5 * of_models(np.clip(tried, shares[0], shares[-1]))
    logarithm = WEIGHT * gain - 0.5 * ((tried - log_S) / spread) ** 2
    weights = np.exp(logarithm - logarithm.max())
    return float(weights @ tried / weights.sum())
