"""The suspicion from OP and PV alone in words: its title, and which loops to test first."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

from stemwatch.models.oscillation_groups.plant_groups import OscillationGroup
from stemwatch.models.screening_result import Screening
from stemwatch.models.verdict import NoVerdict, Verdict
from stemwatch.models.without_position.no_sign import MOSTLY
from stemwatch.models.without_position.several_recordings import (
    not_borne_out,
    suspected_together,
)
from stemwatch.models.without_position.suspicion import (
    NOTHING_TO_DO,
    Suspicion,
    WithoutPosition,
)
from stemwatch.service.presenter.oscillation_words import is_moved_by_another, where_to_look
from stemwatch.service.presenter.wording import figure, finite
from stemwatch.service.presenter.work_decision import NO_POSITION, SIGNAL, obstacle_kind

# Counted on seed 2126 and on the recordings of docs/without-position.md.
HOW_SURE = (
    "Of 249 such suspicions on simulated valves 244 were right. Of six on 61 real loops with known "
    "answers four were right; the other two are likely disturbances. Run a test before "
    "you open a valve."
)
SUSPECTED_NOTE = "sticking suspected"  # beside the verdict in a ranking
NO_SIGN_NOTE = "no sign of sticking"
MOVED = "it oscillates with other loops, and that likely does not begin here."
MOST_NAMED = 20  # loops in a line of the list of next steps
_NUMBER = re.compile(r"\d+(?:\.\d+)?(?:e[+-]?\d+)?")
TITLES = {
    Suspicion.SUSPECTED: "By OP and PV alone: sticking suspected",
    Suspicion.NO_SIGN: "By OP and PV alone: no sign of sticking",
    Suspicion.CANNOT_TELL: "By OP and PV alone: cannot tell",
}


def suspicion_title(suspicion: WithoutPosition) -> str:
    """The heading over what OP and PV alone say."""
    return TITLES[suspicion.verdict]


def worth_a_test(screening: Screening) -> bool:
    """Whether the loop deserves a position transmitter or a test before the others: it has no
    verdict, and sticking is suspected from OP and PV alone."""
    suspicion = screening.without_position
    return (
        screening.verdict is Verdict.UNDETERMINED
        and suspicion is not None
        and suspicion.verdict is Suspicion.SUSPECTED
    )


def score_of_suspicion(verdict: Verdict, suspicion: WithoutPosition | None) -> float:
    """By which valves without a verdict are ordered in every ranking where their severity is the
    same: the score of those that are worth a test before the others, else 0."""
    if verdict is not Verdict.UNDETERMINED or suspicion is None:
        return 0.0
    suspected = suspicion.verdict is Suspicion.SUSPECTED
    return finite(suspicion.score) or 0.0 if suspected else 0.0


def worth_a_test_sentence(screening: Screening) -> str:
    """That a loop is worth a test before the others; empty where it is not."""
    suspicion = screening.without_position
    if suspicion is None or not worth_a_test(screening):
        return ""
    score = f" (score {figure(suspicion.score, 2)} of 1)" if finite(suspicion.score) else ""
    return f"{suspicion_title(suspicion)}{score}. Test it before other loops without a position."


class AnsweredLoop(Protocol):
    """A valve with what S and J say of its stem, and what OP and PV alone say."""

    @property
    def valve(self) -> str: ...

    @property
    def verdict(self) -> Verdict: ...

    @property
    def reason(self) -> str: ...

    @property
    def advice(self) -> str: ...

    @property
    def no_verdict(self) -> NoVerdict | None: ...

    @property
    def without_position(self) -> WithoutPosition | None: ...


@dataclass(frozen=True, kw_only=True)
class NextStep:
    """What to do next at loops with the same answer from OP and PV alone: ``answer`` and ``why`` in
    words, ``step``, and the ``loops``, the likeliest to stick first."""

    verdict: Suspicion
    answer: str
    why: str
    step: str
    loops: tuple[str, ...]

    @property
    def named(self) -> tuple[str, ...]:
        """As many loops as a line holds."""
        return self.loops[:MOST_NAMED]

    @property
    def unnamed(self) -> str:
        """How many more there are; empty where all are named."""
        more = len(self.loops) - MOST_NAMED
        return f" and {more} more" if more > 0 else ""


def next_steps(
    screenings: Iterable[AnsweredLoop], groups: Sequence[OscillationGroup] = ()
) -> tuple[NextStep, ...]:
    """What to do at the valves without a verdict, those to test first at the front, then by how
    many loops each step helps; what needs nothing last.

    A valve counts once. It is suspected only if its recordings together raise the suspicion
    (``suspected_together``), since one in many does so by chance; otherwise the commonest answer
    counts, and no sign only where none of its recordings leaves the question open or raises the
    suspicion, nothing to do only where in each even a small S would have shown: any other makes a
    work order.
    Where the position signal itself is to be mended, that OP and PV show no sign is no reason to do
    nothing. A loop that another one moves, by the ``groups`` that oscillate together, needs no test
    of its own before that one was looked at.
    """
    by_valve: dict[str, list[WithoutPosition]] = {}
    judged: set[str] = set()
    for screening in screenings:
        if screening.verdict is not Verdict.UNDETERMINED:
            judged.add(screening.valve)
        elif (answer := _answer(screening)) is not None:
            by_valve.setdefault(screening.valve, []).append(answer)
    loops: dict[tuple[Suspicion, str, str], list[tuple[float, str, str]]] = {}
    for valve, answers in by_valve.items():
        if valve in judged:
            continue
        same, most = _of_most(answers)
        why = _why(most)
        if same[0] is Suspicion.CANNOT_TELL and is_moved_by_another(groups, valve):
            why = MOVED
            same = (same[0], why, where_to_look(groups, valve))
        loops.setdefault(same, []).append((-(finite(most.score) or 0.0), valve, why))
    steps = [
        NextStep(
            verdict=verdict,
            answer=TITLES[verdict].partition(": ")[2],
            why=_with_ranges([own for _, _, own in valves]),
            step=advice,
            loops=tuple(valve for _, valve, _ in sorted(valves)),
        )
        for (verdict, _, advice), valves in loops.items()
    ]
    order = (Suspicion.SUSPECTED, Suspicion.CANNOT_TELL, Suspicion.NO_SIGN)

    def place(step: NextStep) -> tuple[int, bool, int]:
        return order.index(step.verdict), step.step == NOTHING_TO_DO, -len(step.loops)

    return tuple(sorted(steps, key=place))


def _answer(screening: AnsweredLoop) -> WithoutPosition | None:
    """What OP and PV alone say; ``None`` where the position signal is to be mended. Where they
    cannot tell and there is a position, why and what to do are those of the verdict."""
    answer = screening.without_position
    if answer is None or _signal_to_mend(screening):
        return None
    blind = obstacle_kind(screening.no_verdict) == NO_POSITION
    if answer.verdict is Suspicion.CANNOT_TELL and not blind:
        return replace(answer, reason=screening.reason, advice=screening.advice)
    return answer


def _signal_to_mend(screening: AnsweredLoop) -> bool:
    """Whether there is a position that cannot be used, and OP and PV give nothing to do."""
    answer = screening.without_position
    at_fault = obstacle_kind(screening.no_verdict) in SIGNAL - {NO_POSITION}
    return at_fault and answer is not None and answer.verdict is Suspicion.NO_SIGN


def _of_most(
    answers: Sequence[WithoutPosition],
) -> tuple[tuple[Suspicion, str, str], WithoutPosition]:
    """What most of a valve's recordings say, and the first of them that says it."""
    suspicions = [answer for answer in answers if answer.verdict is Suspicion.SUSPECTED]
    if suspected_together(answers):
        most_like_sticking = max(suspicions, key=lambda answer: finite(answer.score) or 0.0)
        return _sameness(most_like_sticking), most_like_sticking
    open_ones = [answer for answer in answers if answer.verdict is Suspicion.CANNOT_TELL]
    open_ones += [not_borne_out(one, len(suspicions), len(answers)) for one in suspicions[:1]]
    others = open_ones or [one for one in answers if not one.leaves_nothing_to_do] or answers
    ((same, _),) = Counter(_sameness(answer) for answer in others).most_common(1)
    return same, next(answer for answer in others if _sameness(answer) == same)


def _sameness(answer: WithoutPosition) -> tuple[Suspicion, str, str]:
    """Verdict, reason and advice, without the numbers in which loops differ."""
    return answer.verdict, _NUMBER.sub("…", _why(answer)), answer.advice


def _with_ranges(reasons: Sequence[str]) -> str:
    """One sentence for ``reasons`` that differ in their numbers alone: each number as the range
    from the least to the largest."""
    of_place = zip(*(_NUMBER.findall(reason) for reason in reasons), strict=True)
    ends = [(min(numbers, key=float), max(numbers, key=float)) for numbers in of_place]
    texts = iter(low if low == high else f"{low} to {high}" for low, high in ends)
    return _NUMBER.sub(lambda _: next(texts), reasons[0])


def _why(answer: WithoutPosition) -> str:
    """What OP and PV show, or why no answer is possible, without the words that all such reasons
    begin with."""
    if answer.verdict is Suspicion.CANNOT_TELL:
        return answer.reason.partition(": ")[2]
    S = answer.apparent_S.value
    unit = f" {answer.apparent_S.unit}".rstrip()
    if answer.verdict is Suspicion.SUSPECTED and finite(S) is not None:
        return f"it looks as if the valve sticks by {figure(S, 2)}{unit} of OP."
    shows = finite(answer.shows_from)
    if answer.verdict is Suspicion.NO_SIGN and shows is not None:
        return (
            f"a valve that sticks by {figure(shows, 2)}{unit} of OP or more would have shown "
            f"{MOSTLY}."
        )
    return ""


def loops_to_test(steps: Iterable[NextStep]) -> tuple[str, ...]:
    """The valves that deserve a position transmitter or a test first."""
    suspected = (step for step in steps if step.verdict is Suspicion.SUSPECTED)
    return tuple(valve for step in suspected for valve in step.loops)


def loops_without_sign(steps: Iterable[NextStep]) -> tuple[str, ...]:
    """The valves at which OP and PV show no sign of sticking."""
    without_sign = (step for step in steps if step.verdict is Suspicion.NO_SIGN)
    return tuple(valve for step in without_sign for valve in step.loops)


def answers_sentence(steps: Sequence[NextStep]) -> str:
    """At how many of the valves without a verdict OP and PV alone say what, and which to test
    first; empty where they were asked at none."""
    count = Counter({verdict: 0 for verdict in Suspicion})
    for step in steps:
        count[step.verdict] += len(step.loops)
    if not count.total():
        return ""
    asked = "one valve" if count.total() == 1 else f"{count.total()} valves"
    words = {
        Suspicion.SUSPECTED: "suspected of sticking",
        Suspicion.NO_SIGN: "without any sign of it",
        Suspicion.CANNOT_TELL: "left open",
    }
    counted = ", ".join(f"{count[verdict]} {said}" for verdict, said in words.items())
    # Where the position reading is to be mended nothing is said of OP and PV, and the headline
    # counts such a valve too.
    sentence = (
        f"What OP and PV alone tell of {asked} without a verdict, faulty position readings aside: "
        f"{counted}."
    )
    return " ".join(filter(None, (sentence, suspected_sentence(loops_to_test(steps)))))


def suspected_sentence(named: Sequence[str]) -> str:
    """Which of the valves without a verdict to test first, in the order given; empty for none."""
    if not named:
        return ""
    loops = "loop deserves" if len(named) == 1 else "loops deserve"
    return (
        f"{len(named)} {loops} a position transmitter or a test first, since OP and PV look like "
        f"a sticking valve: {', '.join(named)}. {HOW_SURE}"
    )
