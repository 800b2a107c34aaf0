"""The evidence on one valve from which its verdict is decided."""

from __future__ import annotations

from dataclasses import dataclass

from stemwatch.models.decision.reading_off import ReadingOff
from stemwatch.models.estimate import Estimate
from stemwatch.models.limits import Limits
from stemwatch.models.record_checks.on_a_stop import Stop
from stemwatch.models.record_checks.own_swing import OwnSwing
from stemwatch.models.record_checks.pulsing_stem import Pulses
from stemwatch.models.record_checks.wandering_reading import Wander
from stemwatch.models.recording import Floats
from stemwatch.models.screening_result import Residual
from stemwatch.models.stickslip.change_of_stiction import ChangeOfStiction
from stemwatch.models.stickslip.stored_range import StoredRange


@dataclass(frozen=True, kw_only=True)
class DecisionEvidence:
    """The evidence on one valve from which ``decide`` derives the verdict. S and J in percent of OP
    span.
    """

    S: Estimate
    J: Estimate
    S_draws: Floats  # bootstrap draws of S
    friction_mean: float  # held-out advantage of a model with friction over one without
    friction_t: float
    jumps_evident: bool  # the stem rests and jumps towards its command, as the recording shows
    following: Residual | None  # stick-slip model, resynchronised at each block of time
    typical_percent: float  # 100 (1 - median |residual| / median |MV - median MV|), the same run
    narx: Residual | None
    unseen: Residual | None  # a free run of S and J alone, where the residual has no named cause
    sigma: float  # measurement noise of the position, percent
    slow: str  # a sentence on lags and speed limits beside friction, or empty
    baseline: Residual | None  # the baseline network's, on this window
    baseline_ratio: float | None
    cycling_s: float | None  # period of the loop's regular oscillation, on the record's own clock
    unit_s: float = 1.0  # seconds in the unit of that, see ``own_clock``
    both_in: StoredRange | None = None  # in which OP and position may both be stored, unscaled
    op_in: StoredRange | None = None  # in which OP alone may be stored, unscaled
    sampling: str = ""  # why the sampling is too slow to show how the stem moved, or empty
    swings: OwnSwing | None = None  # of the position alone, without its command
    pulses: Pulses | None = None  # of the stem, which its command does not have
    steps: float = 0.0  # percent by which OP was stepped, where each of its steps moved the stem
    changed: ChangeOfStiction | None = None  # S within the recording, in percent of OP
    curve_is_enough: bool = False  # another curve from OP to stroke fits as well as friction
    leads_s: float = 0.0  # by which the position moves first, where it may be OP itself
    takes_s: float = 0.0  # true seconds of an actuator that ``slow`` tells of, else 0
    without_lag: float = 0.0  # percent: S where a lag was fitted and is left out, else 0
    rests: bool = False  # the archive shows a dead band, which no actuator without friction has
    # percent: S of friction alone, where OP may shake it loose between its samples so that it looks
    # like the slow actuator that was found; else 0
    shaken: float = 0.0
    S_unseen: float = 0.0  # percent: S that may be there, where noise of OP may shake it loose
    # percent: S that may be there, if the archive keeps averages; ``every_s`` seconds from one to
    # the next
    S_averaged: float = 0.0
    every_s: float = 0.0
    wander: Wander | None = None  # of the position reading, where no effect was named
    stop: Stop | None = None  # on which the stem stood, beside which S and J are; unless named
    off: ReadingOff | None = None  # by which the position stands beside OP; unless named

    def may_stick_unseen(self, limits: Limits) -> bool:
        """Whether the slow actuator that was found may be a stem that sticks after all."""
        return self.shaken >= limits.sticky_S_percent

    def is_hidden(self, limits: Limits) -> bool:
        """Whether noise of OP may hide a sticking stem behind the S that is seen."""
        S = self.S.value
        return (
            S is not None
            and S < limits.watch_S_percent
            and (self.S_unseen >= limits.sticky_S_percent)
        )
