"""The gated-increment NARX network of one valve: its arrays, its scaling, its ranges.

::

    x    = [ (v(t) - y(t-1)) / se , (v(t) - v(t-1)) / sd , (y(t-1) - y(t-2)) / sd , c(t) ]
    c(t) = (tanh((v(t) - v(t-1)) / (edge sd)) + tanh((y(t-1) - y(t-2)) / (edge sd))) / 2
    h    = tanh(W x + b)
    y(t) = y(t-1) + se sigmoid(wg.h + bg) (wv.h + c.x + bv)

``y`` is MV and ``v`` is OP on MV's scale, ``v = mv_centre + gain (OP - op_centre)``, after the
actuator's dead time, lag and speed limit where a fit found them; ``c`` is 1 where command and stem
both go up, -1 where both go down, and ``edge`` = 0.01. So ``y(t) = f(y(t-1), y(t-2), u(t),
u(t-1))``: a static function of its lags, with nothing else carried over. ``u(t)``, the command at
the same sample as the response, is one of them. The gate is needed because a stuck stem does not
move *at all*; a linear output leaks while the valve is stuck.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.narx.architecture import (
    ACTUATOR,
    FORMAT_VERSION,
    INPUTS,
    LAGS,
    NO_ACTUATOR,
    RANGES,
    SCALING,
)
from stemwatch.models.recording import Bools, Floats


@dataclass(frozen=True, kw_only=True)
class NarxNetwork:
    """A trained ensemble as plain arrays: it can be stored, loaded and run without torch.

    ``weights``, for ``m`` members of ``h`` hidden units: ``hidden`` (m, h, 5) the rows ``[W, b]``;
    ``gate`` (m, h + 1) ``[wg, bg]``; ``value`` (m, h + 5) ``[wv, c, bv]``. The output of the
    ensemble is the mean over its members, each run on its own.

    ``scaling``: ``op_centre`` in percent, ``mv_centre`` and ``error_scale`` (``se``) and
    ``change_scale`` (``sd``) in MV's unit, ``gain`` in MV's unit per percent. ``ranges`` are the
    lowest and highest value in the training part of ``op`` in percent and, in MV's unit, of ``mv``,
    ``error`` = v(t) - y(t-1), ``change`` = v(t) - v(t-1) and ``drift`` = y(t) - y(t-1); a run is
    clamped to them with a margin. Those of ``error`` and ``drift`` are wider where members started
    from a stick-slip element. ``actuator``: dead time, lags and speed limits applied to OP before
    the network, see ``actuator.actuator_output``; all 0 is none. ``reference_rmse`` (MV's unit) is
    the run's error on the whole record the network comes from, restarted every
    ``reference_horizon`` samples.

    Raises ``ValueError`` where array shapes do not agree, a name is missing, or a number is not
    finite.
    """

    weights: Mapping[str, NDArray[np.float64]]
    scaling: Mapping[str, float]
    ranges: Mapping[str, tuple[float, float]]
    interval_s: float
    reference_rmse: float
    reference_horizon: int = 100
    actuator: Mapping[str, float] = field(default_factory=lambda: NO_ACTUATOR)
    lags: Mapping[str, int] = field(default_factory=lambda: LAGS)
    seed: int = 0
    format_version: int = FORMAT_VERSION

    def __post_init__(self) -> None:
        for name, expected in (("scaling", SCALING), ("ranges", RANGES), ("actuator", ACTUATOR)):
            _expect_names(name, getattr(self, name), expected)
        if dict(self.lags) != dict(LAGS):
            raise ValueError(f"lags {dict(LAGS)} expected, received {dict(self.lags)}")
        weights = _checked_weights(self.weights)
        numbers = [
            *self.scaling.values(),
            *self.actuator.values(),
            self.interval_s,
            self.reference_rmse,
        ]
        numbers += [bound for pair in self.ranges.values() for bound in pair]
        if not np.all(np.isfinite(numbers)):
            raise ValueError(f"finite scaling, ranges, interval and reference expected: {numbers}")
        scales = (self.scaling["error_scale"], self.scaling["change_scale"], self.interval_s)
        if min(*scales, self.reference_rmse) <= 0 or self.reference_horizon < 1:
            raise ValueError(
                "scales, interval_s, reference_rmse and reference_horizon above 0 expected, "
                f"received {scales}, {self.reference_rmse} and {self.reference_horizon}"
            )
        object.__setattr__(self, "weights", MappingProxyType(weights))

    def __reduce__(self) -> tuple[object, ...]:
        # A mapping proxy cannot be pickled, and screenings travel between worker processes.
        return (NarxNetwork.from_bytes, (self.to_bytes(),))

    @property
    def members(self) -> int:
        """How many networks the ensemble has."""
        return int(self.weights["gate"].shape[0])

    @property
    def hidden_units(self) -> int:
        """Hidden units of each of its networks."""
        return int(self.weights["gate"].shape[1]) - 1

    def free_run(
        self,
        op: Floats,
        y0: float | Floats,
        usable: Bools | None = None,
        *,
        horizon: int | None = None,
    ) -> Floats:
        """The ensemble fed its own output: (n,) simulated MV, in MV's unit.

        ``op`` (n,) percent. ``y0`` is one opening to start from, or the measured MV (n,), of which
        only the two samples before a (re)start are used. The run starts again from the measurement
        after every unusable sample and, with ``horizon``, after so many samples. ``usable`` (n,)
        defaults to all; what is not a number, or 1e15 and more, never is. NaN at unusable samples;
        the two samples a run starts from are the measured ones.

        Raises ``ValueError`` on unequal lengths, a horizon below 1, or gaps without a measured MV
        to start from again.
        """
        from stemwatch.models.narx.ensemble_run import run

        return run(self, op, y0, usable, horizon)

    def one_step(self, op: Floats, mv: Floats, usable: Bools | None = None) -> Floats:
        """The ensemble fed the measured MV at every sample: (n,), as ``free_run``."""
        return self.free_run(op, mv, usable, horizon=1)

    def in_seconds(self, unit_s: float) -> NarxNetwork:
        """The same network, trained on a clock with units of ``unit_s`` seconds, in seconds."""
        actuator = {name: unit_s * value for name, value in self.actuator.items()}
        return replace(self, interval_s=unit_s * self.interval_s, actuator=actuator)

    def to_bytes(self) -> bytes:
        """The network as safetensors bytes; ``from_bytes`` gives back the same bits."""
        from stemwatch.models.narx.storage import pack

        facts = {
            "format_version": self.format_version,
            "scaling": dict(self.scaling),
            "ranges": {name: list(pair) for name, pair in self.ranges.items()},
            "actuator": dict(self.actuator),
            "lags": dict(self.lags),
            "interval_s": self.interval_s,
            "reference_rmse": self.reference_rmse,
            "reference_horizon": self.reference_horizon,
            "seed": self.seed,
        }
        return pack(facts, self.weights)

    @classmethod
    def from_bytes(cls, data: bytes) -> NarxNetwork:
        """The network that ``to_bytes`` packed; ``ValueError`` on damage or an unknown version."""
        from stemwatch.models.narx.storage import unpack

        facts, weights = unpack(data)
        return cls(weights=weights, **facts)


def _expect_names(label: str, received: Mapping[str, object], expected: tuple[str, ...]) -> None:
    if set(received) != set(expected):
        raise ValueError(f"{label}: {sorted(expected)} expected, received {sorted(received)}")


def _checked_weights(weights: Mapping[str, NDArray[np.float64]]) -> dict[str, Floats]:
    """Own, read-only, contiguous copies, after checking that they belong together."""
    _expect_names("weights", weights, ("hidden", "gate", "value"))
    copies = {name: np.array(array, dtype=np.float64) for name, array in weights.items()}
    shapes = {name: array.shape for name, array in copies.items()}
    members, hidden = shapes["hidden"][:1], (shapes["hidden"] + (0, 0))[1]
    expected = {
        "hidden": (*members, hidden, INPUTS + 1),
        "gate": (*members, hidden + 1),
        "value": (*members, hidden + INPUTS + 1),
    }
    if shapes != expected or not copies["gate"].size or not hidden:
        raise ValueError(f"weights of shapes {expected} expected, received {shapes}")
    if not all(np.all(np.isfinite(array)) for array in copies.values()):
        raise ValueError("finite weights expected, received some that are not")
    for array in copies.values():
        array.flags.writeable = False
    return copies
