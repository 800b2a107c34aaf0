"""A stem that stands on a stop while its command goes on: a saturation, and no friction.

A mechanical limit, a handwheel that was left on, a limit in the positioner or air that does not
reach further holds the stem at one place, always the same, as long as OP asks for more. To a fit of
friction such a rest is a stem that sticks by as much as OP goes on, and a check of tags sees a
position that does not follow its OP. So it is looked for before either is asked.

On a stop, and nowhere else,

- the position piles up at its highest (or lowest) place, within its noise, whatever OP asks,
- OP moves there by ``OP_MOVES`` percent and more, beyond what it asks for anywhere else,
- wherever OP asks for as much again, the stem stands there again. A stem that sticks rests at other
  places as well, and at the same OP stands elsewhere after OP has turned round,
- it comes back to this place, or OP moves farther than any stem sticks: a single rest of a stem
  that sticks is at its highest place as well, while OP goes on by some percent and turns round.

The ends of the stroke are no such stop: a valve on its seat is shut.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stemwatch.models.record_checks.data_quality import Obstacle
from stemwatch.models.recording import PERCENT, Bools, Floats, Quality, Recording, Role
from stemwatch.models.signals.forensics import noise_sigma, quantum
from stemwatch.models.verdict import NoVerdict
from stemwatch.models.words import share

STOP_REMEDY = (
    "Look for a handwheel or a limit stop left on, for travel limits and cut-off in the settings "
    "of positioner and controller, and at the supply pressure. Drive the valve in manual beyond "
    "the place and look at the stem itself: if it goes on while the reading stands, the "
    "transmitter is at its end."
)
INSIDE_PERCENT = 1.0  # of travel, from the ends of the stroke
# Percent by which OP goes beyond what it asked for before (this percentile of it) and within the
# stop (5th to 95th); of a stem that stood there once.
BEFORE = 90.0
OP_MOVES, OP_MOVES_ONCE = 5.0, 20.0
AWAY = 3.0  # times its noise by which the stem must leave a place to come back to it
FEWEST, LEAST_SHARE = 30, 0.02  # samples
# Standard deviations; percent of travel. In a slow archive what looks like noise is movement.
WITHIN_NOISE, LEAST_WITHIN, MOST_WITHIN = 4.0, 0.15, 0.4
LEVEL = (
    0.5  # of that, by which the reading may go with OP from one end of what it asks to the other
)
ALWAYS = 0.9  # share of the samples with as much OP at which the stem stands there


@dataclass(frozen=True)
class Stop:
    """A place at which the stem stood while OP went on.

    ``place`` in percent of travel; ``is_high``: the stem does not rise above it, else it does not
    fall below it. ``share`` of the usable samples on it; ``op_low`` and ``op_high`` what OP asked
    for meanwhile, percent. ``on`` (n,) the samples on it.
    """

    place: float
    is_high: bool
    share: float
    op_low: float
    op_high: float
    on: Bools

    def sentence(self) -> str:
        """Where the stem stood, for how much of the time, and what OP asked for."""
        way = "rises above" if self.is_high else "falls below"
        return (
            f"the position stands at {self.place:.1f} % for {share(self.share)} of the time and "
            f"never {way} it, while OP goes from {self.op_low:.0f} to {self.op_high:.0f} %: the "
            "stem stands on a stop, its air does not move it further, or the reading ends there"
        )


def stop_obstacle(stop: Stop) -> Obstacle:
    """A stop on which the stem stood for so long that what is left tells nothing."""
    return Obstacle(NoVerdict.STANDS_ON_A_STOP, stop.sentence(), STOP_REMEDY)


def find_stop(recording: Recording) -> Stop | None:
    """The stop on which the stem stood longest; ``None`` where there is none, where OP and position
    are not both in percent, or without a position."""
    if recording.mv is None or not recording.mv.unit == recording.op.unit == PERCENT:
        return None
    usable = recording.usable
    if np.count_nonzero(usable) < FEWEST:
        return None
    op, mv = recording.op.values, recording.mv.values
    rises = _rises_with(op[usable], mv[usable])
    stops = [_at_the_end(op, mv, usable, is_high, rises) for is_high in (True, False)]
    found = [stop for stop in stops if stop is not None]
    return max(found, key=lambda stop: stop.share, default=None)


def without_stop(recording: Recording, stop: Stop | None) -> Recording:
    """``recording`` with the position marked bad while the stem stood on a ``stop``."""
    if stop is None or recording.mv is None:
        return recording
    quality = np.where(stop.on, np.uint8(Quality.BAD), recording.mv.quality)
    masked = replace(recording.mv, quality=quality)
    return replace(recording, signals={**recording.signals, Role.MV: masked})


def _rises_with(op: Floats, mv: Floats) -> bool:
    """Whether the position rises with OP, and not against it as a reversed one does."""
    shares = [(one - one.mean()) / max(float(np.ptp(one)), 1e-12) for one in (op, mv)]
    return float(np.dot(*shares)) >= 0.0


def _at_the_end(op: Floats, mv: Floats, usable: Bools, is_high: bool, rises: bool) -> Stop | None:
    """The stop at the highest or the lowest place of the position, if it is one."""
    up = 1.0 if is_high else -1.0
    more = up if rises else -up
    travel, asked = up * mv, more * op
    sigma = float(np.hypot(noise_sigma(mv[usable]), quantum(mv[usable]) / np.sqrt(12.0)))
    within = min(max(WITHIN_NOISE * sigma, LEAST_WITHIN), MOST_WITHIN)
    highest = float(np.percentile(travel[usable], 99.9))
    place = float(np.median(travel[usable & (travel >= highest - 2.0 * within)]))
    on = usable & (travel >= place - within)
    of_time = float(on.sum() / usable.sum())
    if on.sum() < FEWEST or of_time < LEAST_SHARE or _near_an_end(up * place):
        return None
    least, middle, most = np.percentile(asked[on], (5.0, 25.0, 95.0))
    once = _visits(travel[usable] - place, within) < 2
    before = float(np.percentile(asked[usable & ~on], BEFORE)) if of_time < 1.0 else -np.inf
    if most - max(least, before) < (OP_MOVES_ONCE if once else OP_MOVES):
        return None
    if float(np.mean(on[usable & (asked >= middle)])) < ALWAYS:
        return None
    slope = float(np.polyfit(asked[on], travel[on], 1)[0])
    if abs(slope) * (most - least) > LEVEL * within:
        return None
    low, high = sorted((more * float(least), more * float(most)))
    return Stop(up * place, is_high, of_time, low, high, on)


def _visits(beyond: Floats, within: float) -> int:
    """How often the stem came to a place, of how far it was ``beyond`` it (m,), percent."""
    near, away = beyond >= -within, beyond < -AWAY * within
    states = near.astype(np.int8)[near | away]
    return int(states[:1].sum() + np.count_nonzero(np.diff(states) > 0))


def _near_an_end(place: float) -> bool:
    return not INSIDE_PERCENT <= place <= 100.0 - INSIDE_PERCENT
