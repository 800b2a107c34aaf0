"""``Judge``: what OP and PV alone show of the valve: sticking suspected, no sign of it, or
undecided.

Never a verdict and never a J: loops without a position show J only as an uncertain share of S. The
limits come from simulated loops whose truth is known (``SuspicionLimits``).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cache

import numpy as np
from scipy.special import ndtr

from stemwatch.models.estimate import Estimate
from stemwatch.models.recording import PERCENT, Floats, Recording, Role, Signal
from stemwatch.models.signals.holes import bridged, longest_stretch
from stemwatch.models.without_position import trained_weights
from stemwatch.models.without_position.features import (
    NAMES,
    PER_PERIOD,
    Evidence,
    dominant_period,
    evidence,
)
from stemwatch.models.without_position.hammerstein import block_means
from stemwatch.models.without_position.network import LoopNetwork, LoopScore, unpacked
from stemwatch.models.without_position.no_sign import MOSTLY, WIDEST_PERCENT, NoSignLimit
from stemwatch.models.without_position.picture import ElementTraces, element_traces
from stemwatch.models.without_position.weighed_size import weighed_log_S
from stemwatch.models.without_position.windows import windows

FEWEST_SAMPLES = 120  # two scales of blocks need them
ENOUGH_PERIODS = 8  # in a record; with fewer swings most signs are too weak
# of a long record the last ones, after averaging to at most 400 samples a period
MOST_SAMPLES = 8000
_THINNED_TO = 400  # samples in a period
LEAST_S_PERCENT = 1.0  # less is what a sound valve may have
SOUND_S_PERCENT = 0.4  # and this is what it usually has at most: the score asks for more
# "no sign" is no reason to leave a valve alone where only more than this would have shown
SMALL_S_PERCENT = 2.0
MOST_S_PERCENT = 8.0  # that only more would have shown is no answer; no loop taught more
LONGEST_BRIDGE = 3  # missing samples that a straight line replaces
MOST_AT_LIMIT = 0.3
MOST_HELD = 0.9  # of PV repeating its last value
MOST_BELOW_SHUT = 0.25  # of OP below -0.5: then it is centred or scaled and not in percent
FEWEST_MOVES = 30  # changes of OP
LEAST_MOVED_PERCENT = 0.3
_ROUND = NAMES.index("triangle beside sine, OP")
_TEST = (
    "Do a bump test: step OP by about 1 % one way until PV answers, then back, and compare what "
    "each way takes; or record the position for an hour with a portable transmitter."
)
_LONGER = (
    "Export OP and PV over ten swings of the loop and more, or record the position for an hour "
    "with a portable transmitter."
)
_FASTER = "Export OP and PV raw and at a shorter interval, over at least ten swings of the loop."
NOTHING_TO_DO = "Nothing to do at the valve on these grounds."
_SCALE = "Give OP's values at 0 and 100 % in the plant file (low, high), and screen the loop again."


class Suspicion(StrEnum):
    """The result from OP and PV."""

    SUSPECTED = "suspected"
    NO_SIGN = "no_sign"
    CANNOT_TELL = "cannot_tell"


@dataclass(frozen=True, kw_only=True)
class WithoutPosition:
    """The result from OP and PV with its reason and advice.

    ``score`` (0 to 1) is that of ``sticking_score``; ``likeness`` that of the networks alone,
    whatever S; ``apparent_S`` in percent of OP; ``shows_from`` the S from which sticking would have
    been detected in four cases of five; ``rivals`` other causes that the data cannot exclude.
    Where earlier ``recordings`` of the loop count too (``several_recordings.of_loop``), ``score``
    is that of all together, and ``alone`` is what this recording says by itself.
    """

    verdict: Suspicion
    reason: str
    advice: str
    score: float | None = None
    likeness: float | None = None
    apparent_S: Estimate
    shows_from: float | None = None
    rivals: tuple[str, ...] = ()
    traces: ElementTraces | None = None  # of what is suspected
    recordings: int = 1
    alone: WithoutPosition | None = None

    @property
    def leaves_nothing_to_do(self) -> bool:
        """Whether there is no sign of sticking, and even an S of ``SMALL_S_PERCENT`` of OP would
        have shown: then nobody need ask for a position."""
        return self.verdict is Suspicion.NO_SIGN and _is_small(
            self.shows_from, self.apparent_S.unit
        )


def _is_small(shows: float | None, unit: str) -> bool:
    """Whether an S that would have shown is small; in a unit that nobody knows it is not known."""
    return shows is not None and unit == PERCENT and shows <= SMALL_S_PERCENT


@dataclass(frozen=True, kw_only=True)
class SuspicionLimits:
    """The score from which sticking is suspected; and which S would have shown at a lower one."""

    suspected_from: float
    no_sign: NoSignLimit


@dataclass(frozen=True, kw_only=True)
class SeenLoop:
    """A recording as the networks see it, or why it cannot be judged and what would help.

    With a doubt and evidence both, there is a score, and no answer but "cannot tell".
    """

    unit: str  # of OP; empty where it is not known
    samples: int = 0
    thinned_by: int = 1  # samples of the recording to one of these
    shown: Evidence | None = None
    windows: Floats | None = None
    doubt: tuple[str, str] | None = None


def look_at_loop(recording: Recording) -> SeenLoop:
    """OP and PV of ``recording`` prepared for the networks, whether or not there is a position."""
    unit = _unit_of_op(recording.op)
    unusable = _unusable(recording)
    if unusable is not None:
        return SeenLoop(unit=unit, doubt=unusable)
    op, pv, sp, thinned_by = usable_signals(recording)
    try:
        loop_evidence = evidence(op, pv)
    except ValueError:
        return SeenLoop(unit=unit, doubt=("OP or PV stands still where both are known", _FASTER))
    cut = windows(op, pv, sp, loop_evidence.period)
    return SeenLoop(
        unit=unit,
        samples=op.size,
        thinned_by=thinned_by,
        shown=loop_evidence,
        windows=cut,
        doubt=_doubt(recording),
    )


def usable_signals(recording: Recording) -> tuple[Floats, Floats, Floats | None, int]:
    """OP, PV and, if it is known throughout, SP of the longest stretch that can be judged, (n,)
    each, and how many samples of the recording are the mean that is one of these."""
    return _thinned(*_longest(recording)[1:])


def _unit_of_op(op: Signal) -> str:
    """The unit of OP; unknown where it is said to be percent but goes far below 0."""
    below = np.mean(op.values[op.usable] < -0.5) if op.usable.any() else 0.0
    return "" if op.unit == PERCENT and below > MOST_BELOW_SHUT else op.unit


def suspect(recording: Recording, judge: Judge) -> WithoutPosition:
    """The result from OP and PV of ``recording``, with traces for a picture of a suspicion.

    Never raises for what a recording holds.
    """
    try:
        seen = look_at_loop(recording)
        suspicion = judge.says(seen)
        if suspicion.verdict is not Suspicion.SUSPECTED or seen.shown is None:
            return suspicion
        return replace(suspicion, traces=_traces(recording, seen, seen.shown))
    except Exception as error:  # a failing cross-check must not prevent the verdict
        reason = f"the comparison broke down ({type(error).__name__}: {error})"
        return _cannot_tell(reason, "Report this with the recording.")


def _traces(recording: Recording, seen: SeenLoop, loop_evidence: Evidence) -> ElementTraces:
    first, op, pv, _ = _longest(recording)
    block_length = max(1, round(loop_evidence.period * seen.thinned_by / PER_PERIOD[0]))
    part = element_traces(op, pv, block_length, loop_evidence.coarse.S, loop_evidence.coarse.J)

    def on_whole_clock(values: Floats) -> Floats:
        whole_record = np.full(len(recording), np.nan)
        whole_record[first : first + values.size] = values
        return whole_record

    return ElementTraces(
        stem=on_whole_clock(part.stem),
        linear=on_whole_clock(part.linear),
        sticking=on_whole_clock(part.sticking),
    )


@dataclass(frozen=True, kw_only=True)
class Judge:
    """Trained networks and the limits that go with them."""

    network: LoopNetwork
    limits: SuspicionLimits

    def says(self, seen: SeenLoop) -> WithoutPosition:
        """The result for a loop."""
        if seen.shown is None or seen.windows is None:
            return _cannot_tell(*(seen.doubt or ("nothing was seen", _FASTER)))
        answer = self.network.answer(seen.shown.values, seen.windows)
        score = sticking_score(seen.shown, answer, seen.unit)
        if seen.doubt is not None:
            found = _cannot_tell(*seen.doubt, score)
        else:
            found = _answer(seen, seen.shown, answer, score, self.limits)
        return replace(found, likeness=answer.score)


@cache
def trained_judge() -> Judge:
    """The networks and limits that are shipped."""
    return Judge(
        network=LoopNetwork(unpacked(trained_weights.SHAPES, trained_weights.PACKED)),
        limits=SuspicionLimits(
            suspected_from=trained_weights.SUSPECTED_FROM,
            no_sign=NoSignLimit(**trained_weights.NO_SIGN),
        ),
    )


def _cannot_tell(reason: str, advice: str, score: float | None = None) -> WithoutPosition:
    return WithoutPosition(
        verdict=Suspicion.CANNOT_TELL,
        reason=f"OP and PV cannot tell whether the valve sticks: {reason}.",
        advice=advice,
        score=score,
        apparent_S=Estimate.unknown(reason, unit=PERCENT),
    )


def too_little_moved(found: WithoutPosition, reason: str, remedy: str) -> WithoutPosition:
    """``found``, where the verdict on the position says by ``reason`` that a sticking stem would
    not show in what OP did: then that OP and PV show no sign of it says nothing either.
    """
    if found.verdict is not Suspicion.NO_SIGN:
        return found
    return replace(_cannot_tell(reason, remedy, found.score), likeness=found.likeness)


def _unusable(recording: Recording) -> tuple[str, str] | None:
    """Why OP and PV of this recording show nothing at all, and what to do; ``None`` where they
    do."""
    pv = recording.get(Role.PV)
    if pv is None:
        return "PV is not in this recording", "Export PV beside OP, in one file."
    if not pv.usable.any():
        return "PV has no usable value", "Check the transmitter of PV and its tag."
    _, op, pv_known, _ = _longest(recording)
    if not op.size:
        return "OP and PV have no usable values at the same times", "Check both tags."
    if op.size < FEWEST_SAMPLES:
        return f"only {op.size} samples follow each other without a hole", _FASTER
    if np.ptp(pv_known) <= 0.0:
        return (
            f"PV stands at {pv_known[0]:.6g} throughout",
            "Check the transmitter of PV and its tag.",
        )
    if np.ptp(op) <= 0.0:
        return _moved_too_little(op)
    at_limit_share = max(float(np.mean(op <= op.min())), float(np.mean(op >= op.max())))
    if at_limit_share > MOST_AT_LIMIT:
        return (
            f"OP stands at its limit for {100.0 * at_limit_share:.0f} % of the time, which "
            "looks like sticking whatever the valve does",
            "Record the loop where OP is free to move.",
        )
    return None


def _doubt(recording: Recording) -> tuple[str, str] | None:
    """Why what OP and PV show is too little for an answer, and what to do; ``None`` where it is
    not."""
    _, op, pv, _ = _longest(recording)
    least = LEAST_MOVED_PERCENT if recording.op.unit == PERCENT else 0.0
    if np.count_nonzero(np.diff(op)) < FEWEST_MOVES or np.ptp(op) <= least:
        return _moved_too_little(op)
    if float(np.mean(np.diff(pv) == 0.0)) > MOST_HELD:
        return "PV mostly repeats its last value", _FASTER
    return None


def _moved_too_little(op: Floats) -> tuple[str, str]:
    return (
        f"OP changed {np.count_nonzero(np.diff(op))} times over a range of {np.ptp(op):.3g}",
        "Record the loop in automatic while it works, or step the set point.",
    )


def _longest(recording: Recording) -> tuple[int, Floats, Floats, Floats | None]:
    """The first sample, OP, PV and SP of the longest stretch without a hole of more than
    ``LONGEST_BRIDGE`` samples."""
    op, pv, sp = recording.op, recording.get(Role.PV), recording.get(Role.SP)
    assert pv is not None
    both_usable = op.usable & pv.usable
    if not both_usable.any():
        return 0, np.empty(0), np.empty(0), None
    first, last = longest_stretch(both_usable, LONGEST_BRIDGE)
    known = both_usable[first:last]

    def in_stretch(signal: Signal) -> Floats:
        return bridged(signal.values[first:last], known)

    set_point = None
    if sp is not None and sp.usable[first:last][known].all():
        set_point = in_stretch(sp)
    return first, in_stretch(op), in_stretch(pv), set_point


def _thinned(
    op: Floats, pv: Floats, sp: Floats | None
) -> tuple[Floats, Floats, Floats | None, int]:
    """A record of at most ``MOST_SAMPLES``: a slow one by means, over how many samples is the last
    of what is returned, a long one by its end."""
    if op.size <= MOST_SAMPLES:
        return op, pv, sp, 1
    stride = max(round(dominant_period(op) / _THINNED_TO), 1)

    def short(values: Floats) -> Floats:
        return block_means(values, stride)[-MOST_SAMPLES:]

    return short(op), short(pv), None if sp is None else short(sp), stride


def estimated_S(loop_evidence: Evidence, answer: LoopScore) -> float:
    """S in percent of OP, should the valve stick."""
    log_S = weighed_log_S(loop_evidence, answer.log_S, answer.spread)
    return loop_evidence.amplitude * float(np.exp(log_S))


def sticking_score(loop_evidence: Evidence, answer: LoopScore, unit: str) -> float:
    """0 to 1: the networks' probability that a stem sticks, where half of all loops have one that
    does, times the probability that its S is more than a sound stem has,

        P(S > SOUND_S_PERCENT) = Phi(ln(S/SOUND_S_PERCENT)/d)

    with the apparent S and the spread d that its interval has. The networks see no scale: where OP
    is not in percent, the second factor is unknown and left out.
    """
    if unit != PERCENT:
        return answer.score
    beyond_sound = np.log(estimated_S(loop_evidence, answer) / SOUND_S_PERCENT)
    return answer.score * float(ndtr(beyond_sound / answer.spread))


def predicts_better(loop_evidence: Evidence) -> bool:
    """Whether an element that sticks, beside OP, predicts unseen PV better than any linear loop."""
    return loop_evidence.coarse.gain_of_both > 0.0


def _answer(
    seen: SeenLoop,
    loop_evidence: Evidence,
    answer: LoopScore,
    score: float,
    limits: SuspicionLimits,
) -> WithoutPosition:
    unit = seen.unit
    said_unit = f" {unit}" if unit else ""
    S = estimated_S(loop_evidence, answer)
    low, high = (S * float(np.exp(side * 1.96 * answer.spread)) for side in (-1.0, 1.0))
    periods = seen.samples / loop_evidence.period
    is_suspected = score >= limits.suspected_from and predicts_better(loop_evidence)
    if is_suspected and unit != PERCENT:
        return _cannot_tell(
            f"it looks as if the valve sticks by {S:.2g}{said_unit} of OP, not in percent: "
            f"nobody can say whether that is more than the {LEAST_S_PERCENT:g} % that a sound "
            "valve may have",
            _SCALE,
            score,
        )
    if is_suspected and S < LEAST_S_PERCENT:
        return _cannot_tell(
            f"it looks as if the valve sticks by {S:.2f} % of OP, which a sound valve may have",
            _TEST,
            score,
        )
    if is_suspected:
        return WithoutPosition(
            verdict=Suspicion.SUSPECTED,
            reason=(
                f"Sticking is suspected: with a valve that sticks by about {S:.1f}{said_unit} of "
                f"OP ({low:.1f} to {high:.1f}) between OP and PV, PV is predicted better than by "
                "any linear loop, on samples that were not fitted. By itself this is no "
                "verdict."
            ),
            advice=_TEST,
            score=score,
            apparent_S=Estimate(value=S, low=low, high=high, unit=unit),
            rivals=_rivals(loop_evidence),
        )
    if score >= limits.suspected_from:
        return _too_weak(periods, score)
    return _without_sign(seen, loop_evidence, score, limits.no_sign)


def _without_sign(
    seen: SeenLoop, loop_evidence: Evidence, score: float, limit: NoSignLimit
) -> WithoutPosition:
    """The answer at a score that raises no suspicion: the S that would have shown, if there is one
    that says something."""
    amplitude, unit = loop_evidence.amplitude, seen.unit
    swings = seen.samples / loop_evidence.period
    share = limit.shows_from(
        score,
        swings,
        float(loop_evidence.sizes[-1]) / amplitude,
        amplitude if unit == PERCENT else WIDEST_PERCENT,  # where the score knows no S either
    )
    if share is None:
        return _too_weak(swings, score)
    shows = share * amplitude
    if unit == PERCENT:  # a valve that sticks by more than OP swings might not have moved at all
        shows = max(shows, min(LEAST_S_PERCENT, amplitude))
    if unit == PERCENT and shows > MOST_S_PERCENT:
        return _cannot_tell(
            f"as wide as OP swings, only a valve that sticks by {shows:.0f} % of OP or more would "
            "have shown",
            _TEST,
            score,
        )
    said_unit = f" {unit}" if unit else ""
    return WithoutPosition(
        verdict=Suspicion.NO_SIGN,
        reason=(
            "OP and PV show no sign of sticking; a valve that sticks by "
            f"{shows:.1f}{said_unit} of OP or more would have shown {MOSTLY}. By itself "
            "this is no verdict."
        ),
        advice=NOTHING_TO_DO if _is_small(shows, unit) else _TEST,
        score=score,
        apparent_S=Estimate.unknown("there is no sign of sticking", unit=unit),
        shows_from=shows,
    )


def _too_weak(swings: float, score: float) -> WithoutPosition:
    if swings < ENOUGH_PERIODS:
        return _cannot_tell(
            f"the signs are too weak either way in a record of {swings:.0f} swings of the loop",
            _LONGER,
            score,
        )
    return _cannot_tell("the signs are too weak either way", _TEST, score)


def _rivals(loop_evidence: Evidence) -> tuple[str, ...]:
    """Other causes with the same picture, the likeliest first."""
    rivals = [
        "a PV sensor or its linkage that sticks or has play",
        "a neighbouring loop whose valve sticks and whose swing arrives here",
    ]
    if loop_evidence.values[_ROUND] < 0.0:
        rivals.append("tuning at its limit or an outer swing: OP is rounder than sticking makes it")
    return tuple(rivals)
