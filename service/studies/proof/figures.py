"""The figures of a blind trial besides rates: fits, errors of S and J, computing time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stemwatch.service.studies.proof.marks import CaseMark
from stemwatch.service.studies.proof.truth import CaseKind

BIASED_PERCENT = 0.3  # of span; a naive value nearer to the truth than this is not biased
QUARTER = 0.25  # of the naive error that the restated one may have at most
MOST_SECONDS = 1.0  # for a valve of 3,600 samples on one core
HOUR = 3600  # samples
_DRAWS = 2000


@dataclass(frozen=True, kw_only=True)
class MedianFit:
    """Median fit in percent, and median error in percent of span, on data that no fit saw."""

    of: int
    fit_naive: float
    fit_extended: float
    rmse_naive: float
    rmse_extended: float


@dataclass(frozen=True, kw_only=True)
class StictionBias:
    """Median absolute error of ``name`` (S or J), percent of span, over ``of`` biased cases.

    ``ratio`` is restated over naive, ``low`` and ``high`` its 95 % bootstrap interval over cases.
    """

    name: str
    of: int
    naive: float
    restated: float
    ratio: float
    low: float
    high: float

    @property
    def reached(self) -> bool:
        """Whether the restated error is at most a quarter of the naive one."""
        return self.ratio <= QUARTER


@dataclass(frozen=True, kw_only=True)
class ComputingTime:
    """Seconds a valve: median and 95th percentile over ``of`` records of at least an hour."""

    of: int
    median: float
    p95: float

    @property
    def reached(self) -> bool:
        """Whether the median valve stays within its second."""
        return self.median <= MOST_SECONDS


def heldout(marks: Sequence[CaseMark]) -> MedianFit | None:
    """Before and after, where physics was hidden and excited and both fits are known.

    A case in which nothing was named counts with its naive fit on both sides.
    """
    rows = []
    for mark in _hidden(marks):
        answer = mark.answer
        row = (answer.fit_naive, answer.fit_extended, answer.rmse_naive, answer.rmse_extended)
        known_values = [value for value in row if value is not None]
        if len(known_values) == len(row):
            rows.append(known_values)
    if not rows:
        return None
    medians = [float(value) for value in np.median(np.array(rows), axis=0)]
    return MedianFit(
        of=len(rows),
        fit_naive=medians[0],
        fit_extended=medians[1],
        rmse_naive=medians[2],
        rmse_extended=medians[3],
    )


def _hidden(marks: Sequence[CaseMark]) -> list[CaseMark]:
    kinds = (CaseKind.SINGLE, CaseKind.PAIR)
    return [m for m in marks if m.truth.kind in kinds and m.truth.excited]


def stiction_errors(marks: Sequence[CaseMark]) -> list[StictionBias]:
    """Naive and restated S and J against the truth, wherever the hidden effect biases the naive.

    A restated number that was withheld counts with the naive one's error.
    """
    biases = []
    for name in ("S", "J"):
        pairs = []
        for mark in _hidden(marks):
            truth, naive = getattr(mark.truth, name), getattr(mark.answer.naive, name)
            if naive is None or abs(naive - truth) <= BIASED_PERCENT:
                continue
            restated = getattr(mark.answer.restated, name)
            pairs.append(
                (abs(naive - truth), abs((naive if restated is None else restated) - truth))
            )
        if pairs:
            biases.append(_bias(name, np.array(pairs)))
    return biases


def _bias(name: str, errors: np.ndarray) -> StictionBias:
    """``errors`` (k, 2): naive and restated, percent of span."""
    naive, restated = np.median(errors, axis=0)
    draws = np.random.default_rng(0).integers(len(errors), size=(_DRAWS, len(errors)))
    medians = np.median(errors[draws], axis=1)
    low, high = np.quantile(medians[:, 1] / medians[:, 0], (0.025, 0.975))
    return StictionBias(
        name=name,
        of=len(errors),
        naive=float(naive),
        restated=float(restated),
        ratio=float(restated / naive),
        low=float(low),
        high=float(high),
    )


def seconds(marks: Sequence[CaseMark]) -> ComputingTime | None:
    """Computing time of records of an hour at 1 s, as the judge states it."""
    times = [m.answer.seconds for m in marks if m.truth.samples >= HOUR]
    if not times:
        return None
    return ComputingTime(
        of=len(times), median=float(np.median(times)), p95=float(np.quantile(times, 0.95))
    )
