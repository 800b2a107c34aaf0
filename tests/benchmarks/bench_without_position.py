"""The method for valves without a position on real loops: labels beside its results.

    python tests/benchmarks/bench_without_position.py --recordings FOLDER

Judges the loops of ``isdb`` and ``refinery`` with the networks that screening uses. The labels are
used for this comparison only.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import pandas as pd

import stemwatch as sw
from stemwatch.models.recording import Recording, Role, Signal
from stemwatch.models.without_position.features import NAMES
from stemwatch.models.without_position.suspicion import (
    Judge,
    Suspicion,
    look_at_loop,
    trained_judge,
)
from stemwatch.service.studies.detection_rates import area_under_roc

GAIN = NAMES.index("gain of both at 25 to a period")


def isdb(folder: Path) -> list[tuple[bool, Recording]]:
    """Whether each loop sticks by its label, and its signals."""
    loops = []
    for row in pd.read_csv(folder / "labels.csv").itertuples():
        columns = pd.read_csv(folder / str(row.file))
        signals = {
            role: Signal.good(columns[role.value.upper()].to_numpy(np.float64), role.value)
            for role in (Role.OP, Role.PV, Role.SP)
        }
        recording = Recording(valve=str(row.loop), signals=signals, interval_s=1.0)
        loops.append((str(row.label) == "stiction", recording))
    return loops


def refinery(folder: Path) -> list[tuple[bool, Recording]]:
    """The same of a refinery's recordings."""
    labels = pd.read_csv(folder / "labels.csv")
    return [
        (str(row.label) == "stiction", sw.read(folder / str(row.file)))
        for row in labels.itertuples()
    ]


def report(name: str, loops: list[tuple[bool, Recording]], judge: Judge) -> None:
    """One line for each set of loops."""
    sticks = np.array([label for label, _ in loops])
    seen = [look_at_loop(recording) for _, recording in loops]
    sentences = [judge.says(item) for item in seen]
    score = np.array([item.score or 0.0 for item in sentences])
    gain = np.array([0.0 if item.shown is None else item.shown.values[GAIN] for item in seen])
    print(f"{name}: {sticks.sum()} labelled as sticking, {np.sum(~sticks)} otherwise")
    for verdict in Suspicion:
        is_it = np.array([item.verdict is verdict for item in sentences])
        print(f"  {verdict.value}: {np.sum(is_it & sticks)} and {np.sum(is_it & ~sticks)}")
    of_score, of_gain = (
        area_under_roc(values[sticks], values[~sticks]) for values in (score, gain)
    )
    print(f"  AUC of the score {of_score:.2f}, of the gain {of_gain:.2f}")
    # A loop of which OP and PV show nothing counts as the least sticking above.
    seen_at_all = np.array([item.score is not None for item in sentences])
    with_score = area_under_roc(score[sticks & seen_at_all], score[~sticks & seen_at_all])
    print(f"  AUC of the {seen_at_all.sum()} with a score {with_score:.2f}")


def main() -> None:
    """Judge both sets."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--recordings", type=Path, required=True)
    result = parser.parse_args()
    judge = trained_judge()
    report("isdb", isdb(result.recordings / "isdb"), judge)
    report("refinery", refinery(result.recordings / "refinery"), judge)


if __name__ == "__main__":
    main()
