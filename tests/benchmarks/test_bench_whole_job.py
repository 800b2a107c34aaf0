"""The stages that the benchmark of the whole job times are functions of the program."""

from __future__ import annotations

import importlib
from operator import attrgetter

import pytest

from tests.benchmarks.bench_whole_job import PLACES


@pytest.mark.parametrize("stage", PLACES)
def test_a_stage_is_a_function_of_the_program(stage: str) -> None:
    """A function that is renamed in the program must be renamed in the benchmark too."""
    module, path = PLACES[stage]
    assert callable(attrgetter(path)(importlib.import_module(module)))
