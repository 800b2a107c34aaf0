"""What is known of a recording before an effect is looked for in it: what the archive did, the fit
of S, J and reading alone, and which effects the recording could not have shown.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from stemwatch.models.mismatch.evidence.giving_at_rest import PRESLIDING, giving_at_rest
from stemwatch.models.mismatch.fit.base_fit import (
    BaseFit,
    fit_base,
)
from stemwatch.models.mismatch.identifiability import NO_POSITION, untestable_effects
from stemwatch.models.mismatch.measurement.between_samples import MAY_BE_REPORTS
from stemwatch.models.mismatch.measurement.compression import noise_behind_door
from stemwatch.models.mismatch.measurement.record_effects import MeasuredRecord
from stemwatch.models.mismatch.search.breakaway_levels import DWELL, LEAST_SIZE
from stemwatch.models.mismatch.search.drive import NOT_RESOLVED
from stemwatch.models.mismatch.search.drive import TERMS as OF_A_DRIVE
from stemwatch.models.mismatch.search.reading_errors import STICKS_AGAIN
from stemwatch.models.mismatch.term import RecordingSummary, Term
from stemwatch.models.mismatch.terms import catalogue
from stemwatch.models.recording import Floats, Recording
from stemwatch.models.signals.forensics import quiet_sigma
from stemwatch.models.stickslip.force_balance import ForceBalance, force_balance
from stemwatch.models.stickslip.problem import FitProblem, make_problem

FEWEST_SAMPLES = 60
MOST_S = 10.0  # percent; limits a wrong base fit, so that it does not decide what was exercised
READING = ("zero_shift", "span_error", "sensor_drift")
LEAST_SIGMA = 1e-3  # percent
# Cross-fitting needs blocks; of a short record they are shorter.
FEWEST_BLOCKS, LEAST_BLOCK_SAMPLES = 16, 40


@dataclass(frozen=True)
class PreparedRecording:
    """One recording with the results of the first steps of ``explain``."""

    recording: Recording
    measured: MeasuredRecord
    base: BaseFit
    refused: Mapping[str, str]
    ceiling: Floats | None
    own_reading: bool
    balance: ForceBalance | None  # of a drive whose motion the samples resolve
    untold: str = ""  # why the friction of such a drive cannot be told


def why_not(recording: Recording, measured: MeasuredRecord) -> str | None:
    """Why nothing can be said of this recording, or ``None``."""
    if recording.mv is None:
        return NO_POSITION
    if np.count_nonzero(measured.real & recording.usable) < FEWEST_SAMPLES:
        return f"fewer than {FEWEST_SAMPLES} samples of the position were really measured"
    real = recording.mv.values[measured.real & recording.usable]
    if float(np.ptp(real)) == 0.0:
        return "the position does not change by one digit"
    if float(np.ptp(recording.op.values[recording.op.usable])) == 0.0:
        return "OP never moves"
    return None


def problem_of(recording: Recording, measured: MeasuredRecord) -> FitProblem:
    """The fitting problem, scored on measured samples and on interpolated ones near them."""
    problem = make_problem(recording)
    n = problem.op.size
    n_blocks = max(problem.n_blocks, min(FEWEST_BLOCKS, n // LEAST_BLOCK_SAMPLES))
    is_informative = measured.real | (measured.slack > 0.0)
    block = np.where(problem.scored & is_informative, np.arange(n) * n_blocks // n, -1)
    sigma = max(_noise(recording, measured), measured.sigma_floor, LEAST_SIGMA)
    block, op_open = block.astype(np.int64), measured.op_open
    return replace(problem, block=block, n_blocks=n_blocks, sigma=sigma, op_open=op_open)


def _noise(recording: Recording, measured: MeasuredRecord) -> float:
    """Noise of MV, percent; of a position behind a swinging door, what its kept samples tell."""
    if measured.slack.any():
        return noise_behind_door(measured.real, float(measured.slack.max()))
    return quiet_sigma(_measured(recording, measured))


def _measured(recording: Recording, measured: MeasuredRecord) -> Floats:
    """(n,) MV where it was really measured, else NaN."""
    assert recording.mv is not None
    return np.where(recording.usable & measured.real, recording.mv.values, np.nan)


def summary_of(problem: FitProblem, spacing_s: float) -> RecordingSummary:
    """The summary of the recording that terms choose their ranges by.

    ``spacing_s``: how far apart true samples are (``MeasuredRecord``); nothing quicker
    can be resolved.
    """
    op, mv = problem.op, problem.mv[problem.scored]
    op_low, op_high = np.percentile(op, (1.0, 99.0))
    mv_low, mv_high = np.percentile(mv, (1.0, 99.0))
    return RecordingSummary(
        interval_s=max(problem.interval_s, spacing_s),
        duration_s=problem.op.size * problem.interval_s,
        unit_s=problem.unit_s,
        op_low=float(op_low),
        op_high=float(op_high),
        mv_low=float(mv_low),
        mv_high=float(mv_high),
        sigma=problem.sigma,
        S=0.0,
        J=0.0,
    )


def prepare(
    recording: Recording,
    measured: MeasuredRecord,
    ceiling: Floats | None,
    problem: FitProblem,
    *,
    own_reading: bool = True,
) -> PreparedRecording:
    """S, J and reading fitted, and the terms refused that the recording could not have shown.

    ``own_reading``: MV is the valve\'s own position and not read from a flow.
    """
    summary = summary_of(problem, measured.spacing_s)
    base = fit_base(problem, summary, measured.slack, own_reading=own_reading)
    candidate = base.fitted.candidates.mean(axis=0)
    simulated = base.evaluator.simulate(base.fitted.layout, candidate)
    summary = base.evaluator.summary
    near = min(summary.S, MOST_S), min(summary.J, MOST_S)
    refused = untestable_effects(
        problem.op,
        problem.mv,
        simulated,
        problem.scored,
        problem.interval_s,
        problem.sigma,
        *near,
        measured.spacing_s,
        problem.unit_s,
    )
    if summary.J < MAY_BE_REPORTS * measured.reported_by:
        refused |= dict.fromkeys(
            STICKS_AGAIN,
            f"the archive reports in steps of {measured.reported_by:.2g} %, as a stem would move "
            "that sticks again after each slip",
        )
    if measured.reported_by >= LEAST_SIZE[DWELL]:
        refused[DWELL] = (
            f"the archive reports OP in steps of {measured.reported_by:.2g} %, and the breakaway "
            "is known no better than that"
        )
    gives = giving_at_rest(
        problem.op, problem.mv, simulated, problem.scored, problem.interval_s, problem.sigma, *near
    )
    if measured.slack.any():
        refused[PRESLIDING] = (
            "the archive drew lines between the points that it kept, and a stem that gives way "
            "moves along such lines"
        )
    elif not gives.shows:
        refused.setdefault(PRESLIDING, "at rest the stem does not follow its command")
    if not own_reading:
        refused |= dict.fromkeys(READING, "zero and span are those of the flow's characteristic")
    balance = force_balance(problem) if own_reading else None
    untold, balance = (balance, None) if isinstance(balance, str) else ("", balance)
    if balance is None:
        refused |= dict.fromkeys(OF_A_DRIVE, NOT_RESOLVED)
    return PreparedRecording(
        recording, measured, base, refused, ceiling, own_reading, balance, untold
    )


def admissible(refused: Mapping[str, str]) -> dict[str, Term]:
    """The terms that the recording could have shown."""
    return {slug: term for slug, term in catalogue().items() if slug not in refused}


def is_compressed(measured: MeasuredRecord) -> bool:
    """True where the archive did not store every sample that it received."""
    return any(effect.slug == "historian_compression" for effect in measured.effects)
