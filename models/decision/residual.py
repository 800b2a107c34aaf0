"""The residual of each model on held-out samples, to which it was not fitted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stemwatch.models.mismatch.findings import Finding, Mismatch
from stemwatch.models.narx.example import NarxFit
from stemwatch.models.narx.network import NarxNetwork
from stemwatch.models.recording import Floats, Recording
from stemwatch.models.screening_result import Residual
from stemwatch.models.stickslip.fit import StickSlipFit

FEWEST = 10  # samples needed for a residual
# Of what friction with the named effects leaves of unseen samples, the share that friction behind
# a slow actuator leaves where nothing else is needed. Of 13 simulated valves with a hidden effect
# (`draw_hidden(60, 4090)`, even places) it leaves 0.84 to 3.7 times as much; of a healthy valve
# in a loop that hunts every ten seconds, whose names were all wrong, 0.26.
NOTHING_ELSE = 0.5


@dataclass(frozen=True, kw_only=True)
class BaselineComparison:
    """The baseline network on a later window: residual and ratio, or the reason for none."""

    residual: Residual | None = None
    ratio: float | None = None
    reason: str = ""


def _heldout(fit: StickSlipFit, *, resynced: bool) -> tuple[Floats, Floats]:
    """Residual and MV on the scored samples that the model was not fitted to."""
    problem = fit.evaluator.problem
    late = problem.scored & (np.arange(problem.op.size) >= fit.first_heldout)
    return (problem.mv - fit.heldout(resynced=resynced))[late], problem.mv[late]


def of_stiction(fit: StickSlipFit, *, resynced: bool) -> Residual | None:
    """The model fitted to the first part, scored on the rest; ``None`` where MV rests there.

    ``resynced``: a resting stem is set to its reading at the start of each block, as in the fit.
    """
    error, mv = _heldout(fit, resynced=resynced)
    if error.size < FEWEST or float(np.std(mv)) == 0.0:
        return None
    rmse = float(np.sqrt(np.mean(error**2)))
    return Residual(rmse=rmse, normalised=rmse / float(np.std(mv)))


def better_of(stiction: Residual | None, mismatch: Mismatch | None) -> Residual | None:
    """The residual of the free run with the named effects where that is smaller, else
    ``stiction``."""
    if mismatch is None or not mismatch.effects or stiction is None:
        return stiction
    if mismatch.heldout.slip_by_slip:
        return stiction
    rmse, fit = mismatch.heldout.rmse_extended, mismatch.heldout.fit_extended
    if rmse is None or fit is None or rmse >= stiction.rmse:
        return stiction
    return Residual(rmse=rmse, normalised=1.0 - fit / 100.0)


def of_unknown(mismatch: Mismatch | None) -> Residual | None:
    """The free run of S and J on unseen samples where they leave something that has no name; else
    ``None``."""
    if mismatch is None or mismatch.finding is not Finding.UNKNOWN:
        return None
    rmse, fit = mismatch.heldout.rmse_naive, mismatch.heldout.fit_naive
    return None if rmse is None or fit is None else Residual(rmse=rmse, normalised=1.0 - fit / 100)


def slow_actuator_is_enough(fit: StickSlipFit, mismatch: Mismatch) -> bool:
    """Whether friction behind a slow actuator follows unseen samples so much better than what
    ``mismatch`` says that this is not needed."""
    unseen, heldout = of_stiction(fit, resynced=False), mismatch.heldout
    other = heldout.rmse_extended if mismatch.effects else heldout.rmse_naive
    asked = bool(mismatch.effects) or mismatch.finding is Finding.UNKNOWN
    if not asked or fit.hypothesis != "both" or heldout.slip_by_slip:
        return False
    if unseen is None or other is None:
        return False
    return unseen.rmse < NOTHING_ELSE * other


def curve_is_enough(fit: StickSlipFit) -> bool:
    """Whether a curve from OP to stroke a little different from the one found, without friction,
    follows the position as well as S does: what the curve is off by then looks like a dead band.
    Asked only where OP was read through a curve, and no breakaways show the friction.
    """
    problem = fit.evaluator.problem
    if not problem.unsure_degree or fit.breakaways is not None or fit.events.evident:
        return False
    scored = problem.scored
    op, mv = problem.op[scored], problem.mv[scored]
    other = np.polynomial.Polynomial.fit(op, mv, problem.unsure_degree)(op)
    off = mv - fit.evaluator.simulate(fit.candidate)[scored]
    return float(np.var(mv - other)) <= float(np.mean(off**2))


def typical_percent(fit: StickSlipFit) -> float:
    """100 (1 - median |residual| / median |MV - median MV|): slips that come late do not count."""
    error, mv = _heldout(fit, resynced=True)
    if error.size < FEWEST:
        return 0.0
    typical_move = float(np.median(np.abs(mv - np.median(mv))))
    return 100.0 * (1.0 - float(np.median(np.abs(error))) / max(typical_move, 1e-9))


def of_narx(network: NarxFit | None) -> Residual | None:
    """The network's free run on the held-out part."""
    if network is None or network.heldout is None:
        return None
    heldout = network.heldout
    return Residual(
        rmse=heldout.rmse, normalised=heldout.normalised, one_step=heldout.one_step_rmse
    )


def of_baseline(baseline: NarxNetwork | None, recording: Recording) -> BaselineComparison:
    """How the valve's baseline network follows this window, restarted every 100 samples."""
    if baseline is None or recording.mv is None:
        return BaselineComparison()
    from stemwatch.models.narx.baseline import score_baseline

    try:
        score = score_baseline(
            baseline,
            recording.op.values,
            recording.mv.values,
            recording.usable,
            interval_s=recording.interval_s,
        )
    # a damaged baseline must not prevent the verdict
    except (ValueError, ArithmeticError) as error:
        return BaselineComparison(reason=f"Not compared: {error}.")
    if score.rmse is None or score.ratio is None:
        return BaselineComparison(reason=f"Not compared: {score.reason}.")
    spread = float(np.nanstd(np.where(recording.usable, recording.mv.values, np.nan)))
    residual = Residual(rmse=score.rmse, normalised=score.rmse / max(spread, 1e-9))
    return BaselineComparison(residual=residual, ratio=score.ratio)
