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
    LAST_THAT_COUNT,
    clearest,
    log_odds_together,
    of_loop,
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


def told(score: float) -> WithoutPosition:
    """Suspected with an S where the score alone decides, or else without a sign."""
    if score >= LIMIT:
        return replace(
            answer(score),
            reason="Sticking is suspected.",
            advice="Do a bump test.",
            apparent_S=Estimate(value=2.5, low=1.9, high=3.3, unit="%"),
        )
    return replace(answer(score), verdict=Suspicion.NO_SIGN, reason="No sign.")


def test_where_no_recording_looks_like_sticking_the_newest_answers() -> None:
    """Nothing is said of the others, and a first recording has none."""
    newest = told(0.05)
    assert of_loop(newest, [told(0.1)] * 7) is newest
    assert of_loop(told(0.9), []) == told(0.9)


def test_the_newest_suspicion_is_shown_or_else_the_clearest() -> None:
    """Of answers that counted others too, what each says alone decides."""
    assert clearest([told(0.9), told(0.99)]) == 0
    assert clearest([told(0.05), told(0.9), told(0.99), told(0.95)]) == 2
    pooled = replace(told(0.9), recordings=3, alone=told(0.05))
    assert clearest([pooled, told(0.95)]) == 1
    assert clearest([told(0.05), told(0.1)]) is None


def test_a_newest_suspicion_that_others_bear_out_says_so() -> None:
    """With its own S, and the score of all."""
    together = of_loop(told(0.9), [told(0.95), told(0.9), told(0.05)])
    assert together.verdict is Suspicion.SUSPECTED
    assert together.reason.endswith(
        "Taken with earlier ones: 3 of its 4 recordings look like sticking, and together they bear "
        "it out."
    )
    assert together.apparent_S == told(0.9).apparent_S
    assert together.recordings == 4
    assert together.alone == told(0.9)
    assert 0.9 < (together.score or 0.0) < 0.95


def test_earlier_recordings_raise_the_suspicion_that_the_newest_does_not() -> None:
    """The clearest of them gives S and advice; what the newest says by itself is kept."""
    clearest = replace(told(0.97), apparent_S=Estimate(value=3.0, low=2.0, high=4.0, unit="%"))
    together = of_loop(told(0.05), [told(0.9), clearest, told(0.9)])
    assert together.verdict is Suspicion.SUSPECTED
    assert (together.apparent_S.value, together.advice) == (3.0, "Do a bump test.")
    assert "In the clearest it sticks by about 3.0 % of OP (2.0 to 4.0)." in together.reason
    assert together.reason.endswith("The newest recording alone: No sign.")
    assert together.alone == told(0.05)
    unread = replace(answer(None), reason="OP and PV cannot tell: PV is not in this recording.")
    assert of_loop(unread, [told(0.9), told(0.9)]).verdict is Suspicion.SUSPECTED


def test_one_suspicion_among_many_recordings_leaves_it_open() -> None:
    """Neither suspected nor without a sign; a reason that says what to mend stays."""
    together = of_loop(told(0.05), [told(LIMIT), *[told(0.05)] * 6])
    assert together.verdict is Suspicion.CANNOT_TELL
    assert "1 of its 8 recordings looks like sticking" in together.reason
    assert together.apparent_S.value is None
    assert together.advice == "Do a bump test."
    unread = replace(answer(None), reason="OP and PV cannot tell: PV is not in this recording.")
    assert of_loop(unread, [told(LIMIT), *[told(0.05)] * 6]).reason == unread.reason


def test_what_a_recording_said_by_itself_counts_once() -> None:
    """An earlier answer that stood for several counts as what it said alone, and only the last
    eight count."""
    earlier = of_loop(told(0.05), [told(0.9), told(0.9)])
    assert earlier.verdict is Suspicion.SUSPECTED
    assert of_loop(told(0.05), [earlier]) == told(0.05)
    long_ago = [told(0.05)] * (LAST_THAT_COUNT - 1) + [told(0.99)] * 9
    assert of_loop(told(0.05), long_ago) == told(0.05)


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
