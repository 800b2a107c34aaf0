"""``judge``: runs ``stemwatch explain`` on the CSV files, in processes that see nothing else.

A ``BlindAnswer`` holds the JSON of ``stemwatch explain`` for one recording.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from stemwatch.models.record_checks.validity_checks import FROZEN_FOR, ONLY_NOISE, UNCHANGED
from stemwatch.service.executors import Executor, map_in_order

NOTHING = "nothing named"
# By which a refusal is known, since the JSON of ``stemwatch explain`` has the sentence alone.
FROZEN_WORDS = (UNCHANGED, ONLY_NOISE, FROZEN_FOR)
CHUNK = 12  # files of one process, so that its start-up time matters little
_LONGEST_MESSAGE = 2000  # characters of a failing process's messages


@dataclass(frozen=True, kw_only=True)
class NamedEffect:
    """An effect that was named: its slug, and all that the recording cannot tell from it."""

    slug: str
    members: tuple[str, ...]

    def holds(self, slug: str) -> bool:
        """Whether ``slug`` is it, or one of its class."""
        return slug == self.slug or slug in self.members


@dataclass(frozen=True, kw_only=True)
class StictionNumbers:
    """S and J in percent of span; ``None`` where explain gives none."""

    S: float | None = None
    J: float | None = None


@dataclass(frozen=True, kw_only=True)
class BlindAnswer:
    """One judged recording: the names, strongest first, and the figures beside them.

    ``fit_naive`` and ``fit_extended`` in percent, on data that the fit did not see; ``reason`` why
    there is no S, where there is none.
    """

    file: str
    verdict: str
    names: tuple[NamedEffect, ...] = ()
    record_effects: tuple[str, ...] = ()
    not_testable: tuple[str, ...] = ()
    naive: StictionNumbers = field(default_factory=StictionNumbers)
    restated: StictionNumbers = field(default_factory=StictionNumbers)
    fit_naive: float | None = None
    fit_extended: float | None = None
    rmse_naive: float | None = None
    rmse_extended: float | None = None
    seconds: float = 0.0
    reason: str = ""

    @property
    def label(self) -> str:
        """The answer as a table of confusions names it."""
        if self.names:
            return " + ".join(name.slug for name in self.names)
        return NOTHING if self.verdict in ("none", "") else self.verdict


def read_answer(stored: Mapping[str, Any]) -> BlindAnswer:
    """One object of the JSON of ``stemwatch explain``.

    Raises ``ValueError`` with what is missing where it does not follow the contract.
    """
    try:
        heldout, stiction = stored["heldout"] or {}, stored["stiction"] or {}
        reason = _no_s(stiction.get("naive"))
        # A refusal because the position was frozen has found that effect of the record.
        frozen = any(words in reason for words in FROZEN_WORDS)
        refused_for = ("frozen_signal",) if frozen else ()
        return BlindAnswer(
            file=Path(stored["recording"]).name,
            verdict=str(stored["verdict"]),
            names=tuple(
                NamedEffect(slug=effect["slug"], members=tuple(effect["class"]))
                for effect in stored["effects"]
            ),
            record_effects=_slugs(stored["record_effects"]) + refused_for,
            not_testable=_slugs(stored["not_testable"]),
            naive=_numbers(stiction.get("naive")),
            restated=_restated(stored),
            fit_naive=heldout.get("fit_naive"),
            fit_extended=heldout.get("fit_extended"),
            rmse_naive=heldout.get("rmse_naive"),
            rmse_extended=heldout.get("rmse_extended"),
            seconds=float(stored["seconds"]),
            reason=reason,
        )
    except KeyError as missing:
        raise ValueError(
            f"the JSON of explain lacks {missing} for {stored.get('recording', 'a recording')}; "
            f"received the fields {sorted(stored)}"
        ) from missing


def _restated(stored: Mapping[str, Any]) -> StictionNumbers:
    """S and J with what was named: of a long recording over the windows that name it."""
    over_windows = _numbers(stored.get("by_window"))
    if over_windows.S is not None:
        return over_windows
    return _numbers((stored["stiction"] or {}).get("restated"))


def _slugs(stored: Sequence[Mapping[str, Any]]) -> tuple[str, ...]:
    return tuple(str(effect["slug"]) for effect in stored if effect.get("slug"))


def _no_s(stored: Mapping[str, Any] | None) -> str:
    return str(((stored or {}).get("S") or {}).get("reason") or "")


def _numbers(stored: Mapping[str, Any] | None) -> StictionNumbers:
    """S and J; a missing object or a null value is no number."""
    values = {name: ((stored or {}).get(name) or {}).get("value") for name in ("S", "J")}
    return StictionNumbers(S=values["S"], J=values["J"])


class JudgeFailed(ValueError):
    """The judging process ended without an answer."""


@dataclass(frozen=True)
class _Chunk:
    """Files that one process judges: their folder, and their names."""

    folder: str
    files: tuple[str, ...]
    arguments: tuple[str, ...]


def judge(
    folder: Path,
    files: Sequence[str],
    executor: Executor,
    on_progress: Callable[[int], None],
    arguments: Sequence[str] = (),
) -> list[BlindAnswer]:
    """The answers of ``stemwatch explain`` on ``files`` (names) in ``folder``, in order of names.

    Each process gets the names of CSV files and works in their folder; the truth is in no file yet.
    ``arguments`` are further options of explain. Raises ``JudgeFailed`` where a process ends
    without an answer for each of its files, since a crash must not count as a miss.
    """
    names = sorted(files)
    chunks = [
        _Chunk(str(folder), tuple(names[first : first + CHUNK]), tuple(arguments))
        for first in range(0, len(names), CHUNK)
    ]
    answers = map_in_order(executor, _explain, chunks, on_progress)
    return sorted(answers, key=lambda answer: answer.file)


def _explain(chunk: _Chunk) -> list[BlindAnswer]:
    with tempfile.TemporaryDirectory() as home:
        answer = Path(home) / "answer.json"
        options = ["--json", str(answer), "--workers", "1"]
        command = ["explain", *chunk.files, *options, *chunk.arguments]
        process = subprocess.run(
            [sys.executable, "-m", "stemwatch.service", *command],
            cwd=chunk.folder,
            env={**os.environ, "OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"},
            capture_output=True,
            encoding="utf-8",
            errors="replace",
            check=False,
        )
        if not answer.is_file():
            raise JudgeFailed(_failure(chunk, f"exit status {process.returncode}", process.stderr))
        answers = [read_answer(load) for load in json.loads(answer.read_text(encoding="utf-8"))]
    silent = sorted(set(chunk.files) - {answer.file for answer in answers})
    if silent or len(answers) != len(chunk.files):
        raise JudgeFailed(
            _failure(chunk, f"no single answer for {silent or 'a file'}", process.stderr)
        )
    return answers


def _failure(chunk: _Chunk, stage: str, words: str) -> str:
    first, last = chunk.files[0], chunk.files[-1]
    return (
        f"the judging of {first} to {last} failed: {stage}; run `stemwatch explain {first}` on the "
        f"kept files (--keep DIR). Its last words: {words[-_LONGEST_MESSAGE:].strip() or 'none'}"
    )
