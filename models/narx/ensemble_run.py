"""Running an ensemble over a record: plan, kernel, and back to MV's unit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.narx.actuator import actuator_output
from stemwatch.models.narx.architecture import EDGE
from stemwatch.models.narx.kernel import free_run
from stemwatch.models.narx.run_plan import CODES, Plan, plan_run
from stemwatch.models.narx.scaling import believable, limits, scale
from stemwatch.models.recording import Bools, Floats


class Ensemble(Protocol):
    """The part of ``NarxNetwork`` that a run needs; see there for formulas and units."""

    @property
    def members(self) -> int:
        """How many networks take part."""
        ...

    @property
    def hidden_units(self) -> int:
        """Hidden units of each network."""
        ...

    @property
    def weights(self) -> Mapping[str, NDArray[np.float64]]:
        """Arrays "hidden", "gate" and "value", one row for each member."""
        ...

    @property
    def scaling(self) -> Mapping[str, float]:
        """The scales of error and change, centres and gain."""
        ...

    @property
    def ranges(self) -> Mapping[str, tuple[float, float]]:
        """Lowest and highest value in training, by signal."""
        ...

    @property
    def actuator(self) -> Mapping[str, float]:
        """The actuator's parameters, applied to OP before the network."""
        ...

    @property
    def interval_s(self) -> float:
        """Seconds between samples."""
        ...


def run(
    network: Ensemble,
    op: Floats,
    y0: float | Floats,
    usable: Bools | None,
    horizon: int | None,
) -> Floats:
    """(n,) simulated MV, in its unit, with the checks and restarts of ``NarxNetwork.free_run``."""
    op, mv = np.asarray(op, dtype=np.float64), np.asarray(y0, dtype=np.float64)
    single = mv.ndim == 0
    mv = np.full(op.shape, mv) if single else mv
    if op.ndim != 1 or op.shape != mv.shape:
        raise ValueError(f"op and MV of one length expected, received {op.shape} and {mv.shape}")
    usable = usable_samples(op, mv, usable)
    if single and (horizon is not None or not usable.all()):
        raise ValueError(
            f"{int(np.sum(~usable))} of {op.size} samples are unusable or a horizon was asked for, "
            "and after those the run must start again from a measurement: give the measured MV "
            "instead of one opening"
        )
    op, mv = (np.where(usable, signal, np.nan) for signal in (op, mv))
    return run_plan(network, op, mv, plan_run(usable, horizon))


def usable_samples(op: Floats, mv: Floats, usable: Bools | None) -> Bools:
    """(n,) True where ``usable`` is (``None``: everywhere) and both values are plausible
    readings.
    """
    usable = np.ones(op.shape, dtype=np.bool_) if usable is None else np.asarray(usable, np.bool_)
    if usable.shape != op.shape:
        raise ValueError(f"usable of shape {op.shape} expected, received {usable.shape}")
    return believable(op, mv, usable)


def run_plan(network: Ensemble, op: Floats, mv: Floats, plan: Plan) -> Floats:
    """(n,) mean over the members of the run that ``plan`` describes, in MV's unit."""
    command = actuator_output(op, network.interval_s, network.actuator)
    signals = scale(command, mv, network.scaling, network.ranges)
    weights = flat_weights(network)
    out = np.full((network.members, op.size), np.nan)
    free_run(
        weights,
        network.hidden_units,
        signals.level,
        signals.move,
        signals.position,
        plan,
        CODES,
        limits(network.ranges, network.scaling),
        network.scaling["error_scale"] / network.scaling["change_scale"],
        EDGE,
        out,
    )
    scaled = np.mean(out, axis=0)
    return np.asarray(network.scaling["mv_centre"] + network.scaling["error_scale"] * scaled)


def flat_weights(network: Ensemble) -> Floats:
    """(m, p) weights in the order of the kernel: value, gate, hidden."""
    hidden = network.weights["hidden"].reshape(network.members, -1)
    return np.concatenate([network.weights["value"], network.weights["gate"], hidden], axis=1)
