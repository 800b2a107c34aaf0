"""Which kinds of finding a screening holds, the one to act on first, and which need work.

A kind is a key of ``advice.toml``: stiction by its shape, an effect by its slug, a way in which the
position cannot be trusted.
"""

from __future__ import annotations

from stemwatch.models.mismatch.findings import Effect, Finding
from stemwatch.models.screening_result import Screening
from stemwatch.models.verdict import Shape, Verdict

STICTION = {
    Shape.DEADBAND: "stiction_deadband",
    Shape.UNDERSHOOT: "stiction_undershoot",
    Shape.NO_OFFSET: "stiction_no_offset",
    Shape.OVERSHOOT: "stiction_overshoot",
}
HEALTHY, RECORDING, WATCH, DEPARTED = "healthy", "recording", "watch", "departed"
UNKNOWN, UNEXPLAINED = "unknown", "unexplained"
NO_POSITION, FROZEN = "no_position", "frozen_transmitter"
WRONG, BAD = "wrong_position", "bad_signal"
SIGNAL = frozenset({NO_POSITION, FROZEN, WRONG, BAD})
NO_WORK = frozenset({HEALTHY, RECORDING, WATCH})

# What an undetermined verdict's reason says, as ``models.validity_checks`` and ``models.decision``
# word it: a stored screening keeps the sentence and not the obstacle. A test holds them together.
SAID_OF = (
    ("there is no valve position in this recording", NO_POSITION),
    ("the position did not change by one digit", FROZEN),
    ("the position shows nothing but its noise", FROZEN),
    ("the position reading was frozen for", FROZEN),
    ("repeats OP sample for sample", WRONG),
    ("the position falls when OP rises", WRONG),
    ("the position does not go with OP", WRONG),
    ("so OP and position cannot be compared", WRONG),
    ("of the samples are missing or marked bad", BAD),
    ("so S and J would mean nothing", UNEXPLAINED),
)


def kinds_of(screening: Screening, *, stands: bool | None) -> tuple[str, ...]:
    """Every kind that ``screening`` holds, the one to act on first at the front.

    ``stands`` is whether its effects stand among all valves of the run (``None`` where none was
    named): effects that are held back are no kind of finding.
    """
    effects = tuple(one.slug for one in standing_effects(screening, stands=stands))
    found = screening.mismatch
    if found is not None and found.finding is Finding.UNKNOWN:
        effects = (*effects, UNKNOWN)
    if screening.verdict is Verdict.STICKY:
        shape = screening.shape or Shape.UNDERSHOOT
        return (STICTION[shape], *effects)
    if screening.verdict is Verdict.WATCH:
        return (*effects, DEPARTED if screening.shape is None else WATCH)
    if screening.verdict is Verdict.HEALTHY:
        # A difference that nothing explains, on a stem that follows, is no reason to go there.
        return tuple(one for one in effects if one != UNKNOWN) or (HEALTHY,)
    first = obstacle_kind(screening.reason)
    named = tuple(one for one in effects if one != UNKNOWN)
    return named or (first,) if first == RECORDING else (first, *named)


def standing_effects(screening: Screening, *, stands: bool | None) -> tuple[Effect, ...]:
    """The effects of ``screening`` that work may be planned on."""
    found = screening.mismatch
    return () if found is None or stands is False else found.effects


def needs_work(kinds: tuple[str, ...]) -> bool:
    """Whether somebody should go to the valve, rather than look again or record again."""
    return bool(set(kinds) - NO_WORK)


def obstacle_kind(reason: str) -> str:
    """The kind of an undetermined verdict by its ``reason``; ``recording`` for all that no work
    at the valve would mend."""
    return next((kind for said, kind in SAID_OF if said in reason), RECORDING)
