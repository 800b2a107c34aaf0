"""A fast recording read at the pace of its loop.

A controller that turns OP round every minute is no better seen at 50 Hz than at 1 Hz. But a fit
takes so many samples (``fit_window``), at 50 Hz those of a minute: too few turns to tell friction
from a stem that answers late. So a recording that is longer than what is fitted, and turns too
seldom within that, is read at every so manyth sample. As many samples then hold more of OP's way,
and the stem answers within a sample or two, as it does where a historian keeps a second.

Where the controller holds OP between its scans, what lies between is no news of the command, and
each scan would look as a slip to a quick stem: then the last sample before each scan is read.

Only a clock that is faster than half a second is read so. What a valve takes to answer, half a
second to some seconds, is what a slower one is for: a lag of four samples at 1 s is worth a name.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stemwatch.models.excitation import reversals
from stemwatch.models.fit_window import (
    CHOOSE_BEYOND,
    SMALLEST_TURN_PERCENT,
    choose_fit_window,
)
from stemwatch.models.forensics import noise_sigma
from stemwatch.models.mismatch.record_effects import refresh_period
from stemwatch.models.own_clock import FAST, duration
from stemwatch.models.percent import not_percent
from stemwatch.models.recording import Recording

# Turns of OP in the stretch that would be fitted, from which it is long enough. Eleven loops of
# `draw_sticky` and `draw_healthy` (seed 6161, four hours at 1 s) that turn more than ten times have
# 22 and more there; at 10 Hz, where S of one of six was off by half (seed 7171), they have 2 to 16.
ENOUGH_TURNS = 20
# Samples that are left from one turn of OP to the next: twice what keeps its peaks well enough
# (``between_samples.FEW``).
LEFT_OF_A_TURN = 16
# So many samples are left at any rate, and fewer than every fifth is not worth another clock.
LEAST_LEFT, LEAST_APART = 3600, 5
FEWEST_SCANS = 1200  # of OP, that must be left
FEWEST_TURNS = 5  # from which the time between them is known
NOISES = 6.0
# Of the 2nd to 98th percentile of MV - OP: smaller turns of OP lose no slip (``between_samples``).
BAND, TURN_SHARE = (2.0, 98.0), 0.2
# And ten times, a hundred times these, so that the next window of the valve is read alike.
STEPS = (1, 2, 5)


def at_loop_pace(recording: Recording, samples: int) -> Recording:
    """``recording``, with OP and position in percent, at every so manyth sample; itself where its
    clock is no fast one, it is no longer than what is fitted, twice ``samples``, or turns often.

    What is done is among its decisions.
    """
    samples = max(samples, LEAST_LEFT)
    if recording.interval_s * recording.unit_s >= FAST:
        return recording
    if recording.mv is None or not_percent(recording.op) or not_percent(recording.mv):
        return recording
    if len(recording) > CHOOSE_BEYOND * samples:
        recording = _at_scans_of_op(recording)
    stride = _between_turns(recording, samples)
    reason = "OP turns round so slowly that nothing of its way is lost, and more of it is fitted"
    return recording if stride == 1 else _read(recording, 0, stride, reason)


def _at_scans_of_op(recording: Recording) -> Recording:
    """``recording`` at the last samples before an OP that is held for a while changes."""
    period, change = refresh_period(recording.op.values)
    if period < LEAST_APART or len(recording) < FEWEST_SCANS * period:
        return recording
    reason = "OP is held as long between the scans of its controller"
    return _read(recording, (change - 1) % period, period, reason)


def _read(recording: Recording, first: int, stride: int, reason: str) -> Recording:
    """Every so manyth sample from the ``first`` on."""
    part = recording.part(first, len(recording))
    signals = {
        role: replace(signal, values=signal.values[::stride], quality=signal.quality[::stride])
        for role, signal in part.signals.items()
    }
    interval_s = stride * part.interval_s
    sentence = f"One sample of {stride} is read, every {duration(1.0, interval_s, 'g')}: {reason}."
    decisions = (*part.provenance.decisions, sentence)
    provenance = replace(part.provenance, decisions=decisions)
    return replace(part, signals=signals, interval_s=interval_s, provenance=provenance)


def _between_turns(recording: Recording, samples: int) -> int:
    """How many samples apart those lie that tell of OP's turns: more than one where ``samples``
    consecutive ones hold too few of them and the whole recording more."""
    stretch = choose_fit_window(recording, samples)
    if stretch is None or stretch.turns >= ENOUGH_TURNS:
        return 1
    assert recording.mv is not None
    op = recording.op.values[recording.usable]
    if reversals(op, stretch.turn_percent).size <= stretch.turns:
        return 1
    longest_stride = len(recording) // samples
    difference = recording.mv.values[recording.usable] - op
    low, high = np.percentile(difference, BAND)
    least = max(TURN_SHARE * float(high - low), NOISES * noise_sigma(op), SMALLEST_TURN_PERCENT)
    turns = reversals(op, least)
    if turns.size >= FEWEST_TURNS:
        longest_stride = min(longest_stride, int(np.median(np.diff(turns))) // LEFT_OF_A_TURN)
    return _round(longest_stride) if longest_stride >= LEAST_APART else 1


def _round(largest: int) -> int:
    """The largest of 1, 2, 5, 10, 20 and so on that is not above ``largest``."""
    decade = int(10 ** (len(str(largest)) - 1))
    return max(step * decade for step in STEPS if step * decade <= largest)
