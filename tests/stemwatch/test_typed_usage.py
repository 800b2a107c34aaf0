"""Usage as a type checker sees it: this file passes mypy in strict mode, and its examples run."""

from __future__ import annotations

from pathlib import Path
from typing import Any, assert_type

import numpy as np
import pandas as pd
from numpy.typing import NDArray

import stemwatch as sw
from stemwatch.models.estimate import Estimate
from stemwatch.models.verdict import Verdict
from stemwatch.next_steps import LoopTwin, PlannedTest
from stemwatch.results import ExplainedValve, ExplainedValves, ScreenedValve, ScreenedValves


def one_valve(frame: pd.DataFrame, op: NDArray[np.float64]) -> None:
    """One frame, array pair or recording gives one result."""
    assert_type(sw.read(frame, op="op", mv="mv", ranges={"mv": (0, 1)}), sw.Recording)
    assert_type(sw.screen(frame, op="op", mv="mv", zone="Europe/Berlin"), ScreenedValve)
    assert_type(sw.screen(op=op, mv=op.tolist(), interval_s=1), ScreenedValve)
    screened_valve = sw.screen(sw.read(op=op, interval_s=1.0), narx=False)
    assert_type(screened_valve.verdict, Verdict)
    assert_type(screened_valve.S, Estimate)
    assert_type(screened_valve.to_dict(), dict[str, Any])
    assert_type(sw.explain(frame, op="op", mv="mv"), ExplainedValve)


def next_steps(item: sw.Recording, path: Path) -> None:
    """A finding, a recording or a file leads to a twin and to a test."""
    assert_type(sw.twin(sw.screen(item)), LoopTwin)
    assert_type(sw.twin(path, zone="UTC").what_if(S=0.0).predicted, dict[str, Estimate])
    assert_type(sw.plan_test(sw.explain(item), minutes=5), PlannedTest)
    assert_type(sw.plan_test(item).to_frame(), pd.DataFrame)
    assert_type(sw.plan_test(op=[1.0], mv=[1.0], interval_s=1.0).probability, float | None)


def several_valves(path: Path, item: sw.Recording, frame: pd.DataFrame) -> None:
    """A path, a list or a dict gives several."""
    assert_type(sw.screen(path, zone="UTC", separator=";"), ScreenedValves)
    assert_type(sw.screen("exports/*.csv"), ScreenedValves)
    assert_type(sw.screen([item, frame]), ScreenedValves)
    work = sw.screen({"FIC-101": item})
    assert_type(work["FIC-101"], ScreenedValve)
    assert_type(work[:3], list[ScreenedValve])
    assert_type(work.to_frame(), pd.DataFrame)
    assert_type(sw.explain([item]), ExplainedValves)


def test_the_usage_above_runs() -> None:
    """What the type checker was told is so."""
    screened_valve = sw.screen(sw.simulate(minutes=10), narx=False, mismatch=False)
    assert isinstance(screened_valve, ScreenedValve)
    assert isinstance(screened_valve.S, Estimate)
    assert isinstance(
        sw.screen([screened_valve.recording] if screened_valve.recording else []), ScreenedValves
    )
