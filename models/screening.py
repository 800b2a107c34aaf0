"""``screen``: the whole science on one page, from recordings to verdicts.

    recording -> quality -> stick-slip fit -> NARX fit -> baseline -> evidence -> verdict

Each valve stands alone: one that fails is a result with a reason and the rest goes on. The
networks of all valves in a call train together.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from stemwatch.models import indicators
from stemwatch.models.estimate import Estimate
from stemwatch.models.findings import DataQuality, Indicator, Residual, Screening, Traces
from stemwatch.models.judge import Evidence, Judgement, judge, undetermined
from stemwatch.models.limits import Limits
from stemwatch.models.loop import loop_oscillation
from stemwatch.models.narx.example import NarxExample, NarxFit, NarxSettings
from stemwatch.models.narx.network import NarxNetwork
from stemwatch.models.quality import Assessment, Obstacle, assess
from stemwatch.models.recording import PERCENT, Floats, Provenance, Recording, Role
from stemwatch.models.sight import still_seen
from stemwatch.models.slowness import slowness
from stemwatch.models.stickslip.fit import StickSlipFit, fit_stickslip
from stemwatch.models.stickslip.interval import StickSlipSample, bootstrap, interval
from stemwatch.models.verdict import Verdict


@dataclass(frozen=True, kw_only=True)
class Case:
    """One recording to screen, with the valve's baseline network where there is one."""

    recording: Recording
    baseline: NarxNetwork | None = None
    baseline_note: str = "No baseline yet."


@dataclass(frozen=True, kw_only=True)
class Options:
    """How to screen. ``narx`` may be switched off for a quick look."""

    limits: Limits = field(default_factory=Limits)
    narx: bool = True
    narx_settings: NarxSettings = field(default_factory=NarxSettings)


DEFAULTS = Options()


@dataclass(frozen=True, kw_only=True)
class _Fitted:
    """A case on its way: assessed, and fitted where nothing stood in the way."""

    case: Case
    assessment: Assessment
    fit: StickSlipFit | None
    sample: StickSlipSample | None
    seconds: float


def screen(cases: Sequence[Case], options: Options = DEFAULTS) -> list[Screening]:
    """One ``Screening`` for each case, in order. Never raises for what a recording holds."""
    fitted = [_fit_or_reason(case, options.limits) for case in cases]
    networks = _train(fitted, options)
    return [
        _conclude_or_reason(one, network, options.limits) if isinstance(one, _Fitted) else one
        for one, network in zip(fitted, networks, strict=True)
    ]


def failed(valve: str, reason: str, advice: str, provenance: Provenance) -> Screening:
    """The screening of a valve whose recording could not even be read."""
    unknown = Estimate.unknown(reason, unit=PERCENT)
    return Screening(
        valve=valve,
        verdict=Verdict.UNDETERMINED,
        reason=f"Cannot tell: {reason}",
        advice=advice,
        shape=None,
        severity=15.0,
        confidence=None,
        S=unknown,
        J=unknown,
        residuals={"stiction": None, "narx": None, "baseline": None},
        quality=DataQuality(grade="D", reasons=(reason,)),
        indicators={},
        provenance=provenance,
    )


def _crashed(case: Case, error: Exception) -> Screening:
    reason = f"the fit broke down on this recording ({type(error).__name__}: {error})."
    advice = "Report this with the recording; the other valves are not affected."
    recording = case.recording
    return replace(
        failed(recording.valve, reason, advice, recording.provenance), recording=recording
    )


def _fit_or_reason(case: Case, limits: Limits) -> _Fitted | Screening:
    try:
        return _fit(case, limits)
    except Exception as error:  # one valve must not end a plant's run
        return _crashed(case, error)


def _fit(case: Case, limits: Limits) -> _Fitted:
    began = time.perf_counter()
    assessment = assess(case.recording, limits)
    fit = None if assessment.obstacles else fit_stickslip(assessment.recording)
    sample = bootstrap(fit) if fit is not None else None
    return _Fitted(
        case=case,
        assessment=assessment,
        fit=fit,
        sample=sample,
        seconds=time.perf_counter() - began,
    )


def _train(fitted: Sequence[_Fitted | Screening], options: Options) -> list[NarxFit | None]:
    """A network for each case that has a fit, all trained together."""
    ready = [
        (at, one.fit, one.assessment.recording)
        for at, one in enumerate(fitted)
        if isinstance(one, _Fitted) and one.fit is not None
    ]
    trained: list[NarxFit | None] = [None] * len(fitted)
    if not ready or not options.narx:
        return trained
    from stemwatch.models.narx.training import train  # torch takes two seconds to import

    examples = [_example(recording, fit.first_heldout) for _, fit, recording in ready]
    for (at, _, _), fit in zip(ready, train(examples, options.narx_settings), strict=True):
        trained[at] = fit
    return trained


def _example(recording: Recording, train_until: int) -> NarxExample:
    assert recording.mv is not None
    return NarxExample(
        valve=recording.valve,
        op=recording.op.values,
        mv=recording.mv.values,
        usable=recording.usable,
        train_until=train_until,
        interval_s=recording.interval_s,
    )


def _conclude_or_reason(one: _Fitted, network: NarxFit | None, limits: Limits) -> Screening:
    try:
        return _conclude(one, network, limits)
    except Exception as error:  # one valve must not end a plant's run
        return _crashed(one.case, error)


def _conclude(one: _Fitted, network: NarxFit | None, limits: Limits) -> Screening:
    began = time.perf_counter()
    if one.fit is None or one.sample is None:
        screening = _without_verdict(one)
    else:
        screening = _with_verdict(one, one.fit, one.sample, network, limits)
    seconds = one.seconds + time.perf_counter() - began
    return replace(screening, seconds=seconds + (network.seconds if network else 0.0))


def _screening(
    one: _Fitted,
    judgement: Judgement,
    S: Estimate,
    J: Estimate,
    residuals: dict[str, Residual | None],
    found: list[Indicator],
) -> Screening:
    recording = one.case.recording
    seen = judgement.verdict is Verdict.UNDETERMINED
    return Screening(
        valve=recording.valve,
        verdict=judgement.verdict,
        reason=judgement.reason,
        advice=judgement.advice,
        shape=judgement.shape,
        severity=judgement.severity,
        confidence=judgement.confidence,
        S=S,
        J=J,
        residuals=residuals,
        quality=one.assessment.quality,
        indicators={indicator.name: indicator for indicator in found},
        still_seen=still_seen(recording) if seen else (),
        baseline_note=one.case.baseline_note,
        recording=recording,
        provenance=recording.provenance,
    )


def _without_verdict(one: _Fitted) -> Screening:
    obstacles: tuple[Obstacle, ...] = one.assessment.obstacles
    unknown = Estimate.unknown(obstacles[0].reason, unit=PERCENT)
    residuals: dict[str, Residual | None] = {"stiction": None, "narx": None, "baseline": None}
    found = indicators.of_recording(one.case.recording)
    return _screening(one, undetermined(obstacles), unknown, unknown, residuals, found)


def _estimate(draws_of: str, one: _Fitted, value: float) -> Estimate:
    assert one.sample is not None
    low, high = interval(getattr(one.sample, draws_of), value)
    return Estimate(value=value, low=low, high=high, unit=PERCENT)


def _heldout_error(fit: StickSlipFit, *, resynced: bool) -> tuple[Floats, Floats]:
    """Residual and MV on the scored samples that the model was not fitted to."""
    problem = fit.bench.problem
    late = problem.scored & (np.arange(problem.op.size) >= fit.first_heldout)
    return (problem.mv - fit.heldout(resynced=resynced))[late], problem.mv[late]


def _stiction_residual(fit: StickSlipFit, *, resynced: bool) -> Residual | None:
    """Run of the model fitted to the first part, judged on the rest."""
    error, mv = _heldout_error(fit, resynced=resynced)
    if error.size < 10 or float(np.std(mv)) == 0.0:
        return None
    rmse = float(np.sqrt(np.mean(error**2)))
    return Residual(rmse=rmse, normalised=rmse / float(np.std(mv)))


def _typical_percent(fit: StickSlipFit) -> float:
    """100 (1 - median |residual| / median |MV - median MV|): slips that come late do not count."""
    error, mv = _heldout_error(fit, resynced=True)
    if error.size < 10:
        return 0.0
    usual = float(np.median(np.abs(mv - np.median(mv))))
    return 100.0 * (1.0 - float(np.median(np.abs(error))) / max(usual, 1e-9))


def _narx_residual(network: NarxFit | None) -> Residual | None:
    if network is None or network.heldout is None:
        return None
    held = network.heldout
    return Residual(rmse=held.rmse, normalised=held.normalised, one_step=held.one_step_rmse)


def _baseline_residual(one: _Fitted) -> tuple[Residual | None, float | None, str]:
    """How the valve's baseline network follows this window, its ratio, and what to say of it."""
    baseline, recording = one.case.baseline, one.assessment.recording
    if baseline is None or recording.mv is None:
        return None, None, one.case.baseline_note
    from stemwatch.models.narx.baseline import score_baseline

    score = score_baseline(
        baseline,
        recording.op.values,
        recording.mv.values,
        recording.usable,
        interval_s=recording.interval_s,
    )
    if score.rmse is None or score.ratio is None:
        return None, None, f"{one.case.baseline_note} Not compared: {score.reason}"
    spread = float(np.nanstd(np.where(recording.usable, recording.mv.values, np.nan)))
    residual = Residual(rmse=score.rmse, normalised=score.rmse / max(spread, 1e-9))
    return residual, score.ratio, one.case.baseline_note


def _with_verdict(
    one: _Fitted,
    fit: StickSlipFit,
    sample: StickSlipSample,
    network: NarxFit | None,
    limits: Limits,
) -> Screening:
    S, J = _estimate("S", one, fit.S), _estimate("J", one, fit.J)
    baseline, ratio, note = _baseline_residual(one)
    residuals = {
        "stiction": _stiction_residual(fit, resynced=False),
        "narx": _narx_residual(network),
        "baseline": baseline,
    }
    cycle = loop_oscillation(one.case.recording).get(Role.OP)
    evidence = Evidence(
        S=S,
        J=J,
        S_draws=sample.S,
        friction_mean=fit.of_sticking.mean,
        friction_t=fit.of_sticking.t,
        following=_stiction_residual(fit, resynced=True),
        narx=residuals["narx"],
        typical_percent=_typical_percent(fit),
        sigma=fit.bench.problem.sigma,
        slow=slowness(fit),
        baseline=baseline,
        baseline_ratio=ratio,
        cycling_s=cycle.period_s if cycle is not None and cycle.regular else None,
    )
    found = [
        *indicators.of_recording(one.case.recording),
        *indicators.of_fit(fit, S, J),
        *indicators.of_residuals(residuals, ratio),
    ]
    screening = _screening(one, judge(evidence, limits), S, J, residuals, found)
    return replace(
        screening,
        baseline_note=note,
        network=network.network if network is not None else None,
        traces=Traces(
            stiction=fit.heldout(),
            narx=network.simulated if network is not None else None,
            heldout_from=fit.first_heldout,
        ),
    )
