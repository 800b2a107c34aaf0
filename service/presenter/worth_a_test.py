"""What OP and PV alone say of valves, in words: its title, and which loops to look at first."""

from __future__ import annotations

from collections.abc import Iterable

from stemwatch.models.screening_result import Screening
from stemwatch.models.verdict import Verdict
from stemwatch.models.without_position.suspicion import Suspicion, WithoutPosition

TITLES = {
    Suspicion.SUSPECTED: "By OP and PV alone: sticking suspected",
    Suspicion.NO_SIGN: "By OP and PV alone: no sign of sticking",
    Suspicion.CANNOT_TELL: "By OP and PV alone: cannot tell",
}


def suspicion_title(told: WithoutPosition) -> str:
    """The heading over what OP and PV alone say."""
    return TITLES[told.verdict]


def worth_a_test(screening: Screening) -> bool:
    """Whether the loop deserves a position transmitter or a test before the others: it has no
    verdict, and OP and PV alone let sticking be suspected."""
    told = screening.without_position
    return (
        screening.verdict is Verdict.UNDETERMINED
        and told is not None
        and told.verdict is Suspicion.SUSPECTED
    )


def suspected_sentence(valves: Iterable[str]) -> str:
    """Which of the valves without a verdict to test first, in the order given; empty for none."""
    named = list(dict.fromkeys(valves))
    if not named:
        return ""
    loops = "loop deserves" if len(named) == 1 else "loops deserve"
    return (
        f"{len(named)} {loops} a position transmitter or a test first, because OP and PV let "
        f"sticking be suspected there: {', '.join(named)}."
    )
