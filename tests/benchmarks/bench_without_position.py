"""The method for valves without a position on real loops: labels beside its results.

    python tests/benchmarks/bench_without_position.py --recordings FOLDER

Judges the loops of ``isdb`` and ``refinery`` with the networks that screening uses, each recording
by itself and then the recordings of a valve together, as screening does. The labels are used for
this comparison only.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

import stemwatch as sw
from stemwatch.models.recording import Recording, Role, Signal
from stemwatch.models.without_position.features import NAMES
from stemwatch.models.without_position.several_recordings import log_odds_together, of_loop
from stemwatch.models.without_position.suspicion import (
    Judge,
    Suspicion,
    WithoutPosition,
    look_at_loop,
    trained_judge,
)
from stemwatch.service.studies.detection_rates import area_under_roc

GAIN = NAMES.index("gain of both at 25 to a period")


@dataclass(frozen=True)
class Labelled:
    """A recording, the valve that it is of, and whether that sticks by its label."""

    valve: str
    sticks: bool
    recording: Recording


def isdb(folder: Path) -> list[Labelled]:
    """The loops of the stiction data base, one recording of each."""
    loops = []
    for row in pd.read_csv(folder / "labels.csv").itertuples():
        columns = pd.read_csv(folder / str(row.file))
        signals = {
            role: Signal.good(columns[role.value.upper()].to_numpy(np.float64), role.value)
            for role in (Role.OP, Role.PV, Role.SP)
        }
        recording = Recording(valve=str(row.loop), signals=signals, interval_s=1.0)
        loops.append(Labelled(str(row.loop), str(row.label) == "stiction", recording))
    return loops


def refinery(folder: Path) -> list[Labelled]:
    """A refinery's loops, of some several recordings, in the order of their labels."""
    labels = pd.read_csv(folder / "labels.csv")
    return [
        Labelled(str(row.tag), str(row.label) == "stiction", sw.read(folder / str(row.file)))
        for row in labels.itertuples()
    ]


def report(name: str, loops: list[Labelled], judge: Judge) -> None:
    """What is said of the recordings of one set, each by itself."""
    sticks = np.array([loop.sticks for loop in loops])
    seen = [look_at_loop(loop.recording) for loop in loops]
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
    if len({loop.valve for loop in loops}) < len(loops):
        by_valve(loops, sentences)


def by_valve(loops: list[Labelled], sentences: list[WithoutPosition]) -> None:
    """What the recordings of each valve say together."""
    of_valve: dict[str, list[WithoutPosition]] = {}
    for loop, sentence in zip(loops, sentences, strict=True):
        of_valve.setdefault(loop.valve, []).append(sentence)
    labels = {loop.valve: loop.sticks for loop in loops}
    sticks = np.array([labels[valve] for valve in of_valve])
    together = [of_loop(answers[-1], answers[-2::-1]) for answers in of_valve.values()]
    print(f"  by valve: {sticks.sum()} labelled as sticking, {np.sum(~sticks)} otherwise")
    for verdict in Suspicion:
        is_it = np.array([answer.verdict is verdict for answer in together])
        print(f"    {verdict.value}: {np.sum(is_it & sticks)} and {np.sum(is_it & ~sticks)}")
    scores = [
        [answer.score for answer in answers if answer.score is not None]
        for answers in of_valve.values()
    ]
    with_score = np.array([bool(found) for found in scores])
    odds = np.array([log_odds_together(found) if found else -np.inf for found in scores])
    of_all = area_under_roc(odds[sticks], odds[~sticks])
    of_scored = area_under_roc(odds[sticks & with_score], odds[~sticks & with_score])
    print(f"    AUC {of_all:.2f}, of the {with_score.sum()} with a score {of_scored:.2f}")


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
