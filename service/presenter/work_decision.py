"""The maintenance decision on a screening: what is wrong, what to act on first, how severe it is,
and whether the valve needs work. Every output uses it: report, tables, pages, PDF, mail, terminal.

A valve needs work where its stem sticks, or where a material effect beside friction was named that
stands among all valves of its run: it is then *defective*, whatever S and J say of its stem. Where
the valve has a history, that is what its windows of the last weeks confirm, whatever the newest of
them names. An effect that belongs to the machine, as a motor's lag, or is too small for work of its
own, as a zero error of 1 %, is named and asks for nothing. Valves to watch and those that cannot be
judged are counted apart.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

from stemwatch.models.mismatch.findings import Effect, Finding
from stemwatch.models.oscillation_groups.plant_groups import OscillationGroup
from stemwatch.models.screening_result import PreviousFinding, Screening
from stemwatch.models.verdict import NoVerdict, Shape, Verdict
from stemwatch.models.without_position.suspicion import Suspicion, WithoutPosition
from stemwatch.service.presenter.oscillation_words import is_moved_by_another
from stemwatch.service.presenter.wording import finite

# A kind of finding is a key of the advice: stiction by its shape, an effect by its slug, a way in
# which the position cannot be trusted.
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
MOVABLE = ((NO_POSITION,), (RECORDING,))
WITHOUT_PAGE = frozenset({HEALTHY, RECORDING, WATCH})

# Why there is no verdict, where that asks for work. Everything else only another recording mends.
KIND_OF = {
    NoVerdict.NO_POSITION: NO_POSITION,
    NoVerdict.POSITION_FROZEN: FROZEN,
    NoVerdict.POSITION_STILL: FROZEN,
    NoVerdict.POSITION_IS_OP: WRONG,
    NoVerdict.POSITION_REVERSED: WRONG,
    NoVerdict.POSITION_UNRELATED: WRONG,
    NoVerdict.POSITION_SUMS_OP: WRONG,
    NoVerdict.OP_UNIT: WRONG,
    NoVerdict.POSITION_UNIT: WRONG,
    NoVerdict.BAD_SAMPLES: BAD,
    NoVerdict.FRICTION_DOES_NOT_EXPLAIN: UNEXPLAINED,
    NoVerdict.POSITION_SWINGS: UNEXPLAINED,
    NoVerdict.READING_WANDERS: UNEXPLAINED,
    NoVerdict.STANDS_ON_A_STOP: UNEXPLAINED,
}

# A stem that may be stuck fast ranks with the worst sticky ones until somebody has checked it.
SEVERITY_OF = {FROZEN: 90.0, UNEXPLAINED: 45.0}
OTHER_SEVERITY = 35.0  # an effect beside friction, or a position signal that cannot be used
# Sticking suspected from OP and PV where the position tells nothing. At every criticality more than
# any other loop without a position, which is to be tested after it, and no higher priority than a
# stem that was seen to stick by the usual limit.
SUSPECTED_SEVERITY = 60.0


class WorkState(StrEnum):
    """Where a valve stands with maintenance, worst first."""

    NEEDS_WORK = "needs work"
    WATCH = "watch"
    NOT_JUDGED = "cannot be judged"
    NO_WORK = "no work"


STATE_OF = {
    Verdict.STICKY: WorkState.NEEDS_WORK,
    Verdict.DEFECTIVE: WorkState.NEEDS_WORK,
    Verdict.WATCH: WorkState.WATCH,
    Verdict.UNDETERMINED: WorkState.NOT_JUDGED,
    Verdict.HEALTHY: WorkState.NO_WORK,
}


class Ne107(StrEnum):
    """The states of NAMUR NE 107 (2017), in which field devices tell how they are."""

    NORMAL = "normal"
    FAILURE = "failure"
    CHECK_FUNCTION = "check function"
    OUT_OF_SPECIFICATION = "out of specification"
    MAINTENANCE_REQUIRED = "maintenance required"


# *Out of specification* is, for an actuator, a deviation from its set point that is larger than to
# be expected; *maintenance required* a function that is still there and soon will not be. *Failure*
# and *check function* only the device itself can know: in historian data a stuck stem looks like a
# dead transmitter, which allows no verdict, and without a verdict there is no state.
NE107_OF = {
    Verdict.STICKY: Ne107.OUT_OF_SPECIFICATION,
    Verdict.DEFECTIVE: Ne107.OUT_OF_SPECIFICATION,
    Verdict.WATCH: Ne107.MAINTENANCE_REQUIRED,
    Verdict.HEALTHY: Ne107.NORMAL,
}


def ne107_word(verdict: Verdict | None) -> str | None:
    """The state by NAMUR NE 107 of a valve with this verdict; ``None`` where there is none."""
    state = None if verdict is None else NE107_OF.get(verdict)
    return None if state is None else state.value


@dataclass(frozen=True, kw_only=True)
class WorkDecision:
    """The decision on one screening.

    ``verdict`` is the word that every output shows; ``kinds`` has the kind to act on first at its
    front; ``severity`` is 0 to 100 (NaN: not known); ``confidence`` in ``verdict`` is 0 to 1;
    ``effects`` are those that work may be planned on, ``inherent`` those that stand as well but are
    how such a machine is made or may be. ``lasting`` has the slugs of defects that the windows of
    weeks confirm and this one does not name: work is planned on them too. ``no_sign``: there is no
    position, and OP and PV show no sign of sticking where even a small S would have shown, so that
    there is nothing to do at the valve; ``moved``: too little can be told of it, and another loop,
    or what reaches several, makes it oscillate.
    """

    verdict: Verdict
    kinds: tuple[str, ...]
    severity: float
    confidence: float | None = None
    effects: tuple[Effect, ...] = ()
    inherent: tuple[Effect, ...] = ()
    lasting: tuple[str, ...] = ()
    no_sign: bool = False
    moved: bool = False

    @property
    def state(self) -> WorkState:
        """Where the valve stands with maintenance."""
        return STATE_OF[self.verdict]

    @property
    def ne107(self) -> str | None:
        """The state by NAMUR NE 107; ``None`` where there is no verdict, which is no state."""
        return ne107_word(self.verdict)

    @property
    def needs_work(self) -> bool:
        """Whether the valve should be repaired."""
        return self.state is WorkState.NEEDS_WORK

    @property
    def has_page(self) -> bool:
        """Whether the valve gets a page in the maintenance report: there is something to inspect or
        to find out."""
        return bool(set(self.kinds) - WITHOUT_PAGE)

    @property
    def has_order(self) -> bool:
        """Whether it makes a work order: on the valve, or on what keeps it from being judged."""
        nothing_here = self.no_sign or self.moved
        to_find_out = self.has_page and self.state is WorkState.NOT_JUDGED and not nothing_here
        return self.needs_work or to_find_out


def decide(
    screening: Screening,
    *,
    stands: bool | None,
    confirmed: tuple[str, ...] | None = None,
    groups: Sequence[OscillationGroup] = (),
) -> WorkDecision:
    """The decision on ``screening``.

    ``stands`` is whether its effects stand among all valves of the run (``None`` where none was
    named): effects that are held back are no finding. ``confirmed`` are the slugs that the windows
    of the last weeks confirm, ``None`` where the valve has no history that decides. ``groups`` are
    the loops that oscillate together.
    """
    mismatch = screening.mismatch
    named_effects = () if mismatch is None or stands is False else mismatch.effects
    effects = tuple(effect for effect in named_effects if not effect.inherent)
    lasting: tuple[str, ...] = ()
    if confirmed is not None and mismatch is not None:
        effects = tuple(effect for effect in effects if not _class_of(effect).isdisjoint(confirmed))
        named_now = frozenset[str]().union(*map(_class_of, effects))
        lasting = tuple(slug for slug in confirmed if slug not in named_now)
    kinds = kinds_of(
        screening.verdict,
        shape=screening.shape,
        no_verdict=screening.no_verdict,
        named=(*(effect.slug for effect in effects), *lasting),
        finding=None if mismatch is None else mismatch.finding,
    )
    verdict = overall_verdict(screening.verdict, named=bool(effects or lasting))
    alone = screening.without_position if kinds[0] == NO_POSITION else None
    return WorkDecision(
        verdict=verdict,
        kinds=kinds,
        no_sign=alone is not None and alone.leaves_nothing_to_do,
        severity=severity_of(
            screening.verdict, screening.severity, kinds, screening.without_position
        ),
        confidence=confidence_in(verdict, screening.confidence),
        effects=effects,
        inherent=tuple(effect for effect in named_effects if effect.inherent),
        lasting=lasting,
        moved=is_moved(kinds, screening.without_position, groups, screening.valve),
    )


def is_moved(
    kinds: tuple[str, ...],
    told: WithoutPosition | None,
    groups: Sequence[OscillationGroup],
    valve: str,
) -> bool:
    """Whether to look elsewhere first: what can be ``told`` of the valve, by OP and PV alone, is
    neither that it is suspected nor that it needs nothing, and one of ``groups`` makes it
    oscillate."""
    is_told = told is not None and (
        told.verdict is Suspicion.SUSPECTED or told.leaves_nothing_to_do
    )
    return kinds in MOVABLE and not is_told and is_moved_by_another(groups, valve)


def _class_of(effect: Effect) -> frozenset[str]:
    """The effect's slug and those that its window could not tell from it."""
    return frozenset({effect.slug, *effect.members})


def overall_verdict(of_stem: Verdict, *, named: bool) -> Verdict:
    """The verdict on the valve from that on its stem, which S and J give, and from whether a defect
    beside friction was ``named`` that stands.

    ``needs_work`` is defined here and in ``STATE_OF`` only.
    """
    return Verdict.DEFECTIVE if named and of_stem is not Verdict.STICKY else of_stem


def verdict_before(past: PreviousFinding) -> Verdict:
    """The verdict on the valve in an earlier screening."""
    defects = past.effects if past.defects is None else past.defects
    return overall_verdict(past.verdict, named=bool(defects))


def confidence_in(verdict: Verdict, of_stem: float | None) -> float | None:
    """The confidence in the verdict on the valve, 0 to 1. Bootstrap draws of S say nothing about an
    effect beside friction; its certainty is given with its evidence."""
    return None if verdict is Verdict.DEFECTIVE else of_stem


def obstacle_kind(no_verdict: NoVerdict | None) -> str:
    """The kind of an undetermined verdict; ``recording`` for all that no work at the valve would
    mend, and where the reason is not known."""
    return RECORDING if no_verdict is None else KIND_OF.get(no_verdict, RECORDING)


def can_be_tested(screening: Screening) -> bool:
    """Whether a test can be planned that tells what the screening left open: not where the position
    signal, by which it would be judged, is not there or is to be mended."""
    if screening.verdict is Verdict.UNDETERMINED:
        has_signals = screening.open_question is not None
        return has_signals and obstacle_kind(screening.no_verdict) not in SIGNAL
    question = None if screening.mismatch is None else screening.mismatch.open_question
    return question is not None and len(question.quick) > 1


def kinds_of(
    verdict: Verdict,
    *,
    shape: Shape | None,
    no_verdict: NoVerdict | None,
    named: tuple[str, ...],
    finding: Finding | None,
) -> tuple[str, ...]:
    """Every kind that a screening holds, the one to act on first at the front.

    ``named`` are the slugs of the effects that stand; ``no_verdict`` is why there is none.
    """
    unknown = (UNKNOWN,) if finding is Finding.UNKNOWN else ()
    if verdict is Verdict.STICKY:
        return (STICTION[shape or Shape.UNDERSHOOT], *named, *unknown)
    if verdict is Verdict.WATCH:
        return (*named, *unknown, DEPARTED if shape is None else WATCH)
    if verdict is Verdict.HEALTHY:
        # An unexplained difference on a stem that follows OP is no reason to inspect the valve.
        return named or (HEALTHY,)
    first = obstacle_kind(no_verdict)
    return named or (first,) if first == RECORDING else (first, *named)


def severity_of(
    verdict: Verdict,
    measured: float | None,
    kinds: tuple[str, ...],
    told: WithoutPosition | None,
) -> float:
    """0 to 100, NaN where not known: the worst of what was ``measured`` and of what ``kinds`` are
    worth by themselves; without a usable position also what is ``told`` by OP and PV alone.

    It is the screening's own where S and J were judged; a position that cannot be trusted and an
    effect beside friction have one of their own, because the screening ranks them by what it could
    not measure.
    """
    own_severities = [
        SEVERITY_OF.get(kind, OTHER_SEVERITY) for kind in kinds if _has_own_severity(kind)
    ]
    if kinds[0] in SIGNAL and told is not None and told.verdict is Suspicion.SUSPECTED:
        own_severities.append(SUSPECTED_SEVERITY)
    judged = finite(measured)
    if judged is not None and (verdict is not Verdict.UNDETERMINED or not own_severities):
        own_severities.append(judged)
    return min(max(own_severities), 100.0) if own_severities else math.nan


def _has_own_severity(kind: str) -> bool:
    return kind not in WITHOUT_PAGE and kind not in STICTION.values()
