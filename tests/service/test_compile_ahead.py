"""The first run compiles in two workers, beside what else there is to do."""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Callable, Generator, Iterable, Sequence
from typing import Any

import pytest

from stemwatch.models.compile_kernels import OF_A_SCREENING
from stemwatch.service.executors import ExecutorUnavailable, InProcess
from stemwatch.service.executors.compile_ahead import compile_ahead
from stemwatch.service.executors.executor import Answer, Failure

COMPILED = """
import gc
from dataclasses import replace
from numba.core.registry import CPUDispatcher
from stemwatch.models.screening.screen import Case, screen
from stemwatch.models.studies.simulator import draw_sticky, simulate_loop
from stemwatch.models.compile_kernels import Kernels, compile_kernels

def compiled():
    kernels = [one for one in gc.get_objects() if isinstance(one, CPUDispatcher)]
    names = [(one.py_func.__module__, one.py_func.__name__, one.signatures) for one in kernels]
    return {(module, name, str(sig)) for module, name, sigs in names for sig in sigs
            if module.startswith("stemwatch.models") and ".studies." not in module}

recording = simulate_loop(replace(draw_sticky(1, 7)[0], duration_s=1500.0), 1).recording
compile_kernels(list(Kernels))
ahead = compiled()
screen([Case(recording=recording)])
print(len(ahead), sorted(compiled() - ahead))
"""


class Workers:
    """An executor that does nothing but note what it is asked, or fail as it is told to."""

    workers = 2

    def __init__(self, error: Exception | None = None, failure: Failure | None = None) -> None:
        self.asked: list[Any] = []
        self.error, self.failure, self.go_on = error, failure, threading.Event()

    def hand_out(
        self,
        work: Callable[[Sequence[Any]], Sequence[Any]],
        batches: Iterable[Sequence[Any]],
        stop: threading.Event,
        *,
        alone: bool = False,
    ) -> Generator[Answer[Any]]:
        self.go_on.wait(10.0)
        if self.error is not None:
            raise self.error
        for index, batch in enumerate(batches):
            self.asked += batch
            yield Answer(index=index, results=batch, failure=self.failure)


@pytest.mark.long
def test_a_screening_compiles_nothing_that_was_not_compiled_ahead() -> None:
    """Every kernel that a valve needs, with the types that it is called with."""
    command = [sys.executable, "-c", COMPILED]
    process = subprocess.run(command, capture_output=True, check=True, text=True)
    count, missing = process.stdout.split(maxsplit=1)
    assert int(count) >= 20
    assert missing.strip() == "[]"


def test_it_is_done_beside_other_work_and_waited_for() -> None:
    """Each part is a batch of its own; the block goes on meanwhile, and ends after them."""
    workers = Workers()
    with compile_ahead(workers):
        assert not workers.asked
        workers.go_on.set()
    assert workers.asked == list(OF_A_SCREENING)


def test_an_executor_that_works_here_compiles_when_it_has_to() -> None:
    """Nothing is compiled ahead where nobody could do it meanwhile."""
    with compile_ahead(InProcess()):
        assert "compiling" not in {thread.name for thread in threading.enumerate()}


@pytest.mark.parametrize(
    "workers",
    [Workers(ExecutorUnavailable("no workers")), Workers(failure=Failure(reason="no workers"))],
)
def test_what_cannot_be_compiled_ahead_is_only_told(
    workers: Workers, caplog: pytest.LogCaptureFixture
) -> None:
    """It costs time, no result: whoever needs the kernels compiles them."""
    workers.go_on.set()
    with compile_ahead(workers):
        pass
    assert "kernels could not be compiled ahead: no workers" in caplog.text


def test_a_block_that_fails_ends_the_compiling() -> None:
    """Nobody waits for kernels that nobody will use."""
    workers = Workers()
    with pytest.raises(ZeroDivisionError), compile_ahead(workers):
        raise ZeroDivisionError
    assert not workers.asked
    workers.go_on.set()
