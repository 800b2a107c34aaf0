"""``forecast_wear``: when S will reach a limit, from its values of the last weeks, or why that is
not known.

S is a level that rises at a rate; both may wander::

    level(t + dt) = level(t) + rate(t) dt + noise of variance q_level dt
    rate(t + dt)  = rate(t) + noise of variance q_rate dt
    S(t)          = level(t) + error of variance r

The three variances are not known: each point of a grid of them is weighted by the likelihood of its
Kalman filter (Durbin and Koopman 2012, doi:10.1093/acprof:oso/9780199641178.001.0001, local linear
trend), and states are drawn from all of them. Simulated paths continue from these states: steady
wear, accelerating wear, and wear in steps. The interval is that of their first passage through the
limit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stemwatch.models.estimate import Estimate
from stemwatch.models.recording import Floats
from stemwatch.models.words import counted

FEWEST_DAYS = 8  # with an S: fewer cannot separate a rate from an error
SHORTEST_DAYS = 14.0
FIRST = 4  # days that say where S began
SURE = 0.99  # probability that S has risen, from which a trend is claimed
GOES_ON = 0.9  # and that it is still rising
LEAST_RISE_PERCENT = 0.2  # over the time seen; less than a plant's data can show
HORIZON_DAYS = 365
INTERVAL_PERCENT = (5.0, 95.0)
DRAWS = 600
SEED = 29
WEEK = 7.0
# Standard deviations of the grid: of the error as a multiple of the difference of neighbouring
# days, of the level's and the rate's own noise for a day, percent and percent a day.
ERRORS = np.array([0.7, 1.0, 1.4, 2.0])
LEVEL_NOISE = np.array([0.0, 0.015, 0.04])
RATE_NOISE = np.array([0.0, 0.0004, 0.001])
FIRST_RATE = 0.05  # percent a day: prior standard deviation of the rate
LEAST_ERROR_PERCENT = 0.03
# Why no time is given although a trend is claimed.
NOT_WITHIN_A_YEAR = "S rises, but does not reach the limit within a year"


@dataclass(frozen=True, kw_only=True)
class WearForecast:
    """When S reaches ``limit``, percent of OP.

    ``until`` in weeks from the last value, with a 90 % interval; ``high`` is ``None`` where a year
    may not be enough. It has a reason and no value where there is no trend.
    """

    limit: float
    until: Estimate
    probability_rises: float = 0.5

    @property
    def words(self) -> str:
        """A clause for the page: "reaches 1.5 % in 3 to 9 weeks"; empty without a trend."""
        if self.until.value is None or self.until.low is None:
            return ""
        low = f"{self.until.low:.0f}"
        if self.until.high is None:
            weeks = counted(int(low), "week")
            return f"reaches {self.limit:g} % in {weeks} at the earliest"
        high = f"{self.until.high:.0f}"
        weeks = f"about {counted(int(low), 'week')}" if low == high else f"{low} to {high} weeks"
        return f"reaches {self.limit:g} % in {weeks}"


def forecast_wear(days: Sequence[float], S: Sequence[float], limit: float) -> WearForecast:
    """When ``S`` (n,), percent, at ``days`` (n,) reaches ``limit``, percent. Seeded."""
    t, y = np.asarray(days, dtype=np.float64), np.asarray(S, dtype=np.float64)
    if t.size < FEWEST_DAYS or np.ptp(t) < SHORTEST_DAYS:
        reason = f"S of {FEWEST_DAYS} days over {SHORTEST_DAYS:.0f} is needed, {t.size} are there"
        return WearForecast(limit=limit, until=Estimate.unknown(reason, "weeks"))
    means, covariances, weights, error, noise = _filtered(t, y)
    rng = np.random.default_rng(SEED)
    chosen = rng.choice(weights.size, DRAWS, p=weights)
    state = means[chosen] + np.einsum(
        "nij,nj->ni", np.linalg.cholesky(covariances[chosen]), rng.standard_normal((DRAWS, 2))
    )
    # The uncertainty of the first days' level is that of their mean.
    first = y[:FIRST].mean() + np.sqrt(error[chosen] / FIRST) * rng.standard_normal(DRAWS)
    rises = float(np.mean(state[:, 0] - first > LEAST_RISE_PERCENT))
    share_rising = float(np.mean(state[:, 1] > 0.0))
    if float(state[:, 0].mean()) >= limit:
        reason = f"S is at {limit:g} % already"
    elif rises < SURE or share_rising < GOES_ON:
        reason = "S does not rise by more than its own scatter"
    else:
        # A rising S keeps rising: a worn stem does not heal by itself.
        rising = state[:, 1] > 0.0
        until = _passage(state[rising], noise[chosen[rising]], limit, rng)
        return WearForecast(limit=limit, until=until, probability_rises=rises)
    unknown = Estimate.unknown(reason, "weeks")
    return WearForecast(limit=limit, until=unknown, probability_rises=rises)


def _filtered(t: Floats, y: Floats) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """State and covariance at the last value, (m, 2) and (m, 2, 2), of each of the m variances,
    with its weight (m,) and the variances of level and rate for a day (m, 2)."""
    between = np.abs(np.diff(y)) / np.sqrt(2.0)
    scale = max(float(np.median(between)) / 0.6745, LEAST_ERROR_PERCENT)
    error, of_level, of_rate = (
        part.ravel() ** 2 for part in np.meshgrid(ERRORS * scale, LEVEL_NOISE, RATE_NOISE)
    )
    mean = np.zeros((error.size, 2))
    mean[:, 0] = y[0]
    covariance = np.zeros((error.size, 2, 2))
    covariance[:, 0, 0] = error
    covariance[:, 1, 1] = FIRST_RATE**2
    likelihood = np.zeros(error.size)
    for k in range(1, t.size):
        dt = t[k] - t[k - 1]
        step = np.array([[1.0, dt], [0.0, 1.0]])
        mean = mean @ step.T
        covariance = step @ covariance @ step.T
        covariance[:, 0, 0] += of_level * dt + of_rate * dt**3 / 3.0
        covariance[:, 0, 1] += of_rate * dt**2 / 2.0
        covariance[:, 1, 0] += of_rate * dt**2 / 2.0
        covariance[:, 1, 1] += of_rate * dt
        spread = covariance[:, 0, 0] + error
        miss = y[k] - mean[:, 0]
        likelihood -= 0.5 * (miss**2 / spread + np.log(spread))
        gain = covariance[:, :, 0] / spread[:, None]
        mean = mean + gain * miss[:, None]
        covariance = covariance - gain[:, :, None] * covariance[:, None, 0, :]
    weights = np.exp(likelihood - likelihood.max())
    covariance += 1e-12 * np.eye(2)
    noise = np.column_stack((of_level, of_rate))
    return mean, covariance, weights / weights.sum(), error, noise


def _passage(state: Floats, noise: Floats, limit: float, rng: np.random.Generator) -> Estimate:
    """Weeks until paths from ``state`` (m, 2) first reach ``limit``."""
    shape = (state.shape[0], HORIZON_DAYS)
    rate_noise = np.sqrt(noise[:, 1:]) * rng.standard_normal(shape)
    # A worn stem does not heal by itself.
    rate = np.maximum(state[:, 1:] + np.cumsum(rate_noise, axis=1), 1e-5)
    # The noise of the level is wear in steps: Poisson in time with exponential sizes, whose mean is
    # the rate and whose variance is that of the level.
    size = np.maximum(0.5 * noise[:, :1] / rate, 1e-9)
    steps = rng.poisson(np.minimum(rate / size, 1e6))
    wear = np.where(noise[:, :1] > 0.0, size * rng.standard_gamma(np.maximum(steps, 1e-9)), rate)
    level = state[:, :1] + np.cumsum(wear, axis=1)
    is_reached = level >= limit
    day = np.where(is_reached.any(axis=1), is_reached.argmax(axis=1) + 1.0, np.inf)
    low, middle, high = np.percentile(
        day, (INTERVAL_PERCENT[0], 50.0, INTERVAL_PERCENT[1]), method="nearest"
    )
    if not np.isfinite(middle):
        return Estimate.unknown(NOT_WITHIN_A_YEAR, "weeks")
    return Estimate(
        value=float(middle) / WEEK,
        low=float(low) / WEEK,
        high=float(high) / WEEK if np.isfinite(high) else None,
        unit="weeks",
    )
