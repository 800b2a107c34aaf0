"""The verdicts on a valve, why there may be none, and the four shapes of its OP-MV loop."""

from __future__ import annotations

from enum import StrEnum


class Verdict(StrEnum):
    """What the recording says about the valve."""

    HEALTHY = "healthy"
    # Does not follow from S and J: given where something other than friction is wrong with the
    # valve.
    DEFECTIVE = "defective"
    WATCH = "watch"
    STICKY = "sticky"
    UNDETERMINED = "undetermined"


# Order of the work list: a valve that could not be judged stands before a healthy one.
WORST_FIRST = (
    Verdict.STICKY,
    Verdict.DEFECTIVE,
    Verdict.WATCH,
    Verdict.UNDETERMINED,
    Verdict.HEALTHY,
)


class NoVerdict(StrEnum):
    """Why a valve is undetermined. Whatever follows from that is decided by this word, which is
    stored with the screening, and never by the sentence that people read."""

    UNKNOWN = "unknown"  # stored before these words were
    NOT_READ = "not_read"
    BROKE_DOWN = "broke_down"
    # The recording is in the way: see ``record_checks``, whose obstacles have these slugs.
    BAD_SAMPLES = "bad_samples"
    BROKEN_UP = "broken_up"
    CLOCKS_APART = "clocks_apart"
    COMPRESSED = "compressed"
    EMPTY = "empty"
    FEW_REVERSALS = "few_reversals"
    MANUAL = "manual"
    NO_POSITION = "no_position"
    OP_IS_PV = "op_is_pv"
    OP_IS_SP = "op_is_sp"
    OP_NOT_FOLLOWED = "op_not_followed"
    OP_STILL = "op_still"
    OP_UNIT = "op_unit"
    POSITION_COARSE = "position_coarse"
    POSITION_FROZEN = "position_frozen"
    POSITION_IS_OP = "position_is_op"
    POSITION_IS_PV = "position_is_pv"
    POSITION_IS_SP = "position_is_sp"
    POSITION_REVERSED = "position_reversed"
    POSITION_STILL = "position_still"
    POSITION_SUMS_OP = "position_sums_op"
    POSITION_SWITCH = "position_switch"
    POSITION_UNANSWERED = "position_unanswered"
    POSITION_UNIT = "position_unit"
    POSITION_UNRELATED = "position_unrelated"
    SAMPLES_EXCHANGED = "samples_exchanged"
    SLOW_SAMPLING = "slow_sampling"
    STANDS_ON_A_STOP = "stands_on_a_stop"
    TAGS_SWAPPED = "tags_swapped"
    TOO_SHORT = "too_short"
    # It was fitted, and the fits do not tell: see ``decision``.
    FRICTION_DOES_NOT_EXPLAIN = "friction_does_not_explain"
    NOT_FOLLOWED = "not_followed"  # a free run with S and J leaves the held-out part
    POSITION_SWINGS = "position_swings"
    READING_WANDERS = "reading_wanders"
    SLOW_ACTUATOR = "slow_actuator"  # explains the stem as well as friction does
    S_CHANGED = "S_changed"
    S_UNCERTAIN = "S_uncertain"

    @classmethod
    def of(cls, slug: str | None) -> NoVerdict:
        """The reason with this ``slug``; ``UNKNOWN`` where there is none of that name."""
        return next((reason for reason in cls if reason.value == slug), cls.UNKNOWN)


class Shape(StrEnum):
    """The four shapes of the OP-MV loop (Choudhury 2005; Zabiri et al., section IV)."""

    DEADBAND = "deadband"  # J = 0
    UNDERSHOOT = "undershoot"  # S > J > 0
    NO_OFFSET = "no offset"  # S = J
    OVERSHOOT = "overshoot"  # S < J
