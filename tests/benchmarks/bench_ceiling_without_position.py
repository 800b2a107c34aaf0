"""What is possible without a position: a likelihood ratio that knows the loop, beside the product.

    python -m tests.benchmarks.bench_ceiling_without_position [--seed S] [--loops N]

Own loops of ``stemwatch study-without-position`` are judged by the ratio of the likelihoods of PV
with a stem that sticks and with a sound one, each averaged over how stems are drawn (Neyman and
Pearson 1933, doi:10.1098/rsta.1933.0009). It sees every scan and is told the process, the
disturbances' spectra, the noise and, once, the very steps and waves; not the stem. So what it
misses no method can find.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from stemwatch.models.recording import Floats
from stemwatch.models.studies.loops.draws import WARM_UP, DrawnLoop, LoopScans, draw_with_scans
from stemwatch.models.without_position.suspicion import Suspicion, trained_judge
from stemwatch.service.studies.detection_rates import area_under_roc
from stemwatch.service.studies.without_position.count import studied
from stemwatch.service.studies.without_position.draw import LoopToDraw, look_item
from tests.benchmarks.stem_filter import (
    NO_WAVE,
    KnownLoop,
    behind_air,
    pole_of,
    stem_likelihood,
    wave_of,
)

LEFT_OUT = "sensor"  # loops whose sensor has play: behind it PV is not Gaussian
SWINGS, SIZES = (0.0, 5.0, 8.0, np.inf), (1.0, 2.0, 4.0, 8.0)
ALARMS = (0.02, 0.05)


@dataclass(frozen=True, kw_only=True)
class Compared:
    """One loop: ln of the ratio where steps and waves are told and where their spectra are, S by
    each, and the product's answer."""

    seed: int
    place: int
    story: str
    S: float
    swings: float
    shaped: bool  # steps or waves act on it
    as_it_was: bool  # every scan was stored, and unchanged
    told_waves: float
    by_spectra: float
    S_told_waves: float
    S_by_spectra: float
    score: float
    alarm: float
    verdict: Suspicion
    S_said: float | None


def known(scans: LoopScans, tell_waves: bool) -> KnownLoop:
    """The loop at every scan of its record, with its steps and waves or with their spectra."""
    numbers, acting = scans.numbers, scans.disturbances
    places = np.maximum(np.arange(WARM_UP, scans.op.size) - numbers.delay, 0)
    ones = np.ones(scans.op.size)
    seen, shaped, waves = scans.pv - scans.sp[0], np.zeros(places.size), (NO_WAVE, NO_WAVE)
    if tell_waves:
        seen, shaped = seen - acting.push, acting.shaped[places]
    else:
        waves = wave_of(acting.shaped), wave_of(acting.push)
    return KnownLoop(
        numbers=numbers,
        air=behind_air(scans, WARM_UP),
        seen=seen[WARM_UP:],
        rounding=numbers.pv_step**2 / 12.0 + (1e-4 * numbers.process_gain) ** 2,
        shaped=shaped,
        wandering=np.array([(part.size, pole_of(part.time)) for part in acting.wandering]),
        where=np.stack([(ones if p.where is None else p.where)[places] for p in acting.wandering]),
        noise=(scans.noise_size, pole_of(scans.noise_time)),
        waves=waves,
    )


def ratio(loop: KnownLoop, seed: int) -> tuple[float, float]:
    """ln of the likelihood ratio, and S, should it stick."""
    sound, sticking = (
        stem_likelihood(loop, sticks, np.random.default_rng([seed, sticks]))
        for sticks in (False, True)
    )
    return sticking.log_likelihood - sound.log_likelihood, sticking.S


def _as_it_was(loop: DrawnLoop, scans: LoopScans) -> bool:
    """Whether every scan was stored, and unchanged."""
    signals = (loop.op, scans.op[WARM_UP:]), (loop.pv, scans.pv[WARM_UP:])
    return all(np.array_equal(stored, true) for stored, true in signals)


def compare(seed: int, place: int) -> Compared | None:
    """Own loop number ``place`` of ``seed``; ``None`` where it is left out."""
    loop, scans = draw_with_scans(seed, place)
    if loop.story == LEFT_OUT:
        return None
    answer = studied(trained_judge(), look_item(LoopToDraw(seed, place))[0])
    told_waves, S_told_waves = ratio(known(scans, True), place)
    by_spectra, S_by_spectra = ratio(known(scans, False), place)
    acting = scans.disturbances
    return Compared(
        seed=seed,
        place=place,
        story=loop.story,
        S=loop.S,
        swings=answer.swings,
        shaped=bool(np.ptp(acting.shaped) > 0.0 or np.ptp(acting.push) > 0.0),
        as_it_was=_as_it_was(loop, scans),
        told_waves=told_waves,
        by_spectra=by_spectra,
        S_told_waves=S_told_waves,
        S_by_spectra=S_by_spectra,
        score=answer.score or 0.0,
        alarm=answer.alarm,
        verdict=answer.verdict,
        S_said=None if answer.apparent_S is None else answer.apparent_S[0],
    )


def rows(loops: Sequence[Compared]) -> Iterator[tuple[str, list[Compared]]]:
    """The loops in each row of the table."""
    yield "all", list(loops)
    for low, high in pairwise(SWINGS):
        yield f"{low:g} to {high:g} swings", [x for x in loops if low <= x.swings < high]
    for low, high in pairwise(SIZES):
        of_size = [x for x in loops if x.S == 0.0 or low <= x.S < high]
        yield f"S {low:g} to {high:g} %, and all sound", of_size
    for shaped, name in ((False, "no step, no wave"), (True, "steps or waves")):
        yield name, [x for x in loops if x.shaped is shaped]
    stored = [x for x in loops if x.as_it_was]
    yield "every scan stored, unchanged", stored
    yield "the same, no step, no wave", [x for x in stored if not x.shaped]


def found(sticks: Floats, sound: Floats) -> str:
    """AUC, and the share found at 2 and 5 % false alarms."""
    at = [np.mean(sticks > np.quantile(sound, 1.0 - share)) for share in ALARMS]
    return f"{area_under_roc(sticks, sound):.2f}; {at[0]:.2f}, {at[1]:.2f}"


SCORES: dict[str, Callable[[Compared], float]] = {
    "steps and waves told": lambda x: x.told_waves,
    "their spectra told": lambda x: x.by_spectra,
    "the score": lambda x: x.score,
    "all rules": lambda x: x.alarm,
}


def main() -> None:
    """Compare the loops and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, nargs="+", default=[5151])
    parser.add_argument("--loops", type=int, default=120)
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    drawn = (compare(seed, place) for seed in asked.seed for place in range(asked.loops))
    loops = [loop for loop in drawn if loop is not None]
    if asked.json:
        asked.json.write_text(json.dumps([asdict(loop) for loop in loops], indent=1))
    print("| AUC; found at 2, 5 % | " + " | ".join(SCORES) + " |\n|---|" + "---|" * len(SCORES))
    for name, part in rows(loops):
        sticks, sound = ([x for x in part if (x.S > 0.0) is it] for it in (True, False))
        if sticks and sound:
            cells = [
                found(np.array([of(x) for x in sticks]), np.array([of(x) for x in sound]))
                for of in SCORES.values()
            ]
            print(f"| {name}, {len(sticks)} + {len(sound)} | " + " | ".join(cells) + " |")


if __name__ == "__main__":
    main()
