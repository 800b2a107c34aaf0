"""Friction behind an archive that is slower than OP, and the slow actuator that it looks like.

A controller moves OP every second; an archive may keep a sample every 5 to 60 s. Between two of
them noise in OP shakes a stem loose a little: each excursion takes it as far as half a dead band
behind. From sample to sample such a stem creeps towards OP, as one does behind a lag of many
seconds, a drag or weak air. A stroke takes 2 to 15 s, so that a time constant of 10 s and more is
far more often friction.

- Where the archive itself shows a dead band (``signals.dead_band``), there is friction, and no
  actuator that slow is fitted or named.
- Where it shows none, and OP moves enough from sample to sample to shake the stem loose, neither
  can be told from the other.
- Where nothing slow is seen either, and the stem does not follow OP's own noise, a sticking stem
  that is shaken loose looks healthy. In a sample of n scans white noise of standard deviation s
  spans ``w s`` from its lowest to its highest value, w being the expected range of n standard
  normal values. It takes the stem to within half a dead band of either end, so that the band that
  is left to be seen is smaller than that of the valve by ``w s``:

      S that may be there = S that is seen + w s,  w = 2 Phi^-1((n - 3/8) / (n + 1/4))

  (Blom 1958). What of OP's noise the stem follows shakes nothing loose: ``s^2 = var OP - cov(OP,
  MV)``, of second differences.
- Averages over n scans have lost that noise, and with it the band: a stem that is shaken from end
  to end of its band within each mean follows OP, on average. What is left of the band is that such
  a stem is somewhere within it, which differs from one mean to the next. With ``e`` the scatter of
  what S and J leave of the position

      S that may be there = S that is seen + c sqrt(n) e

  for noise of at least a third of S. Over few scans such a stem creeps from mean to mean, as behind
  a lag, and ``e`` is the scatter of OP - MV itself. A sample is as far off by noise alone, so that
  this says something of averages only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import ndtri

from stemwatch.models.mismatch.findings import Mismatch
from stemwatch.models.recording import Bools, Floats
from stemwatch.models.signals.dead_band import DeadBand, find_dead_bands
from stemwatch.models.stickslip import parameters as coordinate
from stemwatch.models.stickslip.fit import StickSlipFit

SLOW_ARCHIVE_S = 5.0  # from one sample to the next, from which OP may turn unseen in between
SLOWER_THAN_BUILT_S = 10.0  # a time constant; a lag of that size makes a stroke last half a minute
SLOWER_THAN_BUILT = 1.0  # %/s; a full stroke in 100 s
# A band as wide as the limit of sticky that is sure: outside it the stem follows OP at least
# three times as closely as within. Of 96 records of 8 healthy valves (`draw_healthy`, seed 6161)
# kept every 5, 10 and 30 s for six hours, with lags of 0 to 30 s, none reaches this, and of 24 with
# a lag of 60 s two; of 24 of sticking ones (`draw_sticky`) 22.
WIDE, SURE_T, MOSTLY = 1.5, 2.5, 3.0
# A band that leaves doubt.
PERHAPS_T = 2.0
SCAN_S = 1.0  # from one output of a controller to the next, as usual
# Where nothing shows what the archive keeps: averages over fewer seconds are seldom kept, and less
# of the noise is lost in them.
AVERAGED_FROM_S = 10.0
# Below this a stem is not shaken from end to end within each average: it creeps, which a fit takes
# for a lag and leaves little. So it is OP - MV itself that scatters by as much as S lets it.
CREEPS_BELOW_S = 20.0
# c: `python tests/benchmarks/bench_averaged_band.py` simulates a stem without jumps whose OP has
# white noise of a third of S. Less noise leaves more of the band to be seen.
OF_ROOT = 2.6
# Standard deviations that hundreds of scans reach from end to end, and the share of S that noise
# must reach to shake the stem loose again and again.
REACH, OF_S = 6.0, 0.5

OF_SLOW_ACTUATORS = (
    "actuator_lag",
    "asymmetric_lag",
    "asymmetric_rate_limit",
    "rate_limit",
    "supply_sag",
    "viscous_drag",
)
# What a dead band with an edge that is rounded by shaking looks like as well.
LIKE_A_SHAKEN_BAND = (*OF_SLOW_ACTUATORS, "spring_hysteresis")
RESTS = (
    "the stem rests while OP turns round by some percent, as behind no slow actuator, and this "
    "archive does not show what else acts"
)


def _interval_s(fit: StickSlipFit) -> float:
    """True seconds from one sample to the next."""
    problem = fit.evaluator.problem
    return problem.interval_s * problem.unit_s


def dead_bands_of(fit: StickSlipFit) -> tuple[DeadBand, ...]:
    """The wide dead bands that a slow archive shows; none in a quicker one, which the fits
    resolve."""
    problem = fit.evaluator.problem
    if _interval_s(fit) < SLOW_ARCHIVE_S or not problem.mv_is_percent:
        return ()
    bands = find_dead_bands(problem.op, problem.mv, problem.scored)
    return tuple(band for band in bands if band.percent >= WIDE)


def is_sure(bands: Sequence[DeadBand]) -> bool:
    """Whether the stem rests in one of these wide bands beyond doubt."""
    return any(band.t >= SURE_T and band.gain >= MOSTLY * abs(band.inside) for band in bands)


def without_slow_actuator(fit: StickSlipFit, bands: Sequence[DeadBand]) -> StickSlipFit:
    """``fit`` as one of S and J alone, where it has an actuator slower than any is built beside a
    dead band that is sure."""
    if fit.hypothesis != "both" or not is_sure(bands) or _slowest_s(fit) < SLOWER_THAN_BUILT_S:
        return fit
    return replace(fit, hypothesis="sticking", candidate=fit.naive, breakaways=None)


def may_be_shaken(
    fit: StickSlipFit, found: Mismatch | None, bands: Sequence[DeadBand], S_alone: float
) -> bool:
    """Whether an actuator that was fitted or ``found``, slower than any is built, may be friction
    with an S of ``S_alone``, percent of travel, that OP shakes loose between its samples."""
    if _interval_s(fit) < SLOW_ARCHIVE_S or S_alone <= 0.0:
        return False
    if not (_slow_named(found) or (_slowest_s(fit) >= SLOWER_THAN_BUILT_S)):
        return False
    perhaps = any(band.t >= PERHAPS_T for band in bands)
    return perhaps or REACH * _scatter(fit.evaluator.problem.op) >= OF_S * S_alone


def S_unseen(fit: StickSlipFit, S: float) -> float:
    """The S that a stem may have which looks like one of ``S``, percent of travel, because noise
    of OP shakes it loose between two samples of a slow archive; ``S`` itself in a quick one."""
    problem = fit.evaluator.problem
    scans = _interval_s(fit) / SCAN_S
    if _interval_s(fit) < SLOW_ARCHIVE_S or not problem.mv_is_percent:
        return S
    span = 2.0 * float(ndtri((scans - 0.375) / (scans + 0.25)))
    return S + span * _not_followed(problem.op, problem.mv, problem.scored)


def S_averaged(fit: StickSlipFit, S: float, averages: bool | None = None) -> float:
    """The S that a stem may have which looks like one of ``S``, percent of travel, if a slow
    archive keeps ``averages``, or may keep them (``None``); ``S`` itself in a quick one, and in
    one of samples."""
    problem = fit.evaluator.problem
    every_s = _interval_s(fit)
    least_s = SLOW_ARCHIVE_S if averages else AVERAGED_FROM_S
    if averages is False or every_s < least_s or not problem.mv_is_percent:
        return S
    creeps = every_s < CREEPS_BELOW_S
    stem = problem.op if creeps else fit.evaluator.simulate(fit.candidate, resynced=True)
    left = problem.mv - stem
    return S + OF_ROOT * float(np.sqrt(every_s / SCAN_S)) * _scatter(left, problem.scored)


def _slowest_s(fit: StickSlipFit) -> float:
    """The longer lag that was fitted beside friction, true seconds; 0 where none was."""
    if fit.hypothesis != "both":
        return 0.0
    lag = max(fit.candidate[coordinate.LAG_UP_S], fit.candidate[coordinate.LAG_DOWN_S])
    return float(lag) * fit.evaluator.problem.unit_s


def _slow_named(found: Mismatch | None) -> bool:
    """Whether an actuator slower than any is built was named."""
    effects = () if found is None else found.effects
    sizes = [
        size
        for effect in effects
        if effect.slug in OF_SLOW_ACTUATORS
        for size in effect.parameters.values()
    ]
    return any(
        size.value is not None
        and (
            (size.unit == "s" and size.value >= SLOWER_THAN_BUILT_S)
            or (size.unit == "%/s" and size.value <= SLOWER_THAN_BUILT)
        )
        for size in sizes
    )


def _scatter(values: Floats, usable: Bools | None = None) -> float:
    """Standard deviation by which values (n,) move to and fro from sample to sample: that of their
    second differences, by their median. Those that are not all ``usable`` are left out."""
    changes = np.diff(values, 2)
    if usable is not None:
        changes = changes[usable[2:] & usable[1:-1] & usable[:-2]]
    if not changes.size:
        return 0.0
    return 1.4826 * float(np.median(np.abs(changes))) / float(np.sqrt(6.0))


def _not_followed(op: Floats, mv: Floats, usable: Bools) -> float:
    """Standard deviation of the noise of OP that the stem does not follow from sample to sample,
    percent. It is no larger than the scatter of OP itself, nor than that of OP - MV, to which the
    transmitter adds."""
    of_op, apart, both = (_scatter(values, usable) for values in (op, op - mv, op + mv))
    together = (both**2 - apart**2) / 4.0  # covariance
    return min(of_op, apart, float(np.sqrt(max(of_op**2 - together, 0.0))))
