"""The words for a mismatch: its verdict, its effects, its facets."""

from __future__ import annotations

from collections.abc import Iterable

from stemwatch.models.estimate import Estimate
from stemwatch.models.mismatch.findings import (
    NO_TOP_SPEED,
    Effect,
    Finding,
    Mismatch,
    TriedOutcome,
)
from stemwatch.service.presenter.wording import figure, finite, share

# A symbol beside each word, so that no meaning depends on colour alone.
FINDING_SYMBOL = {
    Finding.NAMED: "◆",
    Finding.CANDIDATES: "◇",
    Finding.UNKNOWN: "?",
    Finding.NONE: "✓",
    Finding.NOT_TESTABLE: "–",
}
FINDING_TITLE = {
    Finding.NAMED: "hidden physics named",
    Finding.CANDIDATES: "candidates that this recording cannot tell apart",
    Finding.UNKNOWN: "nothing that can be named",
    Finding.NONE: "nothing left out",
    Finding.NOT_TESTABLE: "cannot be tested",
}
FINDING_MEANING = {
    Finding.NAMED: "what is named explains what S and J leave over, and nothing else does as well",
    Finding.CANDIDATES: "effects that this recording cannot tell apart; a test would",
    Finding.UNKNOWN: "what is left fits nothing in the catalogue, or may be nothing",
    Finding.NONE: "S and J explain the recording, scatter of the breakaways included",
    Finding.NOT_TESTABLE: "the recording could not have shown anything",
}
OUTCOME_MEANING = {
    TriedOutcome.NAMED: "named",
    TriedOutcome.AS_GOOD: "explains it as well: this recording cannot tell it from what is named",
    TriedOutcome.ADDS_NOTHING: "helps alone, but adds nothing beside what is named",
    TriedOutcome.TOO_SMALL: "perhaps there, but too small to need work",
    TriedOutcome.CHANCE: "gains no more than on recordings with nothing hidden",
    TriedOutcome.NOT_HELD: "helps in places, but does not stand on the whole record",
}
FACETS = {
    "phase": "By phase of the motion",
    "direction": "By direction",
    "rest": "By rest before the move",
    "travel": "By travel, % of MV",
    "speed": "By speed of the command",
    "time": "By time in the record",
}


def finding_title(mismatch: Mismatch) -> str:
    """What stands above the sentence of ``mismatch``: where only some of its effects have rivals,
    the others are named."""
    some_alone = any(len(effect.members) == 1 for effect in mismatch.effects)
    if mismatch.finding is Finding.CANDIDATES and some_alone:
        return "named, with candidates that this recording cannot tell apart"
    return FINDING_TITLE[mismatch.finding]


def effect_name(slug: str) -> str:
    """The name of an effect in words: ``actuator_lag`` is an actuator lag."""
    return slug.replace("_", " ")


# What the parameters of an effect mean; where two effects use one letter, by effect and letter.
PARAMETERS = {
    "A": "extra friction",
    "bend": "pull at 50 % of travel beyond halfway from 25 to 75 %",
    "bow": "height of the bow",
    "c": "travel given for a percent of OP",
    "D": "drift over the record",
    "H": "what the spring holds back of a turn",
    "U": "push of the fluid at mid-travel",
    "creep": "speed of the creep",
    "dwell_dependent_breakaway.b": "rise of the breakaway for 2.7 times the rest",
    "gain": "reading for 1 % of travel",
    "growth": "growth over the record",
    "late_s": "OP stored late by",
    "delay_s": "MV follows OP by",
    "lost_motion.b": "play",
    "place": "at travel",
    "range": "range of the drift",
    "rate": "top speed",
    "rate_falling": "top speed falling",
    "rate_rising": "top speed rising",
    "ratio": "jump rising over jump falling",
    "recovery": "time constant of the recovery",
    "rise": "pull at 75 % of travel more than at 25 %",
    "run_up": "time to run up",
    "sag": "share of a move that is missing",
    "stop_high": "upper stop",
    "stop_low": "lower stop",
    "tau": "time constant",
    "tau_falling": "time constant falling",
    "tau_rising": "time constant rising",
    "tau_v": "time constant of the slide",
    "theta": "dead time",
    "way": "travel over which it turns",
    "v_c": "speed below which it sticks again",
    "width": "half width",
    "wn": "natural frequency",
    "zero": "error of the zero",
    "zeta": "damping ratio",
}


def parameter_name(name: str, slug: str = "") -> str:
    """A number of the effect ``slug`` in words: ``theta`` of a dead time is the dead time."""
    return PARAMETERS.get(f"{slug}.{name}") or PARAMETERS.get(name) or effect_name(name)


# Endings of the names of recorder and archive parameters, and the unit of each.
RECORD_UNITS = {"_percent": "%", "_s": "s", "_samples": "samples"}


def record_parameter(name: str, value: float) -> str:
    """A number of what recorder or archive did, with its unit: "step 0.10 %"."""
    for ending, unit in RECORD_UNITS.items():
        if name.endswith(ending):
            known = PARAMETERS.get(name) or effect_name(name.removesuffix(ending))
            return f"{known} {figure(value, 2)} {unit}"
    if name.endswith("_share"):
        return f"{effect_name(name)} {share(value)}"
    text = f"{value:.0f}" if value == round(value) else figure(value, 2)
    return f"{parameter_name(name)} {text}"


def no_limit(estimate: Estimate) -> bool:
    """Whether a top speed is so high that the stem has no speed limit."""
    return estimate.unit == "%/s" and (finite(estimate.value) or 0.0) >= NO_TOP_SPEED


ALONE = "S and J alone"


def rival_names(slugs: Iterable[str]) -> tuple[str, ...]:
    """Rival models as people say them; the empty slug is S and J alone."""
    return tuple(effect_name(slug) or ALONE for slug in slugs)


def joined(names: tuple[str, ...], word: str = "and") -> str:
    """``a, b and c``."""
    if len(names) < 2:
        return "".join(names)
    return f"{', '.join(names[:-1])} {word} {names[-1]}"


def open_question_sentence(mismatch: Mismatch) -> str:
    """A sentence that a test can decide what the recording left open, with the command that plans
    it; empty where nothing is left open."""
    question = mismatch.open_question
    if question is None or len(question.models) < 2:
        return ""
    if len(question.quick) < 2:
        return (
            f"No test of minutes tells {joined(rival_names(question.rivals))} apart: windows of "
            "weeks do."
        )
    quick = (model.slug for model in question.quick)
    return (
        f"A test of some minutes may tell {joined(rival_names(quick))} apart: "
        "`stemwatch plan-test` plans it."
    )


def effect_names(slugs: Iterable[str]) -> str:
    """Several slugs in one line."""
    return ", ".join(effect_name(slug) for slug in slugs)


def other_members(effect: Effect) -> tuple[str, ...]:
    """The members of its class beside the effect itself."""
    return tuple(slug for slug in effect.members if slug != effect.slug)


def left_out(mismatch: Mismatch) -> str:
    """The effects for a spreadsheet cell: slugs in order of work, members of a class joined by
    ``|``."""
    return ", ".join("|".join((effect.slug, *other_members(effect))) for effect in mismatch.effects)


def facet_title(facet: str) -> str:
    """The heading of a facet; one that is not known is its own heading."""
    return FACETS.get(facet, f"By {facet}")
