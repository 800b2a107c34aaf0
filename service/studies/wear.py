"""How often the forecast of wear is right, on simulated months of S.

S is drawn, and estimates of it are simulated with realistic errors; nothing is fitted to samples,
so that hundreds of valves take seconds. Other studies count how well S itself is estimated.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from stemwatch.models.history.fall_of_stiction import history_since_fall
from stemwatch.models.history.trend_over_weeks import trend_over_weeks
from stemwatch.models.history.wear_forecast import (
    NOT_WITHIN_A_YEAR,
    WEEK,
    WearForecast,
    forecast_wear,
)
from stemwatch.models.limits import Limits
from stemwatch.models.recording import Bools, Floats

DAYS = 300
SEEN_DAYS = 84  # before the forecast, as the product looks back
LEAST_SEEN_DAYS = 20
# Errors of an estimate of S: relative to S, absolute in percent, and one that persists for days in
# percent (operating conditions), with its duration.
SHARE, OWN, LASTING, LASTS_DAYS = 0.04, 0.06, 0.05, 10.0
LIMIT = Limits().sticky_S_percent


class WearKind(StrEnum):
    """How a valve wears."""

    NONE = "none"
    STEADY = "steady"
    ACCELERATING = "accelerating"
    STEPWISE = "stepwise"
    REPAIRED = "steady, repaired unrecorded"


@dataclass(frozen=True, kw_only=True)
class ForecastCase:
    """One valve on one day: what was foreseen, and the ``weeks`` until S truly reaches the limit
    (infinite where it never does within the months that were drawn)."""

    wear: WearKind
    forecast: WearForecast
    weeks: float

    @property
    def claimed(self) -> bool:
        """Whether a trend was claimed at all."""
        until = self.forecast.until
        return until.value is not None or until.reason == NOT_WITHIN_A_YEAR

    @property
    def holds(self) -> bool | None:
        """Whether the interval holds the truth, to a day; ``None`` where none was given."""
        until = self.forecast.until
        if until.value is None or until.low is None:
            return None
        high = np.inf if until.high is None else until.high
        return bool(until.low - 1.0 / WEEK <= self.weeks <= high + 1.0 / WEEK)


def run_wear_study(valves: int, seed: int) -> Iterator[ForecastCase]:
    """``valves`` of each kind of wear, one after the other."""
    for wear in WearKind:
        for index in range(valves):
            rng = np.random.default_rng([seed, index, list(WearKind).index(wear)])
            if (case := _case(wear, rng)) is not None:
                yield case


@dataclass(frozen=True, kw_only=True)
class AlertedValve:
    """A valve that was looked at every week: the day of the first alert that foresees it sticking,
    and the day on which S truly reaches the limit; ``None`` where there is no such day."""

    wear: WearKind
    alerted: int | None
    crosses: int | None

    @property
    def weeks_ahead(self) -> float | None:
        """How long before the limit the alert came."""
        if self.alerted is None or self.crosses is None:
            return None
        return (self.crosses - self.alerted) / WEEK


def watch_valves(
    valves: int, seed: int, within_weeks: float, wears: Sequence[WearKind] = tuple(WearKind)
) -> Iterator[AlertedValve]:
    """``valves`` of each of ``wears``, by the rule of the alert ``foreseen``, up to the limit."""
    for wear in wears:
        for index in range(valves):
            rng = np.random.default_rng([seed, index, list(WearKind).index(wear)])
            S = true_S(wear, rng)
            measured, measured_days = estimated_S(S, rng)
            crosses = int(np.argmax(S >= LIMIT)) if (S >= LIMIT).any() else None
            looks = range(LEAST_SEEN_DAYS, DAYS if crosses is None else crosses, int(WEEK))
            foreseen = (
                day for day in looks if _foresees(measured, measured_days, day, within_weeks)
            )
            yield AlertedValve(wear=wear, alerted=next(foreseen, None), crosses=crosses)


def _foresees(S: Floats, measured_days: Bools, today: int, within_weeks: float) -> bool:
    days = np.arange(max(0, today - SEEN_DAYS), today + 1)
    days = days[measured_days[days]]
    trend = trend_over_weeks(days.tolist(), S[days].tolist(), LIMIT)
    return trend is not None and trend.foresees_within(within_weeks) is True


def _case(wear: WearKind, rng: np.random.Generator) -> ForecastCase | None:
    S = true_S(wear, rng)
    measured, measured_days = estimated_S(S, rng)
    beyond_limit = S >= LIMIT
    crosses = int(np.argmax(beyond_limit)) if beyond_limit.any() else DAYS - 1
    if crosses <= LEAST_SEEN_DAYS:
        return None
    today = int(rng.integers(LEAST_SEEN_DAYS, crosses))
    days = np.arange(max(0, today - SEEN_DAYS), today + 1)
    days = days[measured_days[days]]
    if not days.size:
        return None
    present = history_since_fall(days.tolist(), measured[days].tolist())
    forecast = forecast_wear(present.days, present.S, LIMIT)
    weeks = (crosses - days[-1]) / WEEK if beyond_limit.any() else np.inf
    return ForecastCase(wear=wear, forecast=forecast, weeks=float(weeks))


def true_S(wear: WearKind, rng: np.random.Generator) -> Floats:
    """(DAYS,) S of a valve, percent of OP span: it begins to wear, or was repaired, some time in
    the first third. One that is repaired without a record goes back to where it began before it
    reaches the limit, and wears on."""
    well = rng.uniform(0.1, 0.6)
    if wear is WearKind.NONE:
        return np.full(DAYS, rng.uniform(0.1, 1.3))
    day = np.arange(DAYS)
    begins, worn = rng.uniform(0.0, 0.3) * DAYS, rng.uniform(1.5, 6.0)
    share = np.clip((day - begins) / (DAYS - begins), 0.0, None)
    if wear is WearKind.ACCELERATING:
        share = share ** rng.uniform(1.5, 3.0)
    if wear is WearKind.STEPWISE:
        repair_days = rng.uniform(begins, DAYS, rng.integers(4, 12))
        size = rng.exponential(size=repair_days.size)
        share = (size * (day[:, None] >= repair_days)).sum(axis=1) / size.sum()
    S = np.asarray(well + (worn - well) * share)
    if wear is WearKind.REPAIRED:
        mended = int(np.argmax(S >= rng.uniform(0.7, LIMIT)))
        S[mended:] -= S[mended] - well
    return S


def estimated_S(S: Floats, rng: np.random.Generator) -> tuple[Floats, Bools]:
    """``S`` as screenings estimate it, and the days that have one: some, and of every other valve
    three weeks are missing."""
    days = np.arange(S.size)
    correlation = np.exp(-np.abs(days[:, None] - days) / LASTS_DAYS) + 1e-9 * np.eye(S.size)
    lasting = np.linalg.cholesky(correlation) @ rng.standard_normal(S.size)
    measured = S * (1.0 + SHARE * rng.standard_normal(S.size))
    measured += OWN * rng.standard_normal(S.size) + LASTING * lasting
    is_measured = rng.random(S.size) < rng.uniform(0.4, 1.0)
    if rng.random() < 0.5:
        missing = int(rng.integers(S.size))
        is_measured[missing : missing + 21] = False
    return np.maximum(measured, 0.0), is_measured


@dataclass(frozen=True, kw_only=True)
class ForecastRow:
    """Forecasts of one kind of wear: a trend is ``claimed``, weeks are ``foreseen``, with an
    interval that ``holds`` the truth or is ``half_open``; median error in weeks."""

    wear: str
    valves: int
    claimed: int
    foreseen: int
    holds: int
    half_open: int
    error_weeks: float | None


def forecast_rows(cases: Sequence[ForecastCase]) -> Iterator[ForecastRow]:
    """A row for each kind of wear, and one for all that wear."""
    kinds: list[tuple[str, tuple[WearKind, ...]]] = [(wear.value, (wear,)) for wear in WearKind]
    for name, wears in [*kinds, ("all that wear", tuple(WearKind)[1:])]:
        chosen = [case for case in cases if case.wear in wears]
        foreseen = [case for case in chosen if case.holds is not None]
        errors = [
            abs(case.forecast.until.value - case.weeks)
            for case in foreseen
            if case.forecast.until.value is not None and np.isfinite(case.weeks)
        ]
        yield ForecastRow(
            wear=name,
            valves=len(chosen),
            claimed=sum(case.claimed for case in chosen),
            foreseen=len(foreseen),
            holds=sum(bool(case.holds) for case in foreseen),
            half_open=sum(case.forecast.until.high is None for case in foreseen),
            error_weeks=float(np.median(errors)) if errors else None,
        )


@dataclass(frozen=True, kw_only=True)
class AlertedRow:
    """Valves of one kind of wear that reach the limit, those with an alert before, and how many
    weeks before (median)."""

    wear: str
    valves: int
    crosses: int
    alerted: int
    weeks_ahead: float | None


def alert_rows(watched: Sequence[AlertedValve]) -> Iterator[AlertedRow]:
    """A row for each kind of wear."""
    for wear in WearKind:
        of_kind = [valve for valve in watched if valve.wear is wear]
        ahead = [valve.weeks_ahead for valve in of_kind if valve.weeks_ahead is not None]
        yield AlertedRow(
            wear=wear.value,
            valves=len(of_kind),
            crosses=sum(valve.crosses is not None for valve in of_kind),
            alerted=sum(valve.alerted is not None for valve in of_kind),
            weeks_ahead=float(np.median(ahead)) if ahead else None,
        )
