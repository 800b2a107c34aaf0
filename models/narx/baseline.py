"""How well a valve still follows the network that was trained on it: the health indicator."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stemwatch.models.narx.ensemble_run import run_plan
from stemwatch.models.narx.network import NarxNetwork
from stemwatch.models.narx.run_plan import PlanStep, plan_run
from stemwatch.models.narx.scaling import believable
from stemwatch.models.recording import Bools, Floats

_LEAST_SCORED = 100
_SAME_INTERVAL = 0.01
_RANGE_MARGIN = 0.1  # of OP's training range, on either side
_MOST_OUTSIDE = 0.25


@dataclass(frozen=True, kw_only=True)
class BaselineScore:
    """The free run's error on a new record, or ``None`` and the reason why there is none.

    ``rmse`` in MV's unit; ``ratio`` = rmse / the network's ``reference_rmse``: 1.2 to 1.62 for a
    valve that had not changed, 2.1 and more where stiction grew (46 simulated records, free runs of
    100 samples); ``Limits.baseline_ratio_watch`` lies between. It shows that the valve changed, not
    that it sticks. ``samples`` were scored; ``outside_share`` of the usable ones had an OP outside
    the training range and were left out.
    """

    rmse: float | None = None
    ratio: float | None = None
    reason: str | None = None
    samples: int = 0
    outside_share: float = 0.0


def score_baseline(
    network: NarxNetwork,
    op: Floats,
    mv: Floats,
    usable: Bools,
    *,
    interval_s: float,
    horizon: int | None = None,
) -> BaselineScore:
    """Free run over ``op`` (n,) percent, restarted from ``mv`` (n,) every ``horizon`` samples.

    ``horizon`` defaults to the network's ``reference_horizon`` (100). Errors over other lengths
    cannot be compared with the reference and give an rmse without a ratio. Refuses, with a reason,
    where ``interval_s`` is not the network's, where OP leaves the range the network was trained on
    for more than a quarter of the samples, and where fewer than 100 samples can be scored. Raises
    ``ValueError`` on arrays of different lengths and a horizon below 1.
    """
    op, mv, usable = _checked(op, mv, usable)
    if not abs(interval_s - network.interval_s) <= _SAME_INTERVAL * network.interval_s:
        return BaselineScore(
            reason=f"the baseline network was trained at one sample every {network.interval_s:g} "
            f"s and this record has one every {interval_s:g} s; read the record at the "
            "network's interval or train a new baseline"
        )
    usable = believable(op, mv, usable)
    in_range = usable & _in_trained_range(network, op)
    outside_share = 1.0 - in_range.sum() / usable.sum() if usable.any() else 0.0
    plan = plan_run(in_range, horizon or network.reference_horizon)
    scored = plan >= PlanStep.RUN
    samples = int(scored.sum())
    reason = _objection(network, samples, float(outside_share))
    if reason is not None:
        return BaselineScore(reason=reason, samples=samples, outside_share=float(outside_share))
    known_op, known_mv = (np.where(in_range, signal, np.nan) for signal in (op, mv))
    simulated = run_plan(network, known_op, known_mv, plan)
    rmse = float(np.sqrt(np.mean((simulated[scored] - mv[scored]) ** 2)))
    comparable = horizon in (None, network.reference_horizon)
    return BaselineScore(
        rmse=rmse,
        ratio=rmse / network.reference_rmse if comparable else None,
        samples=samples,
        outside_share=float(outside_share),
    )


def _checked(op: Floats, mv: Floats, usable: Bools) -> tuple[Floats, Floats, Bools]:
    op, mv = np.asarray(op, dtype=np.float64), np.asarray(mv, dtype=np.float64)
    usable = np.asarray(usable, dtype=np.bool_)
    if op.ndim != 1 or not op.shape == mv.shape == usable.shape:
        raise ValueError(
            f"op, mv and usable of one length expected, received {op.shape}, {mv.shape} and "
            f"{usable.shape}"
        )
    return op, mv, usable


def _in_trained_range(network: NarxNetwork, op: Floats) -> Bools:
    low, high = network.ranges["op"]
    margin = _RANGE_MARGIN * (high - low)
    with np.errstate(invalid="ignore"):
        return np.asarray((op >= low - margin) & (op <= high + margin))


def _objection(network: NarxNetwork, samples: int, outside_share: float) -> str | None:
    if outside_share > _MOST_OUTSIDE:
        low, high = network.ranges["op"]
        return (
            f"OP is outside the range the baseline network was trained on, {low:.1f} to "
            f"{high:.1f} %, in {100 * outside_share:.0f} % of the samples; what the network says "
            "there is a guess: train a new baseline on a record that covers this operation"
        )
    if samples < _LEAST_SCORED:
        return (
            f"too few usable samples to score: {samples} with two usable ones before them, "
            f"at least {_LEAST_SCORED} needed; take a longer window"
        )
    return None
