"""One answer by several recordings of a loop."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stemwatch.models.estimate import Estimate
from stemwatch.models.studies.loops.draws import draw_recordings
from stemwatch.models.without_position.several_recordings import (
    log_odds_together,
    suspected_together,
)
from stemwatch.models.without_position.suspicion import (
    Suspicion,
    WithoutPosition,
    trained_judge,
)

LIMIT = trained_judge().limits.suspected_from


def answer(score: float | None) -> WithoutPosition:
    """Suspected where the score alone decides."""
    suspected = score is not None and score >= LIMIT
    return WithoutPosition(
        verdict=Suspicion.SUSPECTED if suspected else Suspicion.CANNOT_TELL,
        reason="",
        advice="",
        score=score,
        apparent_S=Estimate.unknown("not asked"),
    )


@given(st.floats(0.0, 1.0))
def test_one_recording_decides_as_it_does_alone(score) -> None:
    """With the limit of one recording."""
    assert suspected_together([answer(score)]) is (score >= LIMIT)


def test_the_better_half_counts() -> None:
    """Of four recordings two, of five three, in any order."""
    odds = [math.log(score / (1.0 - score)) for score in (0.9, 0.8, 0.5)]
    assert log_odds_together([0.1, 0.9, 0.2, 0.8]) == pytest.approx(np.mean(odds[:2]))
    assert log_odds_together([0.1, 0.9, 0.5, 0.2, 0.8]) == pytest.approx(np.mean(odds))


def test_one_suspicion_is_not_borne_out_by_recordings_without_a_sign() -> None:
    """It is by others that come near; recordings without a score say nothing."""
    high, low, near = answer(0.95), answer(0.05), answer(LIMIT - 0.05)
    assert suspected_together([high, near, low, low])
    assert not suspected_together([high, low, low, low])
    assert suspected_together([high, answer(None), answer(None)])
    assert not suspected_together([near, near])  # none is suspected by itself
    assert not suspected_together([])


def test_a_suspicion_of_an_earlier_program_stands_by_itself() -> None:
    """Its networks had another limit."""
    earlier = replace(answer(LIMIT), score=LIMIT - 0.1)
    assert suspected_together([earlier])
    assert not suspected_together([earlier, answer(0.1), answer(0.1)])


def test_recordings_of_a_loop_share_the_loop_and_nothing_else() -> None:
    """The same stem and archive, another course of OP; one seed, one draw."""
    first, second = draw_recordings(5151, 4, 2)
    assert (first.S, first.J, first.story, first.interval_s) == (
        second.S,
        second.J,
        second.story,
        second.interval_s,
    )
    both = min(first.op.size, second.op.size)  # one row fewer where PV was stored a row late
    assert not np.allclose(first.op[:both], second.op[:both], atol=0.1)
    assert np.array_equal(draw_recordings(5151, 4, 3)[1].pv, second.pv)
