"""The methods that answer a benchmark here: stemwatch, and three methods of others.

A ``Method`` is given cases and says what it can of each; a contract test holds every one of them.
"""

from __future__ import annotations

import csv
import json
import os
import subprocess
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from stemwatch.connectors.connector import TagMapping, ValveTags
from stemwatch.connectors.historian import HistorianFile
from stemwatch.models.estimate import Estimate
from stemwatch.models.mismatch.findings import Finding, Mismatch
from stemwatch.models.recording import PERCENT, Recording, Role
from stemwatch.models.screening_result import Screening
from stemwatch.models.verdict import Verdict
from stemwatch.models.without_position.suspicion import Suspicion
from stemwatch.service.executors import Executor, map_in_order
from stemwatch.service.studies.benchmark.answers import (
    MOST_CAUSES,
    CaseAnswer,
    Number,
    Sticks,
)
from stemwatch.service.studies.benchmark.draw import CASES_FILE, TAGS
from stemwatch.service.studies.benchmark.truth import NONE, OTHER

_VERDICTS = {
    Verdict.STICKY: Sticks.YES,
    Verdict.HEALTHY: Sticks.NO,
    Verdict.DEFECTIVE: Sticks.NO,  # not friction, but something else is wrong
}
_HAW_PROGRAM = Path(__file__).with_name("haw_program.py")
_HAW_SHARE = 0.5  # of the cycles of an oscillation that the package marks, from which it sticks
_LONGEST_MESSAGE = 500

OnProgress = Callable[[int], None]


@dataclass(frozen=True, kw_only=True)
class PublicCase:
    """What may be known of a case: its recording, and whether its process integrates."""

    case: str
    file: str
    position: bool
    integrating: bool


class Method(Protocol):
    """Answers to ``cases`` by name, ``on_progress`` hearing how many are done."""

    def __call__(
        self, cases: Sequence[PublicCase], executor: Executor, on_progress: OnProgress
    ) -> Mapping[str, CaseAnswer]: ...


def public_cases(folder: Path) -> tuple[PublicCase, ...]:
    """The cases of a benchmark's folder. Raises ``ValueError`` where it is none."""
    listing = folder / CASES_FILE
    if not listing.is_file():
        raise ValueError(
            f"{folder} holds no {CASES_FILE}; expected a folder that `stemwatch benchmark write` "
            "made"
        )
    with listing.open(encoding="utf-8", newline="") as rows:
        return tuple(
            PublicCase(
                case=row["case"],
                file=str(folder / f"{row['case']}.csv"),
                position=row["position"] == "yes",
                integrating=row["integrating"] == "yes",
            )
            for row in csv.DictReader(rows)
        )


def recording_of(case: PublicCase) -> Recording:
    """The recording of a case, with the roles that its page gives its columns."""
    tags = {
        role: TagMapping(tag=tag, unit=PERCENT)
        for role, tag in TAGS.items()
        if role is not Role.MV or case.position
    }
    return HistorianFile(Path(case.file)).read(ValveTags(valve=case.case, tags=tags))


def stemwatch(
    cases: Sequence[PublicCase], executor: Executor, on_progress: OnProgress
) -> Mapping[str, CaseAnswer]:
    """What `stemwatch screen` says, with its default limits and without the network."""
    return dict(map_in_order(executor, _screened, cases, on_progress))


def _screened(case: PublicCase) -> list[tuple[str, CaseAnswer]]:
    from stemwatch.models.screening.screen import Case, Options, screen

    (screening,) = screen([Case(recording=recording_of(case))], Options(narx=False))
    answer = _with_position(screening) if case.position else _without_position(screening)
    return [(case.case, answer)]


def _with_position(screening: Screening) -> CaseAnswer:
    S, J, mismatch = screening.S, screening.J, screening.mismatch
    if mismatch is not None and mismatch.restated.S.value is not None:
        S, J = mismatch.restated.S, mismatch.restated.J
    return CaseAnswer(
        stiction=_VERDICTS.get(screening.verdict, Sticks.CANNOT_TELL),
        S=_number(S),
        J=_number(J),
        causes=() if mismatch is None else _causes(mismatch),
    )


def _without_position(screening: Screening) -> CaseAnswer:
    suspicion = screening.without_position
    if suspicion is None:
        return CaseAnswer()
    # No sign of an S that a stem seldom has is no answer to whether it sticks.
    sound = Sticks.NO if suspicion.leaves_nothing_to_do else Sticks.CANNOT_TELL
    suspected = suspicion.verdict is Suspicion.SUSPECTED
    return CaseAnswer(stiction=Sticks.YES if suspected else sound, S=_number(suspicion.apparent_S))


def _number(estimate: Estimate) -> Number:
    if estimate.value is None:
        return Number()
    low, high = estimate.low, estimate.high
    return Number(
        value=max(estimate.value, 0.0),
        low=None if low is None else max(low, 0.0),
        high=None if high is None else max(high, 0.0),
    )


def _causes(mismatch: Mismatch) -> tuple[str, ...]:
    """The strongest effect with what cannot be told from it."""
    if mismatch.effects:
        strongest = max(mismatch.effects, key=lambda effect: effect.evidence.mean)
        return strongest.members[:MOST_CAUSES]
    return {Finding.NONE: (NONE,), Finding.UNKNOWN: (OTHER,)}.get(mismatch.finding, ())


@dataclass(frozen=True)
class _Formula:
    """A published formula: see ``models.studies.published_methods``."""

    name: str

    def __call__(
        self, cases: Sequence[PublicCase], executor: Executor, on_progress: OnProgress
    ) -> Mapping[str, CaseAnswer]:
        return dict(map_in_order(executor, self._answer, cases, on_progress))

    def _answer(self, case: PublicCase) -> list[tuple[str, CaseAnswer]]:
        from stemwatch.models.studies.published_methods import PUBLISHED

        recording = recording_of(case)
        op, pv = recording.op, recording.signals[Role.PV]
        usable = op.usable & pv.usable
        times = np.arange(len(recording))
        # These formulas do not allow missing samples.
        op_whole, pv_whole = (
            np.interp(times, times[usable], signal.values[usable]) for signal in (op, pv)
        )
        found = PUBLISHED[self.name](op_whole, pv_whole, integrating=case.integrating)
        return [(case.case, CaseAnswer(stiction=_stiction(found.sticks)))]


def _stiction(sticks: bool | None) -> Sticks:
    return Sticks.CANNOT_TELL if sticks is None else Sticks.YES if sticks else Sticks.NO


@dataclass(frozen=True)
class Haw:
    """HAW's Stiction-Analyser as ``python`` has it installed: see ``haw_program``."""

    python: str

    def __call__(
        self, cases: Sequence[PublicCase], executor: Executor, on_progress: OnProgress
    ) -> Mapping[str, CaseAnswer]:
        answers = {}
        for done, case in enumerate(cases, start=1):
            program = [self.python, str(_HAW_PROGRAM), str(Path(case.file).parent), case.case]
            # The package plots each cycle and classifies the picture.
            surroundings = {**os.environ, "MPLBACKEND": "Agg"}
            process = subprocess.run(
                program, env=surroundings, capture_output=True, text=True, check=False
            )
            if process.returncode:
                raise ValueError(
                    f"{self.python} did not run HAW's Stiction-Analyser on {case.case}: "
                    f"{process.stderr.strip()[-_LONGEST_MESSAGE:]}. docs/benchmark.md says how to "
                    "install it in an environment of its own"
                )
            answers[case.case] = _of_cycles(json.loads(process.stdout)[case.case])
            on_progress(done)
        return answers


def _of_cycles(found: Mapping[str, object]) -> CaseAnswer:
    """Sticks where at least half of the cycles of an oscillation are marked; no answer without an
    oscillation, and where the package broke down."""
    cycles = found.get("cycles")
    if not isinstance(cycles, list) or not cycles:
        return CaseAnswer()
    pairs = [tuple(map(int, str(words).split("/"))) for words in cycles]
    return CaseAnswer(
        stiction=_stiction(any(marked >= _HAW_SHARE * all_ for marked, all_ in pairs))
    )


def method_named(name: str, python: str = "") -> Method:
    """The method ``name``. Raises ``ValueError`` with the names there are."""
    methods: dict[str, Method] = {
        "stemwatch": stemwatch,
        "horch": _Formula("horch"),
        "he": _Formula("he"),
        "haw": Haw(python),
    }
    if name not in methods:
        raise ValueError(f"found the method {name!r}; expected one of {', '.join(methods)}")
    if name == "haw" and not python:
        raise ValueError(
            "the method haw needs --python, the Python of an environment that has the package "
            "stictionanalyser; docs/benchmark.md says how to install it"
        )
    return methods[name]
