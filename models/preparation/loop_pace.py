"""A fast recording read at the pace of its loop.

For a controller that reverses OP every minute, 50 Hz show no more than 1 Hz. But a fit takes a
fixed number of samples (``fit_window``), which at 50 Hz is a minute: too few reversals to separate
friction from a stem that answers late. So a recording that is longer than the fitted stretch, and
reverses too seldom within it, is thinned to every k-th sample. The same number of samples then
holds more of OP's path, and the stem answers within a sample or two, as in an archive of one sample
a second.

Where the controller holds OP between its scans, the samples between hold no new command, and each
scan would look like a slip of a fast stem. Then the last sample before each scan is taken.

Only a recording with an interval below half a second is thinned. A slower clock resolves the
response time of a valve, half a second to some seconds: a lag of four samples at 1 s is a finding.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stemwatch.models.preparation.fit_window import (
    CHOOSE_BEYOND,
    SMALLEST_TURN_PERCENT,
    choose_fit_window,
)
from stemwatch.models.preparation.own_clock import FAST, duration
from stemwatch.models.recording import Recording
from stemwatch.models.signals.excitation import reversals
from stemwatch.models.signals.forensics import noise_sigma
from stemwatch.models.signals.percent import not_percent
from stemwatch.models.signals.refresh_period import refresh_period

# Reversals of OP in the stretch that would be fitted, from which it is long enough. Eleven loops of
# `draw_sticky` and `draw_healthy` (seed 6161, four hours at 1 s) that reverse more than ten times
# have 22 and more there; at 10 Hz, where S of one of six was off by half (seed 7171), they have 2
# to 16.
ENOUGH_TURNS = 20
# Samples to keep from one reversal of OP to the next: twice the number that keeps its peaks well
# enough (``between_samples.FEW``).
LEFT_OF_A_TURN = 16
# At least LEAST_LEFT samples are kept; thinning by less than LEAST_APART is not worth another
# clock.
LEAST_LEFT, LEAST_APART = 3600, 5
FEWEST_SCANS = 1200  # of OP, that must be left
FEWEST_TURNS = 5  # from which the time between them is known
NOISES = 6.0
# Share of the range from the 2nd to the 98th percentile of MV - OP: smaller reversals of OP hide no
# slip (``between_samples``).
BAND, TURN_SHARE = (2.0, 98.0), 0.2
# These strides and their multiples of ten are used, so that the next window of the valve is thinned
# alike.
STEPS = (1, 2, 5)


def at_loop_pace(recording: Recording, samples: int) -> Recording:
    """``recording``, with OP and position in percent, thinned to the pace of its loop. Unchanged
    where its interval is half a second or more, where it is no longer than twice ``samples``, or
    where OP reverses often enough.

    The thinning is noted among its decisions.
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
    return recording if stride == 1 else _thinned(recording, 0, stride, reason)


def _at_scans_of_op(recording: Recording) -> Recording:
    """``recording`` at the last samples before an OP that is held for a while changes."""
    period, change = refresh_period(recording.op.values)
    if period < LEAST_APART or len(recording) < FEWEST_SCANS * period:
        return recording
    reason = "OP is held as long between the scans of its controller"
    return _thinned(recording, (change - 1) % period, period, reason)


def _thinned(recording: Recording, first: int, stride: int, reason: str) -> Recording:
    """Every ``stride``-th sample from ``first`` on."""
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
    """The stride that still resolves OP's reversals: more than one where ``samples`` consecutive
    samples hold too few of them and the whole recording more.
    """
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
    return _rounded_stride(longest_stride) if longest_stride >= LEAST_APART else 1


def _rounded_stride(largest: int) -> int:
    """The largest of 1, 2, 5, 10, 20 and so on that is not above ``largest``."""
    decade = int(10 ** (len(str(largest)) - 1))
    return max(step * decade for step in STEPS if step * decade <= largest)
