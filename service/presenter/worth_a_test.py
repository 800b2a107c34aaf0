"""What OP and PV alone say of valves, in words: its title, and which loops to look at first."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from stemwatch.models.screening_result import Screening
from stemwatch.models.verdict import Verdict
from stemwatch.models.without_position.suspicion import Suspicion, WithoutPosition
from stemwatch.service.presenter.wording import figure, finite

# Counted on seed 2067 and on the recordings of docs/without-position.md.
HOW_SURE = (
    "Of 185 such suspicions on simulated valves 184 were right; of three on 61 real loops with "
    "known answers two were: test before anything is opened."
)
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
    verdict, and OP and PV alone let sticking be suspected."""
    suspicion = screening.without_position
    return (
        screening.verdict is Verdict.UNDETERMINED
        and suspicion is not None
        and suspicion.verdict is Suspicion.SUSPECTED
    )


def worth_a_test_sentence(screening: Screening) -> str:
    """That a loop is worth a test before the others; empty where it is not."""
    suspicion = screening.without_position
    if suspicion is None or not worth_a_test(screening):
        return ""
    score = f" (score {figure(suspicion.score, 2)} of 1)" if finite(suspicion.score) else ""
    return f"{suspicion_title(suspicion)}{score}. Test it before other loops without a position."


def loops_to_test(screenings: Iterable[Screening]) -> tuple[str, ...]:
    """The valves that are worth a test, in the order given: of several recordings of a valve at
    least half must let it be suspected, since one in many does so by chance."""
    votes: dict[str, list[bool]] = {}
    for screening in screenings:
        votes.setdefault(screening.valve, []).append(worth_a_test(screening))
    return tuple(
        valve
        for valve, votes_of_valve in votes.items()
        if 2 * sum(votes_of_valve) >= len(votes_of_valve)
    )


def suspected_sentence(named: Sequence[str]) -> str:
    """Which of the valves without a verdict to test first, in the order given; empty for none."""
    if not named:
        return ""
    loops = "loop deserves" if len(named) == 1 else "loops deserve"
    return (
        f"{len(named)} {loops} a position transmitter or a test first, because OP and PV let "
        f"sticking be suspected there: {', '.join(named)}. {HOW_SURE}"
    )
