"""Signs that OP is not percent for percent of the position, without a fit: how far the two lie
apart, how much travel the means of both show for a percent of OP, and where the stem is at a stop.
"""

from __future__ import annotations

import numpy as np

from stemwatch.models.recording import Bools, Floats, Recording, kept
from stemwatch.models.signals.forensics import noise_sigma
from stemwatch.models.signals.signal_pairing import correlation

# For healthy and sticking valves of two simulators, the middle between the branches is within 1 %
# of OP; a zero shift of 2 % and a span error of 10 % of travel together move it by 6 %.
OFF_THE_COMMAND_PERCENT = 8.0
# The same valves, sampled at 1 to 10 s, give 0.88 to 1.05 for the slope of the position's means
# over OP's, and a tight shut-off 0.79; an OP half of which strokes the valve gives 1.6 and more.
PLAIN_SLOPE = (0.75, 1.25)
MEANS, LEAST_SPREAD_PERCENT, LEAST_TOGETHER = 24, 2.0, 0.97
LITTLE_SPREAD_PERCENT = 1.5
# Wide sticking and a bent curve lower the correlation: 0.93 and more on valves that moved over a
# quarter of their stroke. In a limit cycle between two positions the means do not move at all.
TOGETHER_ENOUGH = 0.92
# Correlation of a position that falls while OP rises: 256 simulated sticking valves gave 0.1 and
# above.
AGAINST = -0.3
MOVING_SAMPLES = 40  # fewer moving samples do not determine a curve
# Signs of a stop or a tight shut-off: the share of samples at the lowest or highest position, the
# width of that place in standard deviations of noise, and how far OP goes on there, percent.
STOP_SHARE, STOP_NOISES, GOES_ON = 0.02, 4.0, 12.0


def curve_suspected(recording: Recording) -> bool:
    """Whether position and command differ by more than a transmitter's zero and span explain."""
    if recording.mv is None or recording.mv.unit != recording.op.unit:
        return False
    usable = off_the_stops(recording)
    if usable.sum() < MOVING_SAMPLES:
        return False
    offset = (recording.mv.values - recording.op.values)[usable]
    low, high = np.percentile(offset, (2.0, 98.0))
    if abs(low + high) / 2.0 > OFF_THE_COMMAND_PERCENT or correlation(recording) < AGAINST:
        return True
    slope = slope_of_means(recording)
    if slope is not None:
        return not PLAIN_SLOPE[0] <= slope <= PLAIN_SLOPE[1]
    # Near mid-range, a valve that is stroked by half of OP is nowhere far from its command.
    slope = slope_of_means(recording, TOGETHER_ENOUGH, LITTLE_SPREAD_PERCENT)
    return slope is not None and slope > PLAIN_SLOPE[1]


def slope_of_means(
    recording: Recording,
    least_together: float = LEAST_TOGETHER,
    spread_percent: float = LEAST_SPREAD_PERCENT,
) -> float | None:
    """Percent of travel for a percent of OP, from the means of both over a 24th of the record.

    Friction shifts a mean by less than S, and a lag hardly shifts it. ``None`` where OP did not
    stay in several places for long (its means deviate by less than ``spread_percent``), or the
    means correlate by less than ``least_together``; the slope is then too low, if anything.
    """
    mv = recording.mv
    if mv is None:
        return None
    usable = off_the_stops(recording)
    length = int(usable.sum()) // MEANS
    if length == 0:
        return None
    op, position = (
        signal.values[usable][: MEANS * length].reshape(MEANS, length).mean(axis=1)
        for signal in (recording.op, mv)
    )
    if op.std() < spread_percent or position.std() == 0.0:
        return None
    if abs(np.corrcoef(op, position)[0, 1]) < least_together:
        return None
    return float(np.cov(op, position)[0, 1] / op.var(ddof=1))


@kept
def off_the_stops(recording: Recording) -> Bools:
    """(n,) True where both are usable and the stem is not at a stop, where OP moves without it."""
    assert recording.mv is not None
    usable = recording.usable
    stopped = np.zeros(usable.size, dtype=bool)
    stopped[usable] = at_a_stop(recording.op.values[usable], recording.mv.values[usable])
    return usable & ~stopped


def at_a_stop(op: Floats, mv: Floats) -> Bools:
    """(n,) True where the position stays at its lowest or highest value while OP moves on, further
    than sticking would explain."""
    stopped = np.zeros(mv.size, dtype=bool)
    if not mv.size:
        return stopped
    reach = max(STOP_NOISES * noise_sigma(mv), 1e-6)
    for extreme, percentile in ((mv.min(), 1.0), (mv.max(), 99.0)):
        end = float(np.percentile(mv, percentile))
        at_end = np.abs(mv - end) <= max(reach, abs(extreme - end))
        if at_end.mean() > STOP_SHARE and np.ptp(np.percentile(op[at_end], (5.0, 95.0))) > GOES_ON:
            stopped |= at_end
    return stopped
