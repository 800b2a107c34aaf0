"""The valves of a benchmark, drawn in pairs, and their recordings as plain CSV.

Two plant families, neither of which is the model that stemwatch fits: the loops of the proof, whose
valves may have one effect beside friction, and the loops of the trial, healthy ones that oscillate
for other reasons and sticking ones in limit cycles. What is published of a recording (its place,
its columns, its length, whether its process integrates) is drawn before the truth, so that it says
nothing of it.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from stemwatch.models.recording import Recording, Role
from stemwatch.models.studies.simulator import PlantLoop, draw_healthy, draw_sticky, simulate_loop
from stemwatch.models.studies.simulator.hidden import (
    CONCEALMENTS,
    HiddenCase,
    draw_effect,
    draw_nulls,
    draw_unknown,
    simulate_hidden,
)
from stemwatch.models.studies.simulator.hidden.air import AIR
from stemwatch.models.studies.simulator.hidden.friction import FRICTION
from stemwatch.models.studies.simulator.hidden.sensing import SENSING
from stemwatch.service.executors import Executor, map_in_order
from stemwatch.service.studies.benchmark.truth import NONE, OTHER, ValveTruth
from stemwatch.service.studies.proof.draw import write_case

GROUP = 8  # cases: sticking or not, with or without position, of either family
SAMPLES = 3600  # of 1 s
TAGS = {Role.OP: "OP", Role.MV: "MV", Role.PV: "PV", Role.SP: "SP"}
CASES_FILE = "cases.csv"
_INTEGRATING = 0.25  # share of the loops
_MOST_DRAWS = 400
_EFFECT = "effect"
# Used in turn, so that no single answer is right for more than half of the cases.
_CAUSES = {
    True: (_EFFECT, NONE, _EFFECT, OTHER, _EFFECT, _EFFECT, NONE, _EFFECT),
    False: (_EFFECT, _EFFECT, NONE, _EFFECT, _EFFECT, NONE, _EFFECT, NONE),
}
_SLUGS = {
    True: tuple(effect.slug for effect in (*AIR, *FRICTION, *SENSING)),
    False: tuple(effect.slug for effect in (*AIR, *SENSING)),
}
_CONCEALMENTS = tuple(word for word in CONCEALMENTS if word != "short")


@dataclass(frozen=True, kw_only=True)
class DrawnCase:
    """One recording, what is published of its loop, and its truth; ``case`` is still empty."""

    recording: Recording
    integrating: bool
    truth: ValveTruth


@dataclass(frozen=True, kw_only=True)
class CaseToDraw:
    """One case: the set's seed, its place in the drawing, and the file that it becomes."""

    seed: int
    place: int
    file: str


def write_cases(
    count: int, seed: int, folder: Path, executor: Executor, on_progress: Callable[[int], None]
) -> tuple[ValveTruth, ...]:
    """``count`` recordings in ``folder``, with a list of what may be known of them; their truths in
    the order of the names, which are numbered in a shuffled order.

    Raises ``ValueError`` where ``count`` is no multiple of ``GROUP``.
    """
    if count < GROUP or count % GROUP:
        raise ValueError(
            f"found {count} cases; expected a multiple of {GROUP}: half of the valves stick, half "
            "of the recordings have a position, half are of either plant family"
        )
    numbers = np.random.default_rng([seed, count]).permutation(count) + 1
    orders = [
        CaseToDraw(seed=seed, place=place, file=str(folder / f"case-{number:04d}.csv"))
        for place, number in enumerate(numbers.tolist())
    ]
    drawn = sorted(
        map_in_order(executor, _write, orders, on_progress),
        key=lambda written: written[0].case,
    )
    with (folder / CASES_FILE).open("w", encoding="utf-8", newline="") as out:
        rows = csv.writer(out, lineterminator="\n")
        rows.writerow(["case", "position", "integrating", "cause asked"])
        for truth, integrating in drawn:
            rows.writerow(
                [truth.case, *(_word(x) for x in (truth.position, integrating, bool(truth.cause)))]
            )
    return tuple(truth for truth, _ in drawn)


def _word(value: bool) -> str:
    return "yes" if value else "no"


def _write(order: CaseToDraw) -> list[tuple[ValveTruth, bool]]:
    drawn, file = draw_case(order.seed, order.place), Path(order.file)
    write_case(file, drawn.recording, TAGS)
    return [(replace(drawn.truth, case=file.stem), drawn.integrating)]


def draw_case(seed: int, place: int) -> DrawnCase:
    """The case at ``place`` of a set; it depends on its place and the seed alone."""
    sticks, position, proof = place % 2 == 0, place // 2 % 2 == 0, place // 4 % 2 == 0
    # Of a pair: the same for the valve that sticks and for the one that does not.
    integrating = bool(np.random.default_rng([seed, place // 2, 20]).random() < _INTEGRATING)
    rng = np.random.default_rng([seed, place, 21])
    draw = _of_proof if proof else _of_trial
    recording, S, J, cause = draw(rng, place // GROUP, sticks, position, integrating)
    signals = dict(recording.part(0, SAMPLES).signals)
    if not position:
        del signals[Role.MV]
    return DrawnCase(
        recording=replace(recording.part(0, SAMPLES), signals=signals),
        integrating=integrating,
        truth=ValveTruth(case="", position=position, S=S, J=J, cause=cause),
    )


def _of_trial(
    rng: np.random.Generator, _: int, sticks: bool, __: bool, integrating: bool
) -> tuple[Recording, float, float, str]:
    for _attempt in range(_MOST_DRAWS):
        seed = int(rng.integers(2**31))
        loops = draw_sticky(4, seed) if sticks else draw_healthy(6, seed)
        loop = loops[int(rng.integers(len(loops)))]
        if loop.process.integrating == integrating and loop.duration_s >= SAMPLES:
            run = simulate_loop(replace(loop, duration_s=float(SAMPLES)), seed)
            return run.recording, run.truth.S, run.truth.J, ""
    raise AssertionError("the families hold loops of either process")


def _of_proof(
    rng: np.random.Generator, turn: int, sticks: bool, position: bool, integrating: bool
) -> tuple[Recording, float, float, str]:
    causes = _CAUSES[sticks]
    kind = causes[turn % len(causes)] if position else NONE
    for _attempt in range(_MOST_DRAWS):
        case = _hidden_case(rng, kind, sticks)
        if case.loop.process.integrating != integrating:
            continue
        case, run = simulate_hidden(case)
        if case.excited:  # the cause is not asked where the effect does not show in the recording
            cause = OTHER if kind == OTHER else (case.effects or (NONE,))[0]
            return run.recording, run.truth.S, run.truth.J, cause if position else ""
    raise AssertionError("the family holds excited loops of either process")


def _hidden_case(rng: np.random.Generator, kind: str, sticks: bool) -> HiddenCase:
    seed, concealment = int(rng.integers(2**31)), str(rng.choice(_CONCEALMENTS))
    if kind == NONE:
        (case,) = draw_nulls(1, seed, concealment)
    elif kind == OTHER:
        case = draw_unknown(7, seed, concealment)[int(rng.integers(7))]
    else:
        slug = str(rng.choice(_SLUGS[sticks]))
        (case,) = draw_effect(slug, 1, seed, concealment)
    if sticks:
        return case
    S = float(rng.uniform(0.1, 0.6))
    J = S * float(rng.uniform(0.0, 0.3))
    return replace(case, loop=_sound(case.loop, S, J), plain=_sound(case.plain, S, J))


def _sound(loop: PlantLoop, S: float, J: float) -> PlantLoop:
    return replace(loop, valve=replace(loop.valve, S=S, J=J))


def recordings_of(folder: Path) -> Sequence[Path]:
    """The recordings of a benchmark's folder, in the order of their names."""
    return sorted(folder.glob("case-*.csv"))
