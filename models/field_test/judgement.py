"""``judge_test``: which rival model the recording of a planned test supports, if any.

Each rival is fitted to the recorded MV, within the uncertainty that the first recording left in its
parameters; the one that fits best is the ``best``. Its significance comes from simulation:
responses are drawn from each other rival over the OP that was really recorded, and a rival is ruled
out where hardly any of its own responses favours the best as much as the recorded one does. That is
the likelihood ratio test by simulation (Davison and Hinkley 1997, ch. 4,
doi:10.1017/CBO9780511802843).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from stemwatch.models.field_test.programme import RESOLUTION
from stemwatch.models.field_test.rival_runs import RivalFit, RivalRuns
from stemwatch.models.mismatch.measurement.flow import as_position
from stemwatch.models.mismatch.open_question import SLOW, OpenQuestion, RivalModel
from stemwatch.models.preparation.own_clock import on_own_clock
from stemwatch.models.recording import PERCENT, Floats, Recording
from stemwatch.models.signals.excitation import swing
from stemwatch.models.signals.holes import bridged
from stemwatch.models.signals.percent import without_impossible_values
from stemwatch.models.stickslip.clock_shift import brought_forward, find_op_late
from stemwatch.models.stickslip.stored_range import in_percent

# Responses of each rival: if one is as far as the recorded one, the p value is 2/40.
RESPONSES_DRAWN = 39
RULED_OUT = 0.05
MOST_SAMPLES = 2400  # of a recording; a longer one is thinned to every second, third, ... sample
FEWEST_SAMPLES = 30
# Of the first recording's length: a test this long can show effects that grow over it.
LEAST_LENGTH_FOR_GROWTH = 0.5
LEAST_USABLE = 0.8
# Largest cost of the best rival, over the median cost of its own responses: no stem is exactly the
# element, and 6 to 8 is usual where the lag's true size lies a little beyond its known range.
FOLLOWS_WITHIN = 10.0


class TestOutcome(StrEnum):
    """The result of a recorded test for the rivals."""

    __test__ = False  # not a test class for pytest

    FOLLOWS = "follows"  # MV follows one of them, and the others are ruled out
    CANNOT_TELL = "cannot_tell"  # others follow it about as well
    NONE_FOLLOWS = "none_follows"  # MV follows none of them
    NOT_TESTABLE = "not_testable"  # the recording does not hold the test


@dataclass(frozen=True, kw_only=True)
class TestJudgement:
    """The result of a recorded test.

    ``fits`` has one fit for each of ``models``; ``best`` is the index of the one with the least
    cost. ``as_far`` (m,) is the p value of each rival: the probability that one of its own
    responses favours the best as much as the recorded one; 1 for the best itself, and where only
    hours would show the difference. ``leaves`` is the cost of the best over the median cost of its
    own responses. ``op`` and ``mv`` (n,) in percent every ``interval_s`` seconds are the judged
    recording. ``reason`` says why nothing could be judged.
    """

    __test__ = False  # not a test class for pytest

    outcome: TestOutcome
    models: tuple[RivalModel, ...] = ()
    fits: tuple[RivalFit, ...] = ()
    best: int = 0
    as_far: tuple[float, ...] = ()
    leaves: float = 0.0
    interval_s: float = 1.0
    op: Floats | None = None
    mv: Floats | None = None
    reason: str = ""

    @property
    def winner(self) -> str | None:
        """The slug of the rival that MV follows, the others being ruled out; else ``None``."""
        return self.models[self.best].slug if self.outcome is TestOutcome.FOLLOWS else None

    @property
    def left(self) -> tuple[str, ...]:
        """The slugs of the rivals that are not ruled out, the best first; none where MV follows
        none of them."""
        if self.outcome not in (TestOutcome.FOLLOWS, TestOutcome.CANNOT_TELL):
            return ()
        order = np.argsort([fit.cost for fit in self.fits], kind="stable")
        return tuple(self.models[k].slug for k in order if self.as_far[k] > RULED_OUT)


def judge_test(question: OpenQuestion, recording: Recording) -> TestJudgement:
    """Which of the rivals of ``question`` the ``recording`` of the test supports.

    The recording should hold little more than the test, because each cost is taken over all of it.
    Never raises for what it holds.
    """
    models = question.models
    recording = without_impossible_values(on_own_clock(in_percent(recording)))
    recording = brought_forward(recording, find_op_late(recording))
    if recording.mv is not None and recording.mv.unit != PERCENT:
        read = as_position(recording)
        recording = recording if read is None else read[0]
    reason = _why_not_judged(recording)
    if reason:
        return TestJudgement(outcome=TestOutcome.NOT_TESTABLE, models=models, reason=reason)
    assert recording.mv is not None
    stride = -(-len(recording) // MOST_SAMPLES)
    signals = (recording.op, recording.mv)
    op, mv = (bridged(signal.values, signal.usable)[::stride] for signal in signals)
    interval_s = recording.interval_s * recording.unit_s * stride
    travel = op if question.curve is None else question.curve.command(op)
    interval_units = interval_s / question.unit_s
    runs = RivalRuns(question, models, np.ascontiguousarray(travel), interval_units)
    fits = tuple(runs.fit(model, mv) for model in models)
    best = int(np.argmin([fit.cost for fit in fits]))
    # An effect that grows over a whole record is nearly constant in a test of minutes.
    short = op.size * interval_s < LEAST_LENGTH_FOR_GROWTH * question.duration * question.unit_s
    slow = SLOW if short else frozenset()
    rng = np.random.default_rng(1970)
    own_costs = [_own_cost(runs, models[best], rng) for _ in range(RESPONSES_DRAWN)]
    leaves = fits[best].cost / float(np.median(own_costs))
    costs = np.array([fit.cost for fit in fits])
    # A residual that no rival explains supports none of them: the margin is in units of that
    # residual.
    margins = (costs - costs[best]) / max(leaves, 1.0)
    as_far = tuple(
        1.0
        if k == best or slow & {models[k].slug, models[best].slug}
        else _as_far(runs, k, best, float(margins[k]), rng)
        for k in range(len(models))
    )
    judgement = TestJudgement(
        outcome=TestOutcome.FOLLOWS,
        models=models,
        fits=fits,
        best=best,
        as_far=as_far,
        leaves=leaves,
        interval_s=interval_s,
        op=op,
        mv=mv,
    )
    return replace(judgement, outcome=_outcome(judgement))


def _outcome(judgement: TestJudgement) -> TestOutcome:
    if judgement.leaves > FOLLOWS_WITHIN:
        return TestOutcome.NONE_FOLLOWS
    others = [distance for k, distance in enumerate(judgement.as_far) if k != judgement.best]
    return TestOutcome.FOLLOWS if max(others, default=0.0) <= RULED_OUT else TestOutcome.CANNOT_TELL


def _own_cost(runs: RivalRuns, model: RivalModel, rng: np.random.Generator) -> float:
    return runs.fit(model, runs.draw_response(model, rng)).cost


def _as_far(
    runs: RivalRuns, rival: int, best: int, margin: float, rng: np.random.Generator
) -> float:
    """The probability that a response of ``rival`` costs it ``margin`` more than it costs the best;
    the recorded response counts as one of them.
    """
    beyond_count = 1
    for _ in range(RESPONSES_DRAWN):
        answer = runs.draw_response(runs.models[rival], rng)
        cost_difference = (
            runs.fit(runs.models[rival], answer).cost - runs.fit(runs.models[best], answer).cost
        )
        beyond_count += cost_difference >= margin
    return beyond_count / (RESPONSES_DRAWN + 1.0)


def _why_not_judged(recording: Recording) -> str:
    """Why the recording cannot be judged, as a sentence without its full stop; empty
    where it can.
    """
    if recording.mv is None:
        return "the position (MV) is not in the recording of the test"
    if recording.mv.unit != PERCENT:
        return f"{recording.mv.tag} is in {recording.mv.unit or 'an unknown unit'}, not in percent"
    samples, usable = len(recording), int(np.count_nonzero(recording.usable))
    if samples < FEWEST_SAMPLES or usable < LEAST_USABLE * samples:
        return (
            f"{usable} of {samples} samples can be used; expected at least {FEWEST_SAMPLES}, and "
            f"{LEAST_USABLE:.0%} of them"
        )
    moved = swing(recording.op.values[recording.usable])
    if moved < 2.0 * RESOLUTION:
        return f"OP moves by {moved:.2g} % only: is this the recording of the test?"
    return ""
