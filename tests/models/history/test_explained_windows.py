"""A long recording as windows: which are explained, what they agree on, and what is published."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from itertools import pairwise

import numpy as np
import pytest

from stemwatch.models.history.explained_windows import FEWEST, MOST, explain_windows
from stemwatch.models.mismatch.findings import EffectScore, Finding, FreeRuns, Mismatch
from stemwatch.models.recording import Recording, Role, Signal
from tests.service.example_mismatches import of_every_kind

SAMPLES = 400
PLAY = "lost_motion"
NAMED, CANDIDATES, UNKNOWN, NONE, UNTESTABLE = of_every_kind()


def long_recording(windows: float, start: datetime | None = None) -> Recording:
    """OP that moves all the time, more with every sample."""
    time = np.arange(round(windows * SAMPLES))
    op = 50.0 + (1.0 + time / 400.0) * np.sin(time / 8.0)
    signals = {Role.OP: Signal.good(op, "OP"), Role.MV: Signal.good(op, "MV")}
    return Recording(valve="FV", signals=signals, interval_s=1.0, start=start)


@dataclass
class CannedExplainer:
    """Returns the given results in turn, and records the parts it was called with."""

    answers: list[Mismatch]
    asked: list[Recording] = field(default_factory=list)

    def __call__(self, part: Recording) -> Mismatch:
        answer = self.answers[len(self.asked) % len(self.answers)]
        self.asked.append(part)
        run = np.asarray(part.op.values)
        return replace(answer, seconds=1.0, runs=FreeRuns(naive=run, extended=run, heldout_from=9))


@pytest.mark.parametrize(("windows", "explained"), [(3.9, 0), (4.0, 4), (7.5, 7), (20.0, MOST)])
def test_cost_is_bounded_and_a_short_recording_stays_in_one_piece(windows, explained):
    """From four windows on; never more than eight, and these without a common sample."""
    explainer = CannedExplainer([NONE])
    in_windows = explain_windows(long_recording(windows), SAMPLES, explainer)
    assert len(explainer.asked) == explained
    assert (in_windows is None) == (explained < FEWEST)
    if in_windows is not None:
        ends = [(window.start, window.at) for window in in_windows.windows]
        assert all(a[1] <= b[0] for a, b in pairwise(ends))
        assert all(len(part) >= SAMPLES for part in explainer.asked)
        assert in_windows.mismatch.seconds == explained


def test_windows_are_those_in_which_op_moves_most():
    """Of twenty windows whose movement grows, the last eight."""
    explainer = CannedExplainer([NONE])
    explain_windows(long_recording(20.0), SAMPLES, explainer)
    first = long_recording(20.0).op.values
    assert np.array_equal(explainer.asked[0].op.values, first[12 * SAMPLES : 13 * SAMPLES])
    assert np.array_equal(explainer.asked[-1].op.values, first[19 * SAMPLES :])


def test_what_two_windows_name_is_confirmed_and_shown():
    """The window that is shown names it, on the clock of the whole, with its own S and J; those
    pooled stand beside."""
    start = datetime(2026, 3, 2, 6, tzinfo=UTC)
    in_windows = explain_windows(
        long_recording(4.0, start), SAMPLES, CannedExplainer([NONE, NAMED, NONE, NAMED])
    )
    assert in_windows is not None
    holding = [finding.slug for finding in in_windows.findings if finding.holds]
    assert holding == [effect.slug for effect in NAMED.effects]
    assert in_windows.mismatch.finding is Finding.NAMED
    assert in_windows.shown.first == SAMPLES
    assert in_windows.began == start
    assert in_windows.mismatch.runs.naive.size == 4 * SAMPLES
    assert np.isfinite(in_windows.mismatch.runs.naive[SAMPLES : 2 * SAMPLES]).all()
    assert np.isnan(in_windows.mismatch.runs.naive[:SAMPLES]).all()
    assert in_windows.mismatch.runs.heldout_from == SAMPLES + 9
    assert in_windows.pooled is not None
    assert in_windows.mismatch.restated == NAMED.restated
    assert in_windows.pooled.S.value == pytest.approx(NAMED.restated.S.value)
    assert in_windows.mismatch.p_value == min(finding.p_value for finding in in_windows.findings)


def test_what_one_window_alone_names_is_not_published():
    """The window that is shown names nothing, and the finding is first seen only."""
    in_windows = explain_windows(
        long_recording(5.0), SAMPLES, CannedExplainer([NAMED, NONE, NONE, NONE, NONE])
    )
    assert in_windows is not None
    assert in_windows.mismatch.effects == ()
    assert in_windows.mismatch.finding is Finding.NONE
    assert in_windows.mismatch.p_value is None
    assert [finding.holds for finding in in_windows.findings] == [False] * len(in_windows.findings)
    assert len(in_windows.findings) == len(NAMED.effects)


def test_unknown_is_said_where_most_windows_say_it_and_restates_nothing():
    """S and J are not pooled where some windows hold an unknown effect."""
    in_windows = explain_windows(
        long_recording(5.0), SAMPLES, CannedExplainer([NONE, UNKNOWN, UNKNOWN, UNKNOWN, NONE])
    )
    assert in_windows is not None
    assert in_windows.mismatch.finding is Finding.UNKNOWN
    assert in_windows.mismatch.restated == UNKNOWN.restated
    assert in_windows.pooled is None


def test_the_shown_window_is_explained_again_where_that_may_cost_more():
    """Once, and the same part."""
    answer, repeated = CannedExplainer([NONE]), CannedExplainer([NAMED])
    in_windows = explain_windows(long_recording(4.0), SAMPLES, answer, repeated)
    assert in_windows is not None
    assert len(repeated.asked) == 1
    assert repeated.asked[0].op.values[0] == answer.asked[0].op.values[0]
    assert in_windows.mismatch.seconds == 5.0


def test_windows_that_could_show_nothing_leave_it_untestable():
    """There are no findings and no pooled S and J."""
    in_windows = explain_windows(long_recording(4.0), SAMPLES, CannedExplainer([UNTESTABLE]))
    assert in_windows is not None
    assert in_windows.mismatch.finding is Finding.NOT_TESTABLE
    assert in_windows.findings == ()
    assert in_windows.pooled is None


def scored(mismatch: Mismatch, t: float) -> Mismatch:
    """The mismatch of a window that gains by play with this t, and names nothing of it."""
    return replace(mismatch, scores=(EffectScore(slug=PLAY, mean=0.1, t=t, strength=0.5),))


@pytest.mark.parametrize(
    ("t", "windows", "named"), [(2.0, 5, True), (0.1, 5, False), (2.0, 9, False)]
)
def test_what_the_whole_names_counts_where_the_windows_gain_by_it(t, windows, named):
    """The whole is asked where they gain together, and of a recording that is no longer than they
    are; then what it says is published as it is."""
    play = replace(NAMED.effects[0], slug=PLAY, members=(PLAY,))
    changed = replace(NAMED, effects=(play,), p_value=0.01)
    answers = [scored(NONE, t)] * min(windows, MOST)
    in_windows = explain_windows(
        long_recording(windows), SAMPLES, CannedExplainer([*answers, changed])
    )
    assert in_windows is not None
    assert in_windows.by_whole == ((PLAY,) if named else ())
    assert [finding.holds for finding in in_windows.findings] == [True] * named
    if named:
        assert in_windows.shown is None
        assert in_windows.mismatch.effects == (play,)
        assert in_windows.mismatch.restated == NAMED.restated
        assert in_windows.mismatch.p_value == 0.01
        assert in_windows.mismatch.runs.naive.size == windows * SAMPLES
        assert in_windows.mismatch.seconds == windows + 1
    else:
        assert in_windows.mismatch.finding is Finding.NONE


def test_what_the_whole_names_beyond_what_windows_gain_by_is_not_published():
    """Two effects, of which the windows know one: the answer is theirs."""
    answers = [scored(NONE, 2.0)] * 5
    in_windows = explain_windows(long_recording(5), SAMPLES, CannedExplainer([*answers, NAMED]))
    assert in_windows is not None
    assert in_windows.by_whole == ()
    assert in_windows.mismatch.finding is Finding.NONE
    assert in_windows.mismatch.seconds == 6.0
