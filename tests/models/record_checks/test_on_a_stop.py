"""A stem on a stop is told as one: neither sticking, nor another valve's, nor tags exchanged."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from stemwatch.models.limits import Limits
from stemwatch.models.record_checks.on_a_stop import find_stop, without_stop
from stemwatch.models.record_checks.quality import assess
from stemwatch.models.recording import Recording, Role, Signal
from stemwatch.models.screening.screen import Case, Options, screen
from stemwatch.models.studies.simulator import PlantLoop, SimulatedValve, simulate_loop
from stemwatch.models.studies.simulator.defects import BodyDefects
from stemwatch.models.studies.simulator.loop import Load, LoadKind
from stemwatch.models.verdict import NoVerdict, Verdict

TARGETS = (52.0, 58.0, 47.0, 59.0, 50.0, 57.0, 46.0, 60.0, 49.0)


@cache
def valve(high: float = 100.0, S: float = 0.3, J: float = 0.1, far: float = 1.0) -> Recording:
    """An hour of set points, of which every other asks for more than a stop at ``high`` lets
    through; the moves ``far`` times as large."""
    moves = tuple((10.0 + 400.0 * k, 52.0 + far * (to - 52.0)) for k, to in enumerate(TARGETS))
    return simulate_loop(
        PlantLoop(
            valve=SimulatedValve(S=S, J=J, body=BodyDefects(high_percent=high)),
            setpoints=moves,
            loads=(Load(kind=LoadKind.COLOURED, size=0.5, time_s=20.0),),
        ),
        7,
    ).recording


def signals_of(op, mv) -> Recording:
    return Recording(
        valve="FV-7",
        signals={Role.OP: Signal.good(op, "OP", "%"), Role.MV: Signal.good(mv, "ZT", "%")},
        interval_s=1.0,
    )


def test_the_place_and_what_op_asked_for_are_told():
    """Place, side, and OP beyond it; what is left lies below."""
    stop = find_stop(valve(high=55.0))
    assert stop.is_high
    assert abs(stop.place - 55.0) < 0.3
    assert stop.op_high > 60.0
    left = without_stop(valve(high=55.0), stop)
    assert left.mv.values[left.usable].max() < 55.0


@pytest.mark.parametrize("quantised", [False, True])
def test_a_stop_is_no_swapped_tag_and_no_frozen_transmitter(quantised):
    """OP ran to its end for most of the time, and the tags were called exchanged."""
    recording = valve(high=52.5, far=2.0)
    if quantised:
        mv = replace(recording.mv, values=np.round(2.0 * recording.mv.values) / 2.0)
        recording = replace(recording, signals={**recording.signals, Role.MV: mv})
    assessment = assess(recording, Limits())
    assert assessment.stop is not None
    told = {obstacle.slug for obstacle in assessment.obstacles}
    assert told <= {"stands_on_a_stop"}


def test_a_low_stop_and_a_reversed_position_are_told_as_well():
    """Either end, and a position that falls as OP rises."""
    op = 50.0 + 25.0 * np.sin(np.arange(4000) / 90.0)
    noise = np.random.default_rng(3).normal(0.0, 0.05, op.size)
    low = find_stop(signals_of(op, np.maximum(op, 41.0) + noise))
    assert (low.is_high, round(low.place)) == (False, 41)
    assert low.op_low < 30.0
    turned = find_stop(signals_of(op, 100.0 - np.maximum(op, 41.0) + noise))
    assert (turned.is_high, round(turned.place)) == (True, 59)
    assert turned.op_low < 30.0


def test_no_stop_at_the_end_of_the_stroke_or_where_the_position_is_in_mm():
    """The seat holds every valve, and OP in percent cannot be set beside mm."""
    op = 50.0 + 70.0 * np.sin(np.arange(4000) / 90.0)
    assert find_stop(signals_of(op, np.clip(op, 0.0, 100.0))) is None
    in_mm = signals_of(op, np.clip(op, 10.0, 70.0))
    assert find_stop(in_mm) is not None
    mv = replace(in_mm.mv, unit="mm")
    assert find_stop(replace(in_mm, signals={**in_mm.signals, Role.MV: mv})) is None


@pytest.mark.parametrize(("S", "J"), [(0.3, 0.1), (4.0, 1.0), (8.0, 6.0), (8.0, 0.2)])
def test_a_stem_that_sticks_or_follows_stands_on_no_stop(S, J):
    """Its rests are at many places."""
    assert find_stop(valve(S=S, J=J)) is None


def test_a_healthy_valve_on_a_stop_has_no_verdict_or_the_stop_as_its_name():
    """It was never called sticky for standing there; nor is it healthy without a word."""
    (screening,) = screen([Case(recording=valve(high=55.0))], Options(narx=False))
    named = {effect.slug for effect in screening.mismatch.effects}
    assert "travel_stop" in named or screening.no_verdict is NoVerdict.STANDS_ON_A_STOP
    assert screening.verdict is not Verdict.STICKY
    (alone,) = screen([Case(recording=valve(high=55.0))], Options(narx=False, mismatch=False))
    assert alone.no_verdict is NoVerdict.STANDS_ON_A_STOP
    assert "never rises above it" in alone.reason
    assert alone.S.high < 1.5


def test_pieces_too_short_to_fit_between_two_stands_are_too_little():
    """The fit broke down on them."""
    op = 60.0 + 25.0 * np.sin(np.arange(4000) / 4.0)
    mv = np.minimum(op, 50.0) + np.random.default_rng(3).normal(0.0, 0.05, op.size)
    (found,) = screen([Case(recording=signals_of(op, mv))], Options(narx=False, mismatch=False))
    assert found.no_verdict is NoVerdict.STANDS_ON_A_STOP
    assert "never rises above it" in found.reason


def test_a_stem_that_sticks_beside_a_stop_is_sticky():
    """S is read off the rest of the recording."""
    recording = valve(high=57.0, S=5.0, J=2.0, far=1.5)
    assert find_stop(recording) is not None
    (screening,) = screen([Case(recording=recording)], Options(narx=False, mismatch=False))
    assert screening.verdict is Verdict.STICKY
    assert abs(screening.S.value - 5.0) < 0.7
