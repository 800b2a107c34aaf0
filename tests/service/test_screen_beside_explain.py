"""``screen`` and ``explain`` of one recording say the same of it."""

from __future__ import annotations

import io
import re

import pytest
from rich.console import Console

from stemwatch.models.limits import Limits
from stemwatch.models.recording import Recording
from stemwatch.models.screening.screen import Case, Options, screen
from stemwatch.models.screening_result import Screening
from stemwatch.models.studies.simulator.hidden import draw_effect, draw_nulls
from stemwatch.models.studies.simulator.loop import PlantLoop
from stemwatch.models.studies.simulator.simulate import simulate_loop
from stemwatch.models.studies.simulator.valve import SimulatedValve
from stemwatch.service.cli.explanation_views import explanation
from stemwatch.service.explain.explain_json import to_object
from stemwatch.service.explain.explain_recording import Explained, explain_recording
from stemwatch.service.presenter.wording import span_percent
from stemwatch.service.report import to_contract

STEPS = tuple((60.0 + 55.0 * k, 50.0 + (-1) ** k * (4.0 + k % 5)) for k in range(32))


def loop(S: float, J: float, duration_s: float = 900.0) -> Recording:
    """A quarter of an hour of steps, or more."""
    steps = tuple(step for step in STEPS if step[0] < duration_s)
    simulated = PlantLoop(
        tag="FIC-1", valve=SimulatedValve(S=S, J=J), setpoints=steps, duration_s=duration_s
    )
    return simulate_loop(simulated, 3).recording


def blind() -> Recording:
    """A recording in which OP hardly moves."""
    return loop(4.0, 2.0).part(0, 240)


def hidden(slug: str, seed: int) -> Recording:
    """A recording with one effect hidden, or none."""
    case = draw_nulls(1, seed)[0] if slug == "null" else draw_effect(slug, 1, seed)[0]
    return case.simulated().recording


KINDS = {
    "sticky": lambda: loop(4.0, 2.0),
    "overshoots": lambda: loop(3.0, 3.8),
    "healthy": lambda: loop(0.3, 0.1),
    "nothing hidden": lambda: hidden("null", 4001),
    "late": lambda: hidden("dead_time", 4000),
    "cannot be judged": blind,
}


def agree_over_windows(screened: Screening, explained: Explained) -> None:
    """Of a record of several windows S and J are one too; those pooled over the windows stand
    beside as an alternative, and nowhere else."""
    mismatch, evidence = to_object(explained), explained.by_window
    assert evidence is not None
    assert mismatch["stiction"]["restated"] == to_contract(screened)["stiction"]
    terminal = Console(width=240, record=True, file=io.StringIO())
    terminal.print(explanation(explained))
    lines = [line.strip() for line in terminal.export_text().splitlines()]
    (counts,) = [line for line in lines if line.startswith("of this valve")]
    assert re.findall(r"[\d.]+", counts)[0] == span_percent(screened.S.value)
    pooled = [line for line in lines if line.startswith("not used: over the windows")]
    assert len(pooled) == (evidence.pooled is not None)
    assert (evidence.pooled_sentence in explained.mismatch.sentence) or evidence.pooled is None
    assert mismatch["by_window"]["S"] != mismatch["stiction"]["restated"]["S"]


def agree(screened: Screening, explained: Explained) -> None:
    """Every number and sentence that both tell is one; what is not used is called that."""
    told, mismatch = to_contract(screened), to_object(explained)
    terminal = Console(width=240, record=True, file=io.StringIO())
    terminal.print(explanation(explained))
    lines = terminal.export_text().splitlines()
    if screened.mismatch is None:
        assert screened.reason in mismatch["sentence"]
        assert mismatch["verdict"] != "none"
        return
    assert mismatch["stiction"]["restated"] == told["stiction"]
    assert told["mismatch"]["stiction"] == mismatch["stiction"]
    for name in ("verdict", "sentence", "effects", "heldout", "not_testable", "record_effects"):
        assert mismatch[name] == told["mismatch"][name], name
    (line,) = [line for line in lines if line.strip().startswith("of this valve")]
    if screened.S.value is not None:
        numbers = re.findall(r"[\d.]+", line)
        assert numbers[0] == span_percent(screened.S.value)
    alternatives = [line for line in lines if line.strip().startswith("not used: ")]
    same = mismatch["stiction"]["naive"] == mismatch["stiction"]["restated"]
    assert len(alternatives) == (0 if same else 1)


# Of the kinds with an effect and without, one each in the short run.
IN_LONG = ("late", "healthy")


@pytest.mark.parametrize(
    "kind",
    [pytest.param(kind, marks=[pytest.mark.long] if kind in IN_LONG else []) for kind in KINDS],
)
def test_s_and_j_and_what_was_left_out_are_one(kind: str) -> None:
    """Of a valve of every kind: S, J, finding, effects, sentence, fit."""
    recording = KINDS[kind]()
    (screened,) = screen([Case(recording=recording)], Options(narx=False))
    agree(screened, explain_recording(recording, "a.csv", narx=False))


@pytest.mark.long
def test_s_and_j_of_a_record_of_four_windows_are_one() -> None:
    """What `explain` cuts into windows and `screen` fits in one stretch."""
    limits = Limits(fitted_samples=440.0)
    recording = loop(4.0, 2.0, 1780.0)
    (screened,) = screen([Case(recording=recording)], Options(limits=limits, narx=False))
    agree_over_windows(screened, explain_recording(recording, "a.csv", narx=False, limits=limits))
