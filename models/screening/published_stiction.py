"""The one S and J of a valve and window: which of the fits they are taken from, percent of OP."""

from __future__ import annotations

from dataclasses import replace

from stemwatch.models.estimate import Estimate
from stemwatch.models.mismatch.findings import Finding, Mismatch, Stiction
from stemwatch.models.mismatch.measurement.between_samples import stands_for_friction
from stemwatch.models.recording import PERCENT, Floats
from stemwatch.models.screening.fitted_recording import FittedRecording
from stemwatch.models.screening.hidden_stiction import S_that_may_be_hidden
from stemwatch.models.stickslip.interval import interval, spread_of
from stemwatch.models.stickslip.parameters import S_and_J


def published_stiction(
    fitted: FittedRecording, mismatch: Mismatch | None
) -> tuple[Estimate, Estimate, Floats]:
    """S, J and draws of S, percent of OP: those of the fit with the named effects, if any; else
    those of the likelihood of the whole record, where it tells them."""
    if mismatch is not None and mismatch.effects and mismatch.restated.S.value is not None:
        S, J = _unless_late(fitted, mismatch.restated)
        return S, J, spread_of(S)
    if mismatch is not None and mismatch.restated.by_likelihood:
        S, J = _up_to_what_may_be_hidden(fitted, mismatch.restated.S), mismatch.restated.J
        return S, J, spread_of(S)
    S, J, S_draws = of_stickslip_fit(fitted)
    S = _up_to_what_may_be_hidden(fitted, S)
    if mismatch is not None and lag_is_doubtful(fitted, mismatch, S, J):
        # Only this fit needs the lag, and the recording does not show which of the two is right.
        # Breakaways that were read with the lag, and not by a run of their own, say nothing then.
        naive, restated = mismatch.naive, mismatch.restated
        by_a_run = fitted.fit.breakaways is None
        S = restated.S.holding(*((S, naive.S) if by_a_run else (naive.S,)))
        J = restated.J.holding(*((J, naive.J) if by_a_run else (naive.J,)))
        S_draws = spread_of(S)
    return S, J, S_draws


def lag_is_doubtful(fitted: FittedRecording, mismatch: Mismatch, S: Estimate, J: Estimate) -> bool:
    """Whether a lag fitted beside friction has taken part of S or J although the whole record is
    explained without it: S and J of an assimilated fit contradict it.
    """
    if fitted.fit.hypothesis != "both" or fitted.archive is not None:
        return False
    explained = mismatch.finding is Finding.NONE
    restated = mismatch.restated
    return explained and (restated.S.contradicts(S) or restated.J.contradicts(J))


def stands_behind_reports(fitted: FittedRecording, S: Estimate) -> bool:
    """Whether reports by exception, which come late as behind a lag, may have what a fit with an
    ``S`` leaves of the S of friction alone."""
    reports = fitted.archive is not None and fitted.archive.deviation > 0.0
    return reports and stands_for_friction(S, _exactly(fitted.S_alone))


def _unless_late(fitted: FittedRecording, restated: Stiction) -> tuple[Estimate, Estimate]:
    """S and J beside named effects, percent of OP; behind reports that come late the intervals
    hold those of friction alone."""
    if not stands_behind_reports(fitted, restated.S):
        return restated.S, restated.J
    archive, curve = fitted.archive, fitted.curve
    assert archive is not None
    S_alone, J_alone = (_exactly(value) for value in S_and_J(fitted.fit.naive))
    S, J = archive.restored(S_alone, J_alone, 0.0)
    if curve is not None:
        S, J = curve.in_op(S), curve.in_op(J, is_jump=True)
    return restated.S.holding(S), restated.J.holding(J)


def _up_to_what_may_be_hidden(fitted: FittedRecording, S: Estimate) -> Estimate:
    """``S``, percent of OP, whose interval reaches to the S that noise of OP may hide from a slow
    archive, where it was read by the fit alone."""
    if fitted.archive is not None or S.value is None or S.high is None:
        return S
    return replace(S, high=max(S.high, S_that_may_be_hidden(fitted, S)))


def _exactly(value: float) -> Estimate:
    return Estimate(value=value, low=value, high=value, unit=PERCENT)


def of_stickslip_fit(fitted: FittedRecording) -> tuple[Estimate, Estimate, Floats]:
    """S, J and draws of S of the stick-slip fit, percent of OP, with what the archive lost."""
    fit, sample = fitted.fit, fitted.sample
    S, J, S_draws = _estimate(sample.S, fit.S), _estimate(sample.J, fit.J), sample.S
    if fitted.archive is not None:
        S, J = fitted.archive.restored(S, J, fitted.missed)
        S_draws = S_draws if S.value is None else spread_of(S)
    if fitted.curve is not None:
        S, J = fitted.curve.in_op(S), fitted.curve.in_op(J, is_jump=True)
        S_draws = S_draws / abs(fitted.curve.slope)
    return S, J, S_draws


def _estimate(draws: Floats, value: float) -> Estimate:
    low, high = interval(draws, value)
    return Estimate(value=value, low=low, high=high, unit=PERCENT)
