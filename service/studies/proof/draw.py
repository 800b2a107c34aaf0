"""Writes the cases of a blind trial to files with neutral names, and seals their truth.

The files are CSV as an operator exports them from a historian.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from stemwatch.models.recording import Floats, Recording, Role
from stemwatch.models.studies.simulator.hidden import (
    CONCEALMENTS,
    EFFECTS,
    RARE,
    HiddenCase,
    draw_effect,
    draw_hidden,
    draw_nulls,
    draw_unknown,
    simulate_hidden,
)
from stemwatch.service.executors import Executor, map_in_order
from stemwatch.service.studies.proof.truth import OUTSIDE, RECORD_EFFECTS, CaseTruth, Seal, seal

START = datetime(2026, 3, 2, 6, 0, tzinfo=UTC)
SUFFIX = {Role.OP: "OP", Role.MV: "ZT", Role.PV: "PV", Role.SP: "SP"}
BATCH = 6
NOTHING = "none"
POSITIONER = "positioner"  # not in the mixed population, only on request

OnProgress = Callable[[int], None]


def write_case(file: Path, recording: Recording, tags: Mapping[Role, str] | None = None) -> None:
    """Time, output, position, process variable and set point in percent, one row a sample.

    Without ``tags`` they are made of the file's name alone, so that they do not reveal the truth. A
    sample without a value is written as ``Bad``.
    """
    tags = tags or {role: f"{file.stem}.{suffix}" for role, suffix in SUFFIX.items()}
    roles = [role for role in SUFFIX if role in recording.signals]
    columns = [_cells(recording.signals[role].values) for role in roles]
    with file.open("w", encoding="utf-8", newline="") as out:
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(["Time", *(tags[role] for role in roles)])
        writer.writerow(["", *("%" for _ in roles)])
        writer.writerows(zip(_times(recording.time_s), *columns, strict=True))


def _cells(values: Floats) -> list[str]:
    return [f"{value:.4f}" if np.isfinite(value) else "Bad" for value in values.tolist()]


def _times(stamps_s: Floats) -> list[str]:
    """UTC with its offset; milliseconds only where there are any."""
    fine = "seconds" if np.all(stamps_s == np.round(stamps_s)) else "milliseconds"
    return [
        (START + timedelta(seconds=second)).isoformat(sep=" ", timespec=fine)
        for second in stamps_s.tolist()
    ]


@dataclass(frozen=True)
class _SimulationBatch:
    """Cases that one worker simulates, each with the file it becomes."""

    cases: tuple[tuple[HiddenCase, str], ...]


def draw_cases(count: int, seed: int, effect: str = "", concealment: str = "") -> list[HiddenCase]:
    """``count`` cases of the mixed population, or a part of it.

    ``effect`` is a slug of the catalogue, the name of an effect outside it, "unknown" for all of
    those, or "none"; alone, its cases are concealed by routine. ``concealment`` alone takes a fifth
    of nulls, a tenth outside the catalogue, and for the rest all effects in turn. Raises
    ``ValueError`` with the words there are.
    """
    _check("effect", effect, (NOTHING, OUTSIDE, *EFFECTS, *RARE))
    _check("concealment", concealment, (*CONCEALMENTS, POSITIONER))
    under = concealment or CONCEALMENTS[0]
    if effect == NOTHING:
        return draw_nulls(count, seed, concealment or None)
    if effect == OUTSIDE:
        return draw_unknown(count, seed, under)
    if effect:
        return draw_effect(effect, count, seed, under)
    return _concealed(count, seed, under) if concealment else draw_hidden(count, seed)


def _check(noun: str, word: str, allowed: Sequence[str]) -> None:
    if word and word not in allowed:
        raise ValueError(f"no {noun} {word!r} is ever drawn; there are {', '.join(allowed)}")


def _concealed(count: int, seed: int, concealment: str) -> list[HiddenCase]:
    nulls, outside = count // 5, count // 10
    slugs = tuple(EFFECTS)
    rounds = -(-(count - nulls - outside) // len(slugs))
    effects = [draw_effect(slug, rounds, seed, concealment) for slug in slugs]
    singles = [case for turn in zip(*effects, strict=True) for case in turn]
    return [
        *draw_nulls(nulls, seed, concealment),
        *draw_unknown(outside, seed, concealment),
        *singles[: count - nulls - outside],
    ]


def file_names(count: int, seed: int) -> list[str]:
    """A name for each of ``count`` cases, numbered in an order shuffled with ``seed``.

    Neither a name nor its place in the folder says what was drawn.
    """
    numbers = np.random.default_rng([seed, count]).permutation(count) + 1
    return [f"FIC-{number:04d}.csv" for number in numbers.tolist()]


def write_cases(
    cases: Sequence[HiddenCase],
    seed: int,
    folder: Path,
    executor: Executor,
    on_progress: OnProgress,
) -> Seal:
    """Simulate ``cases`` into CSV files in ``folder`` and seal what they hold.

    ``on_progress`` hears how many are done.
    """
    names = file_names(len(cases), seed)
    seeded = [(case, str(folder / name)) for case, name in zip(cases, names, strict=True)]
    orders = [
        _SimulationBatch(tuple(seeded[first : first + BATCH]))
        for first in range(0, len(seeded), BATCH)
    ]
    return seal(map_in_order(executor, _fill, orders, on_progress))


def _fill(order: _SimulationBatch) -> list[CaseTruth]:
    return [_write(case, Path(file)) for case, file in order.cases]


def _write(hidden_case: HiddenCase, file: Path) -> CaseTruth:
    case, simulated = simulate_hidden(hidden_case)
    write_case(file, simulated.recording)
    truth = simulated.truth
    return CaseTruth(
        file=file.name,
        hidden=case.hidden,
        effects=case.effects,
        record_effects=_of_record(*case.effects, *truth.effects),
        concealment=case.concealment,
        excited=case.excited,
        excitation=_as_floats(case.excitation),
        S=truth.S,
        J=truth.J,
        scatter=case.loop.valve.scatter,
        samples=len(simulated.recording),
        sizes=_as_floats(case.sizes),
    )


def _as_floats(numbers: Mapping[str, float]) -> dict[str, float]:
    return {name: float(number) for name, number in numbers.items()}


def _of_record(*slugs: str) -> tuple[str, ...]:
    """The effects of the record among ``slugs``: hidden on purpose, or concealing another."""
    return tuple(slug for slug in RECORD_EFFECTS if slug in slugs)
