"""What follows a finding in a notebook: the twin of the loop, and the planned test."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import stemwatch as sw
from stemwatch.models.field_test.plan import PlanKind
from stemwatch.next_steps import LoopTwin, PlannedTest
from stemwatch.results import ScreenedValve
from tests.service.example_mismatches import of_every_kind
from tests.service.field_test.planned_tests import QUESTION


@pytest.fixture(scope="module")
def screened() -> ScreenedValve:
    """Half an hour of a loop whose valve sticks by 5 %."""
    recording = sw.simulate(S=5.0, J=1.5, minutes=30, valve="FIC-<101>")
    return sw.screen(recording, narx=False, mismatch=False)


@pytest.fixture(scope="module")
def loop(screened: ScreenedValve) -> LoopTwin:
    """The twin of that loop."""
    return sw.twin(screened)


def test_the_twin_of_a_finding_says_what_a_repair_would_save(loop: LoopTwin) -> None:
    """The same in table, text, page and JSON; repair comes first and saves variance."""
    frame = loop.to_frame()
    assert list(frame.index[:3]) == ["recorded", "run as it is", "repaired: S = J = 0"]
    repaired = frame.loc["repaired: S = J = 0"]
    low, high = repaired["variance_saved_percent_low"], repaired["variance_saved_percent_high"]
    assert 0.0 < low < repaired["variance_saved_percent"] < high
    (first, *_) = loop.to_dict()["what_if"]
    assert first["variance_fall_percent"]["value"] == repaired["variance_saved_percent"]
    json.dumps(loop.to_dict(), allow_nan=False)
    text = repr(loop)
    assert text.startswith("Twin of FIC-<101>")
    assert f"variance saved {repaired['variance_saved_percent']:.1f}" in text
    page = loop._repr_html_()
    assert "FIC-&lt;101&gt;" in page
    assert "<script" not in page
    assert "repaired: S = J = 0" in page


def test_a_change_of_ones_own_is_predicted_and_one_without_sense_refused(loop: LoopTwin) -> None:
    """S = J = 0 is what the usual table calls repaired."""
    asked = loop.what_if(S=0.0, J=0.0).predicted["error_std"]
    assert asked.value == loop.to_frame().loc["repaired: S = J = 0", "error_std"]
    knocked = loop.what_if(knocker=(loop.loop.valve.S, 10.0, 2.0)).predicted["error_std"]
    assert knocked.value == pytest.approx(loop.usual[-1].prediction.predicted["error_std"].value)
    for wrong in ({"S": -1.0}, {"gain_times": 0.0}, {"reset_times": float("nan")}):
        with pytest.raises(ValueError, match=next(iter(wrong))):
            loop.what_if(**wrong)
    with pytest.raises(ValueError, match=r"such as \(2, 10, 2\)"):
        loop.what_if(knocker=(5.0, 2.0, 10.0))


def test_a_loop_that_cannot_be_run_again_says_why() -> None:
    """Without PV there is no loop to run."""
    recording = sw.simulate(S=5.0, J=1.5, minutes=10)
    assert recording.mv is not None
    samples = {"op": recording.op.values, "mv": recording.mv.values}
    with pytest.raises(ValueError, match="cannot be run again: PV"):
        sw.twin(**samples, interval_s=1.0, valve="FIC-7")


def test_a_signal_beside_a_finding_is_refused(screened: ScreenedValve) -> None:
    """What was screened has its signals, so that another one would be ignored."""
    with pytest.raises(ValueError, match="mv: a valve that was screened"):
        sw.twin(screened, mv="ZT101")
    with pytest.raises(ValueError, match="zone: this valve has its signals"):
        sw.plan_test(screened, zone="UTC")


def test_a_finding_that_leaves_something_open_gets_its_test(
    screened: ScreenedValve, tmp_path: Path
) -> None:
    """Lag or dead time: the values of OP keep the limits, and the sheet is written."""
    mismatch = replace(of_every_kind()[0], open_question=QUESTION)
    found = ScreenedValve(replace(screened.screening, mismatch=mismatch))
    test = sw.plan_test(found, minutes=3.0, amplitude=3.0, op_now=60.0)
    assert test.kind is PlanKind.TELLS
    assert test.probability is not None
    assert 0.8 < test.probability <= 1.0
    frame = test.to_frame()
    assert frame["op_percent"].between(57.0, 63.0).all()
    assert frame["at_s"].max() < 180.0
    assert "stemwatch never writes to a plant" in repr(test)
    assert "FIC-&lt;101&gt;" in test._repr_html_()
    assert "<script" not in test._repr_html_()
    page, paper = test.write(tmp_path, plant="Unit 7")
    assert "Unit 7" in page.read_text(encoding="utf-8")
    assert paper.read_bytes().startswith(b"%PDF")


def test_samples_without_movement_get_the_bump_test_from_where_op_stood() -> None:
    """Arrays are explained at once; a limit without sense is refused."""
    rng = np.random.default_rng(3)
    samples = {"op": np.full(400, 42.0), "mv": 41.5 + rng.normal(0.0, 0.05, 400)}
    test = sw.plan_test(**samples, interval_s=1.0, valve="FIC-2", minutes=3.0)
    assert isinstance(test, PlannedTest)
    assert test.kind is PlanKind.BUMP
    assert "OP was last at 42.0 %" in repr(test)
    with pytest.raises(ValueError, match="amplitude"):
        sw.plan_test(**samples, interval_s=1.0, amplitude=0.0)
