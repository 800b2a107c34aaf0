"""The range in which OP or the position was stored, where it is not percent.

An export often keeps the values as they were transmitted: 4 to 20 mA, 0 to 10 V, a fraction,
counts. Read as percent, such a position hardly moves, and a good valve seems to stick. The other
signal shows which range it is: only one of the usual ranges makes position and command agree.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stemwatch.models.recording import PERCENT, Recording, Role, Signal
from stemwatch.models.signals.excitation import swing
from stemwatch.models.signals.percent import not_percent, without_impossible_values
from stemwatch.models.signals.signal_pairing import correlation, delayed_correlation
from stemwatch.models.stickslip.curve_signs import (
    PLAIN_SLOPE,
    curve_suspected,
    slope_of_means,
)

BEYOND = 0.05  # of a range, by which a signal may leave it
# Share of a range that a signal must reach: percent values, read as counts up to 1000 or more,
# reach a tenth.
LEAST_REACHED = 0.12
# Percent by which the middle of the converted position may lie off OP; and by how much more the
# next best range must be off, so that the choice is clear.
OFF_PERCENT, WORSE_PERCENT = 6.0, 4.0
# Where the slope is right, the position's zero may be off by more: else the next range, whose slope
# makes up for it, would be the only one. That is seldom, so such an offset counts more: the slope
# of a sticking valve reads too low, and then the next range has the right one.
OFF_BY_ITS_ZERO, RIGHT_SLOPE, SELDOM = 12.0, 0.1, 1.5
SLOPE_PERCENT = 50.0  # penalty of a slope that is wrong by 100 %
MOST_SWING = 1.3  # of the swing of OP, where no slope is known
GOES_WITH = 0.5  # correlation


@dataclass(frozen=True)
class StoredRange:
    """Values at 0 and at 100 %, and what they are in."""

    low: float
    high: float
    unit: str

    def holds(self, signal: Signal) -> bool:
        """Whether (nearly) all values lie within it and its unit is not another one."""
        if signal.unit not in (PERCENT, "", self.unit):
            return False
        values = signal.values[signal.usable]
        if not values.size:
            return False
        tolerance = BEYOND * abs(self.high - self.low)
        first, last = np.percentile(values, (0.5, 99.5))
        bottom, top = sorted((self.low, self.high))
        enough_of_range = last - bottom >= LEAST_REACHED * (top - bottom)
        return bool(bottom - tolerance <= first and last <= top + tolerance and enough_of_range)

    def read(self, signal: Signal) -> Signal:
        """``signal`` in percent: 100 (value - low) / (high - low)."""
        percent = 100.0 * (signal.values - self.low) / (self.high - self.low)
        deviation = signal.deviation
        if deviation is not None:
            deviation *= abs(self.times)
        return replace(signal, values=percent, unit=PERCENT, deviation=deviation)

    @property
    def times(self) -> float:
        """By how much a difference of two values is larger in percent of the range."""
        return 100.0 / (self.high - self.low)

    def sentence(self, signal: Signal, name: str) -> str:
        """What was assumed, and how to state the range in the plant file or the export."""
        unit_text = f" {self.unit}" if self.unit else ""
        return (
            f"{name} ({signal.tag}) is read as {self.low:g} to {self.high:g}{unit_text} for 0 "
            "to 100 %, for only so it goes with the other. Give this range in the plant file: "
            f"low = {self.low:g}, high = {self.high:g}."
        )


FRACTION = StoredRange(0.0, 1.0, "")
FORWARD = (
    StoredRange(4.0, 20.0, "mA"),
    StoredRange(0.0, 20.0, "mA"),
    StoredRange(0.0, 10.0, "V"),
    StoredRange(0.0, 5.0, "V"),
    StoredRange(1.0, 5.0, "V"),
    FRACTION,
    StoredRange(0.2, 1.0, "bar"),
    StoredRange(3.0, 15.0, "psi"),
    StoredRange(0.0, 1000.0, ""),
    StoredRange(0.0, 10000.0, ""),
    StoredRange(0.0, 4095.0, "counts"),
    StoredRange(0.0, 16383.0, "counts"),
    StoredRange(0.0, 27648.0, "counts"),
    StoredRange(0.0, 32767.0, "counts"),
    StoredRange(0.0, 65535.0, "counts"),
)
RANGES = (*FORWARD, *(StoredRange(one.high, one.low, one.unit) for one in FORWARD))
# Ranges with a live zero, which no signal falls below: for these alone the values of OP and
# position, both within, say that both may be stored so.
LIVE_ZERO = tuple(stored for stored in FORWARD if stored.low > 0.0)
NAMES = {Role.MV: "The position", Role.OP: "OP"}


def in_percent(recording: Recording) -> Recording:
    """``recording`` with OP and position in percent, each conversion among its decisions.

    Unchanged where both are in percent already, or no single range makes them agree.
    """
    candidates = fitting_ranges(recording)
    if not candidates or (
        len(candidates) > 1 and candidates[1][0] - candidates[0][0] < WORSE_PERCENT
    ):
        return recording
    _, role, stored = candidates[0]
    sentence = stored.sentence(recording.signals[role], NAMES[role])
    decisions = (*recording.provenance.decisions, sentence)
    return replace(
        _converted(recording, role, stored),
        provenance=replace(recording.provenance, decisions=decisions),
    )


def fitting_ranges(recording: Recording) -> list[tuple[float, Role, StoredRange]]:
    """The ranges that make OP and position agree, best first, each with the remaining distance,
    percent; none where both are in percent already.
    """
    mv = recording.mv
    if mv is None or not _moves(recording):
        return []
    in_percent_already = not_percent(recording.op) is None and not_percent(mv) is None
    # A single value outside of any percent range would outweigh all the others.
    if in_percent_already and not curve_suspected(without_impossible_values(recording)):
        return []
    candidates = [
        (offset, role, stored)
        for role in (Role.MV, Role.OP)
        for stored in RANGES
        if (offset := _offset_from_op(recording, role, stored)) is not None
    ]
    return sorted(candidates, key=lambda candidate: candidate[0])


def range_of_both(recording: Recording) -> StoredRange | None:
    """The range with a live zero within which both OP and position stay; ``None`` where there is
    none. They may then be stored so, although they agree as they are: a valve that is hardly open
    looks the same, and is told apart by a plant that states the range of one of them.
    """
    mv = recording.mv
    if mv is None or mv.scaled or recording.op.scaled or not _moves(recording):
        return None
    both = (stored for stored in LIVE_ZERO if stored.holds(recording.op) and stored.holds(mv))
    return next(both, None)


def range_of_op(recording: Recording) -> StoredRange | None:
    """The range with a live zero within which OP alone stays, in which it may be stored; ``None``
    where there is none, or nothing speaks for it.

    What speaks for it: in the middle the position lies more than ``OFF_PERCENT`` off OP in percent,
    and nearer to it in that range, or it moves farther than OP. ``in_percent`` converts where no
    doubt is left. Here the position goes with neither: its scale is another one, it is not linear,
    or it is noisy.
    """
    mv, op = recording.mv, recording.op
    if mv is None or op.scaled or not_percent(mv) is not None or not _moves(recording):
        return None
    usable = recording.usable
    if not usable.any():
        return None
    position, command = (float(np.median(one.values[usable])) for one in (mv, op))
    off_percent = abs(position - command)
    farther = swing(mv.values[usable]) > MOST_SWING * swing(op.values[usable])
    for stored in LIVE_ZERO if off_percent > OFF_PERCENT else ():
        nearer = abs(position - stored.times * (command - stored.low)) < off_percent
        if (nearer or farther) and stored.holds(op):
            return stored
    return None


def may_be_stored_in(signal: Signal) -> StoredRange | None:
    """The range with a live zero, or that of a fraction, within which a signal stays that is taken
    as percent; ``None`` where there is none, or where its range was given."""
    if signal.scaled:
        return None
    return next((stored for stored in (FRACTION, *LIVE_ZERO) if stored.holds(signal)), None)


def _moves(recording: Recording) -> bool:
    assert recording.mv is not None
    return swing(recording.op.values) > 0.0 and swing(recording.mv.values) > 0.0


def _converted(recording: Recording, role: Role, stored: StoredRange) -> Recording:
    signals = {**recording.signals, role: stored.read(recording.signals[role])}
    return replace(recording, signals=signals)


def _offset_from_op(recording: Recording, role: Role, stored: StoredRange) -> float | None:
    """How far the two lie apart if ``role`` was stored so, percent; ``None`` if it was not."""
    other = recording.op if role is Role.MV else recording.mv
    assert other is not None
    if not stored.holds(recording.signals[role]) or not_percent(other) is not None:
        return None
    read = _converted(recording, role, stored)
    read = without_impossible_values(read)
    assert read.mv is not None
    both_usable = read.usable
    low, high = np.percentile((read.mv.values - read.op.values)[both_usable], (2.0, 98.0))
    offset, slope = abs(float(low + high)) / 2.0, slope_of_means(read)
    right = slope is not None and abs(slope - 1.0) <= RIGHT_SLOPE
    if curve_suspected(read) and not right:
        return None
    if offset > (OFF_BY_ITS_ZERO if right else OFF_PERCENT):
        return None
    if offset > OFF_PERCENT:
        offset *= SELDOM
    if slope is not None:
        steep = abs(slope - 1.0)
        return offset + SLOPE_PERCENT * steep if slope > PLAIN_SLOPE[0] else None
    if swing(read.mv.values) > MOST_SWING * swing(read.op.values):
        return None
    goes_with = max(delayed_correlation(read), correlation(read)) >= GOES_WITH
    return offset if goes_with else None
