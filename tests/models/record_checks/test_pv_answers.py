"""Whose position PV answers: this valve's, or another's that follows the same set points."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from stemwatch.models.limits import Limits
from stemwatch.models.record_checks.pv_answers import PvAnswers
from stemwatch.models.record_checks.quality import assess
from stemwatch.models.record_checks.wiring_checks import WiringEvidence, wiring_obstacles
from stemwatch.models.recording import Recording, Role, Signal
from stemwatch.models.stickslip.best_pairing import BestShift
from stemwatch.models.studies.simulator import draw_sticky, simulate_loop
from stemwatch.service.studies.miswiring import RecordedValve, draw_miswired, record


@cache
def healthy_valve() -> RecordedValve:
    """A healthy flow loop, with a sticking one that follows the same set points."""
    return record(draw_miswired(6, 8383)[5])


def with_position_of(recording: Recording, other: Recording) -> Recording:
    assert other.mv is not None
    mv = Signal.good(other.mv.values, "ZT-OTHER", other.mv.unit)
    return replace(recording, signals={**recording.signals, Role.MV: mv})


@pytest.mark.long
def test_the_position_of_another_valve_with_the_same_set_points_is_refused() -> None:
    """OP alone tells what PV does; the sentence says how much, and which tag to check."""
    seen = healthy_valve()
    wired = with_position_of(seen.recording, seen.same_programme)
    answers = PvAnswers.of(wired)
    assert answers.of_op_only
    assert answers.op_alone > 0.7
    assessment = assess(wired, Limits())
    (obstacle,) = assessment.obstacles or wiring_obstacles(assessment.recording)
    assert obstacle.slug == "position_unanswered"
    assert "the same set points" in obstacle.reason
    assert wiring_obstacles(seen.recording) == []


@pytest.mark.parametrize("late", [0, 5])
@pytest.mark.parametrize("index", range(3))
def test_pv_answers_its_own_sticking_valve(index: int, late: int) -> None:
    """Where the stem stands tells more of PV than OP does, and as much if it is stored late."""
    recording = simulate_loop(draw_sticky(3, 5151)[index], 3).recording
    assert recording.mv is not None
    at = np.maximum(np.arange(len(recording)) - late, 0)
    stored = Signal.good(recording.mv.values[at], recording.mv.tag, recording.mv.unit)
    answers = PvAnswers.of(replace(recording, signals={**recording.signals, Role.MV: stored}))
    assert not answers.of_op_only


def test_under_loads_alone_nothing_is_said() -> None:
    """OP stands for the load, which nobody records, and would tell most of what PV does."""
    recording = simulate_loop(draw_sticky(9, 5151)[8], 5_151_248).recording
    assert np.isnan(PvAnswers.of(recording).op_alone)
    assert wiring_obstacles(recording) == []


def test_without_pv_nothing_is_said() -> None:
    """Nor of a recording that is too short."""
    recording = healthy_valve().recording
    signals = {role: signal for role, signal in recording.signals.items() if role is not Role.PV}
    for one in (replace(recording, signals=signals), recording.part(0, 200)):
        assert np.isnan(PvAnswers.of(one).op_alone)
        assert not PvAnswers.of(one).of_op_only


@pytest.mark.parametrize(("left", "doubted"), [(0.29, False), (0.42, True)])
def test_a_position_that_follows_op_closely_is_not_anothers(left: float, doubted: bool) -> None:
    """Loads that nobody records make OP tell of PV. A sticking valve's own position leaves 0.29 of
    its moves at most there, another's of the same programme 0.41 and more."""
    seen = WiringEvidence.of(simulate_loop(draw_sticky(1, 5151)[0], 3).recording)
    assert seen is not None
    vars(seen).update(at_most=BestShift(left, 0.0, 4.5), pv_answers=PvAnswers(0.7, 600.0))
    assert seen.of_another_loop is doubted
