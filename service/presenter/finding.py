"""``present``: a finding in the words that every output uses.

HTML, PDF, work orders, tables, JSON, mail and terminal lay these texts out; none makes its own.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import ceil

from stemwatch.models.estimate import Estimate
from stemwatch.models.field_advice import FieldTest
from stemwatch.models.mismatch.findings import Effect, Finding, Mismatch
from stemwatch.models.oscillation_groups.plant_groups import OscillationGroup
from stemwatch.models.screening_result import Screening
from stemwatch.models.verdict import Verdict
from stemwatch.models.words import capitalised, listed
from stemwatch.service.presenter.advice import advice_for, effect_test, term_words
from stemwatch.service.presenter.beside_friction import beside_friction, without_them
from stemwatch.service.presenter.oscillation_words import where_to_look
from stemwatch.service.presenter.physics_words import effect_name, effect_names, other_members
from stemwatch.service.presenter.suspicion_words import (
    SUSPECTED_NOTE,
    worth_a_test,
    worth_a_test_sentence,
)
from stemwatch.service.presenter.wording import (
    VERDICT_MEANING,
    finite,
    not_yet_said,
    share,
)
from stemwatch.service.presenter.work_decision import NO_POSITION, WorkDecision, decide

MOST_STILL_SEEN = 2  # sentences on what can be seen without a verdict; the page has all
MOST_UNTESTABLE = 4  # effects that could not have shown, named one by one
# A drive may have no stem; every page says the word, and so says once what it means there.
MOTOR_DRIVE = "motor_drive"
STEM_OF_A_DRIVE = "The stem is here whatever the motor moves."
# From each S on, a manual test uses the step beside it: at least three steps, each large enough to
# see.
TEST_STEPS = ((3.0, 1.0), (1.5, 0.5), (0.0, 0.2))
LEAST_TESTED = 0.6  # percent; a smaller S cannot be measured in manual steps
NAMED_BY_CHANCE = (
    "What is said beside friction is held back: among all valves of this run chance alone may have "
    "named it."
)


@dataclass(frozen=True, kw_only=True)
class PresentedEffect:
    """One effect beside friction. ``instead`` names the effects that the recording cannot
    distinguish from it, ``decide`` is the test that can; both are empty where there is none.
    ``test`` shows the effect in the field, with the response that its own parameters predict;
    ``None`` for an effect of another version. ``as_built`` says why it asks for no work; empty for
    a defect."""

    slug: str
    name: str
    sentence: str
    where: str
    check: str
    instead: str
    decide: str
    evidence: str
    test: FieldTest | None = None
    as_built: str = ""

    @property
    def check_heading(self) -> str:
        """What ``check`` is for: what belongs to the machine is looked at only where it is new."""
        return "What to check, only if it was not always so" if self.as_built else "What to check"

    @property
    def passes(self) -> str:
        """What passes the field test, and that this effect needs no work where it is no defect."""
        if self.test is None:
            return ""
        passed = "; what was found here needs no work either" if self.as_built else ""
        return f"{self.test.passes}{passed}"

    @property
    def in_short(self) -> str:
        """What was found and what to check."""
        return f"{self.sentence} {self.check}".strip()


@dataclass(frozen=True, kw_only=True)
class PresentedFinding:
    """What is said of one valve. Texts are as they came; who lays them out makes them printable.

    ``title`` has at most 30 letters; ``found`` is what was found, a sentence or two each;
    ``still_seen`` what can be seen where there is no verdict; ``next_step`` what to do next;
    ``beside_friction`` what delays or slows the stem; ``otherwise`` what else it could be;
    ``held_back`` why what was named does not stand, empty where it does.
    """

    decision: WorkDecision
    title: str
    meaning: str
    found: tuple[str, ...]
    still_seen: tuple[str, ...]
    next_step: str
    beside_friction: str
    effects: tuple[PresentedEffect, ...]
    otherwise: tuple[str, ...]
    held_back: str

    @property
    def reason(self) -> str:
        """What was found, as one paragraph."""
        return " ".join(self.found)

    @property
    def in_full(self) -> str:
        """The same, with what can still be seen where there is no verdict."""
        return " ".join((*self.found, *self.still_seen[:MOST_STILL_SEEN]))


def present(
    screening: Screening,
    *,
    stands: bool | None,
    confirmed: tuple[str, ...] | None = None,
    held_back: str = "",
    groups: Sequence[OscillationGroup] = (),
) -> PresentedFinding:
    """The words of ``screening``.

    ``stands`` is whether its effects stand among all valves of the run, ``held_back`` why they do
    not, ``confirmed`` what the windows of weeks confirm (``work_decision.decide``), ``groups`` are
    the loops that oscillate together.
    """
    decision = decide(screening, stands=stands, confirmed=confirmed, groups=groups)
    mismatch = screening.mismatch
    return PresentedFinding(
        decision=decision,
        title=_title(screening, decision),
        meaning=VERDICT_MEANING[decision.verdict],
        found=_found_sentences(screening, decision, stands),
        still_seen=_still_seen(screening),
        next_step=_next_step(screening, decision, groups),
        beside_friction=_measured_beside(screening),
        effects=() if mismatch is None else present_effects(mismatch),
        otherwise=_otherwise(mismatch, decision.kinds, stands),
        held_back=held_back,
    )


def _title(screening: Screening, decision: WorkDecision) -> str:
    """The name of the finding to act on first; of a loop without a position, that sticking is
    suspected, by which a planner knows it from those that merely lack a transmitter."""
    if decision.kinds[0] == NO_POSITION and worth_a_test(screening):
        return SUSPECTED_NOTE
    return advice_for(decision.kinds[0]).title


def _still_seen(screening: Screening) -> tuple[str, ...]:
    """What can be seen where there is no verdict, beginning with the suspicion from OP and PV
    alone."""
    if screening.verdict is not Verdict.UNDETERMINED:
        return ()
    return tuple(filter(None, (worth_a_test_sentence(screening), *screening.still_seen)))


def _measured_beside(screening: Screening) -> str:
    """What delays or slows the stem by the quick fit; empty where effects were named, which say it
    better (a lag here and a rate limit there would be one thing under two names), or found not to
    be needed."""
    mismatch = screening.mismatch
    if mismatch is not None and (mismatch.effects or mismatch.finding is Finding.NONE):
        return ""
    return " ".join(filter(None, (beside_friction(screening), without_them(screening))))


def present_effects(mismatch: Mismatch) -> tuple[PresentedEffect, ...]:
    """The effects of a mismatch in words, what needs work first at the front."""
    return tuple(present_effect(effect) for effect in mismatch.effects)


def present_effect(effect: Effect) -> PresentedEffect:
    """One effect in words. What to check and the deciding test come from its term; an effect of
    another version is given as it was stored."""
    words = term_words(effect.slug)
    similar_effects = other_members(effect)
    decide = effect.decide if words is None else words.decide
    return PresentedEffect(
        slug=effect.slug,
        name=effect_name(effect.slug),
        sentence=effect.sentence,
        where=effect.where,
        check=effect.check if words is None else words.check,
        instead=effect_names(similar_effects),
        decide=decide if similar_effects else "",
        evidence=_evidence(effect),
        test=effect_test(effect),
        as_built=why_no_work([effect]) if effect.inherent else "",
    )


def _evidence(effect: Effect) -> str:
    """The evidence for the effect: how much of the error it removes on held-out samples."""
    evidence = effect.evidence
    squared = "Of the squared error on unseen blocks, in which large errors count most, it removes"
    return f"{evidence.note} {squared} {share(evidence.share)}.".lstrip()


def _found_sentences(
    screening: Screening, decision: WorkDecision, stands: bool | None
) -> tuple[str, ...]:
    """The screening's reason, each effect that stands, effects that other windows confirm, which of
    them are no defects, and that those the reason has besides are held back."""
    sentences, named_effects = [screening.reason], (*decision.effects, *decision.inherent)
    sentences += not_yet_said((effect.sentence for effect in named_effects), screening.reason)
    if decision.lasting:
        sentences.append(confirmed_by_others(decision.lasting))
    if decision.inherent:
        sentences.append(why_no_work(decision.inherent))
    mismatch = screening.mismatch
    if mismatch is not None and mismatch.finding is Finding.UNKNOWN:
        sentences += not_yet_said([mismatch.sentence], screening.reason)
    effects = () if mismatch is None or stands is not False else mismatch.effects
    if any(effect.sentence in screening.reason for effect in effects):
        sentences.append(NAMED_BY_CHANCE)
    return tuple(sentences)


def confirmed_by_others(slugs: Sequence[str]) -> str:
    """That the windows of weeks confirm the effects ``slugs``, which this one does not name."""
    them = "it" if len(slugs) == 1 else "them"
    return (
        f"{capitalised(effect_names(slugs))}: confirmed by the windows of the last weeks; this one "
        f"alone does not name {them}."
    )


def why_no_work(effects: Sequence[Effect]) -> str:
    """Why ``effects`` need no work: they belong to the design of the machine, or are small
    enough."""
    words = {effect.slug: term_words(effect.slug) for effect in effects}
    small = {
        slug: effect_words.no_work
        for slug, effect_words in words.items()
        if effect_words is not None and effect_words.no_work
    }
    as_built = [effect.slug for effect in effects if effect.slug not in small]
    sentences = [f"{capitalised(effect_name(slug))} is {reason}." for slug, reason in small.items()]
    if as_built:
        is_single = len(as_built) == 1
        belongs, none = ("belongs", "is no defect") if is_single else ("belong", "are no defects")
        names = capitalised(effect_names(as_built))
        sentences.insert(0, f"{names} {belongs} to such a machine and {none}.")
    if MOTOR_DRIVE in words:
        sentences.append(STEM_OF_A_DRIVE)
    return " ".join(sentences)


def field_test(screening: Screening) -> str:
    """A manual test with steps large enough to move this valve, and the response that its S and J
    predict; empty where they are not known or there is nothing to confirm.

    After a reversal the stick-slip element moves once the steps add up to S; with the last step it
    moves J plus the excess of the steps over S.
    """
    S, J = finite(screening.S.value), finite(screening.J.value) or 0.0
    if screening.verdict not in (Verdict.STICKY, Verdict.WATCH) or S is None or S < LEAST_TESTED:
        return ""
    step = next(step for least, step in TEST_STEPS if least <= S)
    low, high = finite(screening.S.low) or S, finite(screening.S.high) or S
    fewest, most_steps = _steps_for(low, step), _steps_for(high, step)
    expected = f"{_steps_for(S, step)}"
    if fewest != most_steps:
        expected += f" ({fewest} to {most_steps})"
    moves = "a move of no more than one step"
    if J >= step / 2:
        moves = f"a jump of {J:.1f} to {J + step:.1f} % of OP"
    return (
        f"Field test, loop in manual: step OP by {step:g} % in one direction until the stem "
        f"moves, then back; wait after each step. Expect about {expected} steps back until it "
        f"moves, then {moves}. A stem that answers the first or second step back passes."
    )


def _steps_for(S: float, step: float) -> int:
    """How many steps after a reversal add up to S, with a tolerance of a millionth."""
    return max(1, ceil(S / step - 1e-6))


def _next_step(
    screening: Screening, decision: WorkDecision, groups: Sequence[OscillationGroup]
) -> str:
    """The next step: the screening's advice, with three exceptions. A valve that does not stick but
    has a defect gets the advice for that defect, since the cause is not elsewhere. A valve that is
    healthy, or of which nothing can be told, and that oscillates because of another loop is
    referred to that loop first, which its own recording cannot know. Without a position, OP and PV
    decide what to do first, after the question which tag may be the position."""
    if decision.verdict is Verdict.DEFECTIVE and decision.effects:
        return present_effect(decision.effects[0]).check
    if decision.verdict is Verdict.DEFECTIVE:
        words = term_words(decision.lasting[0])
        return screening.advice if words is None else words.check
    if decision.verdict is Verdict.HEALTHY:
        look = where_to_look(groups, screening.valve)
        return f"Nothing to do at this valve. {look}" if look else screening.advice
    told = screening.without_position if decision.kinds[0] == NO_POSITION else None
    advice = screening.advice if told is None else told.advice
    asked = screening.provenance.position_question
    if asked and decision.kinds[0] == NO_POSITION:
        advice = f"{asked} {advice}"
    if decision.moved:
        return f"{where_to_look(groups, screening.valve)} After that: {advice}"
    return " ".join(filter(None, (advice, field_test(screening))))


def _otherwise(
    mismatch: Mismatch | None, kinds: tuple[str, ...], stands: bool | None
) -> tuple[str, ...]:
    """Other explanations: effects that look alike, effects that this recording cannot distinguish,
    effects that are held back, and effects that it could not have shown."""
    alternatives = list(advice_for(kinds[0]).otherwise)
    if mismatch is None:
        return tuple(alternatives)
    for effect in present_effects(mismatch):
        alternatives += _alternatives(effect, held_back=stands is False)
    if mismatch.not_testable:
        names = [effect_name(untestable.slug) for untestable in mismatch.not_testable]
        alternatives.append(
            f"This recording could not have shown {listed(names, MOST_UNTESTABLE)}; "
            f"the first because {mismatch.not_testable[0].reason.rstrip('.')}."
        )
    return tuple(alternatives)


def _alternatives(effect: PresentedEffect, *, held_back: bool) -> Iterable[str]:
    if held_back:
        return [f"Perhaps {effect.name}, which is held back: chance alone may have named it."]
    if not effect.instead:
        return []
    text = f"Instead of {effect.name}: {effect.instead}; this recording cannot tell them apart."
    return [f"{text} {effect.decide}".rstrip()]


def stiction_grown(before: Estimate | None, now: Estimate) -> str:
    """That S is larger than at the valve's baseline, each with its interval."""
    return f"S has grown from {before} at its baseline to {now} of OP span."


def baseline_left(ratio: float) -> str:
    """That the position follows its baseline network worse than it did, ``ratio`` times."""
    return (
        "The valve moves differently than when its baseline was set: a model of how it moved then "
        f"predicts its position {ratio:.1f} times worse now. That alone does not say what is "
        "wrong; its page shows where it differs."
    )
