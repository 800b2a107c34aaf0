"""How far S and J are off: by the fit and its breakaways, and by the likelihood of the record.

    python -m tests.benchmarks.bench_stiction [--seed S] [--cases N]

Valves with nothing hidden (``draw_nulls``; every other scatters by 12 %), screened without and with
the question what S and J leave out. Where nothing is named, S and J are then those of the
likelihood (``models.mismatch.stiction.of_likelihood``). One row for each kind of record.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stemwatch.models.estimate import Estimate
from stemwatch.models.screening.screen import Case, Options, screen
from stemwatch.models.studies.simulator.hidden import HiddenCase, draw_nulls, simulate_hidden
from tests.benchmarks.bench_ceiling import stored

WITHOUT, WITH = Options(narx=False, mismatch=False), Options(narx=False)


@dataclass(frozen=True)
class Told:
    """What was told of one valve: the error of S and J, percent, and whether the intervals hold."""

    errors: tuple[float, float]
    hold: tuple[bool, bool]


def judged(case: HiddenCase) -> tuple[Told, Told] | None:
    """By the fit, and by the likelihood; ``None`` where the likelihood does not tell them."""
    case, run = simulate_hidden(case)
    recording = stored(run.recording)
    by_fit, screened = (
        screen([Case(recording=recording)], options)[0] for options in (WITHOUT, WITH)
    )
    mismatch = screened.mismatch
    if mismatch is None or not mismatch.restated.by_likelihood:
        return None
    valve = case.loop.valve
    true = valve.S_read, valve.J_read
    return _told((by_fit.S, by_fit.J), true), _told((screened.S, screened.J), true)


def _told(estimates: Sequence[Estimate], true: Sequence[float]) -> Told:
    errors, hold = [], []
    for estimate, value in zip(estimates, true, strict=True):
        low, told, high = (
            np.nan if one is None else one for one in (estimate.low, estimate.value, estimate.high)
        )
        errors.append(abs(told - value))
        hold.append(bool(low <= value <= high))
    return Told((errors[0], errors[1]), (hold[0], hold[1]))


def row(name: str, pairs: Sequence[tuple[Told, Told]]) -> str:
    """Median errors of S and J, and the share of the intervals that hold, by either way."""
    parts = []
    for told in zip(*pairs, strict=True):
        S, J = np.nanmedian([one.errors for one in told], axis=0)
        hold_S, hold_J = np.mean([one.hold for one in told], axis=0)
        parts.append(f"{S:8.2f}{J:7.2f}{100 * hold_S:9.0f}{100 * hold_J:5.0f}")
    return f"{name:12s}{len(pairs):5d}" + "   ".join(parts)


def main() -> None:
    """Screen the valves, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=4071)
    parser.add_argument("--cases", type=int, default=96)
    requested = parser.parse_args()
    by_kind = defaultdict(list)
    for case in draw_nulls(requested.cases, requested.seed):
        pair = judged(case)
        if pair is not None:
            by_kind[case.concealment].append(pair)
    print(f"{'':17s}{'by fit and breakaways':29s}   {'by the likelihood':29s}")
    heads = f"{'S, %':>8s}{'J, %':>7s}{'hold, %':>9s}{'':5s}"
    print(f"{'record':12s}{'of':>5s}{heads}   {heads}")
    for kind, pairs in by_kind.items():
        print(row(kind, pairs))
    print(row("all", [pair for pairs in by_kind.values() for pair in pairs]))


if __name__ == "__main__":
    main()
