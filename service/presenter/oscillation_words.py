"""Sentences about loops that oscillate together: about a group, and about one loop in it."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import tzinfo

from stemwatch.models.oscillation_groups.plant_groups import OscillationGroup
from stemwatch.models.words import listed
from stemwatch.service.presenter import wording as words

NAMED = 3  # other loops that a sentence names
WORTH_NAMING = 0.05  # probability from which on the second loop is named
LIKELY = 0.5  # probability from which on a loop is called the likely source


def period(group: OscillationGroup) -> str:
    """The period as people say it, to two digits."""
    return period_in_words(group.period_s)


def period_in_words(seconds: float) -> str:
    """A period as people say it, to two digits, in seconds, minutes or hours."""
    if seconds < 120.0:
        return f"{words.figure(seconds, 2)} s"
    if seconds < 7200.0:
        return f"{words.figure(seconds / 60.0, 2)} min"
    return f"{words.figure(seconds / 3600.0, 2)} h"


def headline(group: OscillationGroup) -> str:
    """How many loops, with which period, and where it likely begins."""
    every = f"{len(group.members)} loops oscillate together every {period(group)}"
    return f"{every}: {source_clause(group)}"


def probability(share: float) -> str:
    """That a loop is the source, as percent; a ranking is never certain."""
    return "over 99 %" if share > 0.99 else words.share(share)


def source_clause(group: OscillationGroup) -> str:
    """Where the oscillation likely originates, and how certain that is."""
    if not group.source:
        return (
            "most likely none of them is the source "
            f"({words.share(group.outside)}); look at what reaches them all, such as a header, a "
            "compressor or a loop that is not in this run"
        )
    first, second = group.members[:2]
    sure = "likely" if first.probability >= LIKELY else "perhaps"
    begins = f"it {sure} begins in {first.loop} ({probability(first.probability)})"
    if second.probability < WORTH_NAMING:
        return begins
    return f"{begins}, else in {second.loop} ({words.share(second.probability)})"


def cost_sentence(group: OscillationGroup) -> str:
    """What the group costs: how much of the movement of how many loops."""
    return (
        f"It makes {words.share(group.variance_share)} of the variance of these "
        f"{len(group.members)} loops on average, and up to "
        f"{words.share(max(member.share for member in group.members))} of one."
    )


def begin_clause(group: OscillationGroup, zone: tzinfo) -> str:
    """Since when it oscillates; empty where it always did or this is not known."""
    if group.since is not None:
        return f"since {words.instant(group.since, zone)}"
    if group.first_found is not None:
        return f"since {words.instant(group.first_found, zone)} or earlier"
    return ""


def seen_sentence(group: OscillationGroup) -> str:
    """In how many windows it was found; empty where only in this one."""
    return f"It was found in {group.windows} windows so far." if group.windows > 1 else ""


def loop_sentence(group: OscillationGroup, loop: str, zone: tzinfo) -> str:
    """The sentence on a member's page."""
    member = next(candidate for candidate in group.members if candidate.loop == loop)
    since = begin_clause(group, zone)
    when = f" {since}" if since else ""
    sentence = f"{words.share(member.share)} of its PV's variance, period {period(group)}"
    others = [member.loop for member in group.members if member.loop != loop]
    if group.source == loop:
        evidence = f": {', '.join(member.evidence)}" if member.evidence else ""
        return (
            f"Oscillates{when} with {listed(others, NAMED)} ({sentence}); of these loops it is the "
            f"likeliest source ({probability(member.probability)}){evidence}."
        )
    if not group.source:
        with_whom = others[0] if len(others) == 1 else f"{len(others)} other loops"
        return (
            f"Oscillates{when} with {with_whom} ({sentence}); most likely none of them is the "
            "source. Retuning this one alone would not help."
        )
    return (
        f"Oscillates{when} with {group.source} ({sentence}), where it more likely begins. Look "
        "there first: retuning this loop would not help."
    )


def loop_sentences(groups: Sequence[OscillationGroup], loop: str, zone: tzinfo) -> list[str]:
    """Those sentences of every group of which the loop is a member."""
    return [
        loop_sentence(group, loop, zone)
        for group in groups
        if any(member.loop == loop for member in group.members)
    ]


def is_moved_by_another(groups: Sequence[OscillationGroup], loop: str) -> bool:
    """Whether ``loop`` oscillates because of another loop, or of what reaches several: its groups
    likely begin elsewhere, and none of them in it."""
    of_it = [group for group in groups if any(member.loop == loop for member in group.members)]
    return any(_likeliest(group) >= LIKELY for group in of_it) and all(
        group.source != loop for group in of_it
    )


def _likeliest(group: OscillationGroup) -> float:
    return max(group.outside, group.members[0].probability)


def where_to_look(groups: Sequence[OscillationGroup], loop: str) -> str:
    """Where to look for the cause of the oscillation of a ``loop``; empty where it is in no group
    or is the likeliest source itself."""
    of_it = [group for group in groups if any(member.loop == loop for member in group.members)]
    if not of_it or any(group.source == loop for group in of_it):
        return ""
    begun = next((group.source for group in of_it if group.source), "")
    if begun:
        return (
            f"Look at {begun} first, where its oscillation likely begins. Retuning this loop would "
            "not help."
        )
    return (
        "Look first at what reaches all loops that oscillate with it, such as a header or a "
        "compressor. Retuning this one alone would not help."
    )
