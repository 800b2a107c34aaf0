"""A kernel that is kept on disk is never older than what it calls, however its keeping ended."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import pytest
from numba import config

from stemwatch.models import compiled as compiled_module
from stemwatch.models.compiled import compiled

KERNEL = """
from stemwatch.models.compiled import compiled
from made_up import numbers
from made_up.numbers import OFFSET, TABLE

@compiled()
def answer(x):
    return scaled(x) + OFFSET + TABLE[1]

@compiled()
def scaled(x):
    return numbers.FACTOR * numbers.power(x)
"""
NUMBERS = """
import numpy as np
from stemwatch.models.compiled import compiled
FACTOR, OFFSET, TABLE = 2.0, 0.5, np.array([1.0, 10.0])

@compiled()
def power(x):
    return x ** 2
"""
ASK = """
from made_up.kernel import answer
print(answer(3.0), sum(answer.stats.cache_hits.values()))
"""
Ask = Callable[[str], tuple[float, int]]


@pytest.fixture
def ask(tmp_path: Path) -> Ask:
    """The kernel's answer with other numbers beside it, in a process of its own, and how often its
    code was found on disk."""
    package = tmp_path / "made_up"
    package.mkdir()
    (package / "__init__.py").touch()
    (package / "kernel.py").write_text(KERNEL, encoding="utf-8")
    ours = Path(compiled_module.__file__).parents[2]

    def answer(numbers: str) -> tuple[float, int]:
        (package / "numbers.py").write_text(numbers, encoding="utf-8")
        path = os.pathsep.join([str(tmp_path), str(ours), os.environ.get("PYTHONPATH", "")])
        environment = {**os.environ, "PYTHONPATH": path, "NUMBA_CACHE_DIR": str(tmp_path / "kept")}
        command = [sys.executable, "-B", "-c", ASK]
        ran = subprocess.run(command, env=environment, capture_output=True, check=True, text=True)
        value, found = ran.stdout.split()
        return float(value), int(found)

    return answer


@pytest.mark.long
def test_a_kernel_is_compiled_again_when_what_it_calls_is_changed(ask: Ask) -> None:
    """A function or a constant of another file, though the kernel's own file stays as it was; what
    is as it was is found again."""
    assert ask(NUMBERS) == (28.5, 0)
    assert ask(NUMBERS) == (28.5, 1)
    for old, new, value in (
        ("x ** 2", "x ** 3", 64.5),  # called by what the kernel calls
        ("FACTOR, OFFSET, TABLE = 2.0, 0.5", "FACTOR, OFFSET, TABLE = 4.0, 0.5", 46.5),
        ("2.0, 0.5", "2.0, 1.5", 29.5),
        ("[1.0, 10.0]", "[1.0, 20.0]", 38.5),
    ):
        assert ask(NUMBERS.replace(old, new)) == (value, 0)


@pytest.fixture
def entries(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[], Any]:
    """Makes what one process has of a kernel's entries on disk."""
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path))

    def of_another_process() -> Any:
        kept = cast(Any, compiled()(twice))._cache
        kept._impl.locator.ensure_cache_path()
        return kept._cache_file

    return of_another_process


def twice(x: float) -> float:
    """Made a kernel by each process."""
    return 2.0 * x


def test_processes_that_compile_at_the_same_time_do_not_mix_their_code(entries) -> None:
    """Two that find no entry yet keep one each, and one is slow in writing: each signature is found
    as it was kept, or not at all."""
    slow, quick, later = entries(), entries(), entries()
    written, write = [], slow._save_data
    slow._save_data = lambda *what: written.append(what)
    save_index = quick._save_index

    def overtaken(*what: object) -> None:
        slow.save("of floats", "code of floats")
        save_index(*what)

    quick._save_index = overtaken
    quick.save("of integers", "code of integers")
    write(*written[0])
    floats, integers = (later.load(f"of {kind}") for kind in ("floats", "integers"))
    assert floats in (None, "code of floats")
    assert integers in (None, "code of integers")
    assert floats or integers


def test_a_process_that_is_killed_while_it_keeps_leaves_no_older_code(entries) -> None:
    """Code of the version before is not found under the new version's name."""
    before, killed, after = entries(), entries(), entries()
    before.save("of floats", "old code")
    killed._source_stamp = after._source_stamp = "of the new version"

    def kill(*_: object) -> None:
        raise KeyboardInterrupt

    for step in ("_save_data", "_save_index"):
        as_ever = getattr(killed, step)
        setattr(killed, step, kill)
        with pytest.raises(KeyboardInterrupt):
            killed.save("of floats", "new code")
        setattr(killed, step, as_ever)
        assert after.load("of floats") is None
    killed.save("of floats", "new code")
    assert after.load("of floats") == "new code"
