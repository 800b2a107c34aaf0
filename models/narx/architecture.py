"""Constants of the network's form, and the stick-slip element that one may start from.

The equation is in ``network``. The constants are a module of their own, so that the modules that
run, train and store networks need not import one another.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

FORMAT_VERSION = 2  # of stored networks; 1 had neither c nor an actuator
LAGS = MappingProxyType({"op": 2, "mv": 2})  # u(t), u(t-1); y(t-1), y(t-2)
INPUTS = 4
EDGE = 0.01  # of sd: a smaller change counts as rest
SCALING = ("op_centre", "mv_centre", "gain", "error_scale", "change_scale")
RANGES = ("op", "mv", "error", "change", "drift")
# Parameters of the actuator before the network (``actuator.actuator_output``), and an actuator
# without any effect.
ACTUATOR = (
    "dead_time_s",
    "lag_up_s",
    "lag_down_s",
    "slow_up_s_per_percent",
    "slow_down_s_per_percent",
)
NO_ACTUATOR = MappingProxyType(dict.fromkeys(ACTUATOR, 0.0))
ELEMENT_UNITS = 5  # hidden units that a stick-slip element needs


@dataclass(frozen=True, kw_only=True)
class StickSlipStart:
    """The stick-slip element that some of a valve's networks start from: then they are grey-box.

    ``S`` and ``J`` in percent of OP; the stem moves ``gain`` units of MV per percent and reads
    ``zero`` (MV's unit) where it is at 0 %. ``actuator`` as in ``NarxNetwork``. ``goes_on``: a
    moving stem moves on while the command does, as in the canonical element; otherwise it sticks
    after every sample. Raises ``ValueError`` on numbers that no valve has.
    """

    S: float
    J: float
    zero: float = 0.0
    gain: float = 1.0
    actuator: Mapping[str, float] = field(default_factory=lambda: NO_ACTUATOR)
    goes_on: bool = True

    def __post_init__(self) -> None:
        numbers = [self.S, self.J, self.zero, self.gain, *self.actuator.values()]
        if set(self.actuator) != set(ACTUATOR):
            raise ValueError(f"actuator: {sorted(ACTUATOR)} expected, received {[*self.actuator]}")
        if not np.all(np.isfinite(numbers)) or min(self.S, self.J, *self.actuator.values()) < 0:
            raise ValueError(f"S, J and actuator finite and at least 0 expected: {self}")
        if self.gain == 0:
            raise ValueError("gain: a stem that the command does not move is no start; received 0")
