"""``judge``: CSV files to answers, by ``stemwatch explain`` in processes that see nothing else."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from stemwatch.service.executors import Executor, map_items
from stemwatch.service.proof.said import Said, read_said

CHUNK = 12  # files of one process, so that its start costs little
_LAST_WORDS = 2000  # characters of a failing judge's messages


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
    tell: Callable[[int], None],
    arguments: Sequence[str] = (),
) -> list[Said]:
    """What ``stemwatch explain`` says of ``files`` (names) in ``folder``, in the order of names.

    Each process is given the names of CSV files and works in their folder; the truth is in no file
    yet. ``arguments`` are further options of explain. Raises ``JudgeFailed`` where a process ends
    without an answer for each of its files: a crash is no miss.
    """
    names = sorted(files)
    chunks = [
        _Chunk(str(folder), tuple(names[first : first + CHUNK]), tuple(arguments))
        for first in range(0, len(names), CHUNK)
    ]
    said: list[Said] = []
    for _, answers in map_items(executor, _explain, chunks):
        said += answers
        tell(len(said))
    return sorted(said, key=lambda one: one.file)


def _explain(chunk: _Chunk) -> list[Said]:
    with tempfile.TemporaryDirectory() as home:
        answer = Path(home) / "answer.json"
        ours = ["--json", str(answer), "--workers", "1"]
        command = ["explain", *chunk.files, *ours, *chunk.arguments]
        done = subprocess.run(
            [sys.executable, "-m", "stemwatch.service", *command],
            cwd=chunk.folder,
            env={**os.environ, "OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"},
            capture_output=True,
            encoding="utf-8",
            errors="replace",
            check=False,
        )
        if not answer.is_file():
            raise JudgeFailed(_failure(chunk, f"exit status {done.returncode}", done.stderr))
        said = [read_said(one) for one in json.loads(answer.read_text(encoding="utf-8"))]
    silent = sorted(set(chunk.files) - {one.file for one in said})
    if silent or len(said) != len(chunk.files):
        raise JudgeFailed(
            _failure(chunk, f"no single answer for {silent or 'a file'}", done.stderr)
        )
    return said


def _failure(chunk: _Chunk, what: str, words: str) -> str:
    first, last = chunk.files[0], chunk.files[-1]
    return (
        f"the judging of {first} to {last} failed: {what}; run `stemwatch explain {first}` on the "
        f"kept files (--keep DIR). Its last words: {words[-_LAST_WORDS:].strip() or 'none'}"
    )
