"""What to check, in which order, with which parts and behind which isolation.

A term of physics brings its advice with its other words; stiction, signals that cannot be trusted
and all other kinds of finding have theirs in ``advice.toml``. It is advice by kind of finding: it
knows neither the plant nor its rules, and says so.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING

from stemwatch.models.field_advice import (
    CheckStep,
    FieldAdvice,
    FieldTest,
    IsolationLevel,
    check_steps,
)

if TYPE_CHECKING:
    from stemwatch.models.mismatch.findings import Effect
    from stemwatch.models.mismatch.term import Words

MOST_STEPS = 9  # steps; a page holds no more, and nobody reads more at the valve
LEVEL_NAME = {
    IsolationLevel.DESK: "desk",
    IsolationLevel.LOOK: "at the valve, in service",
    IsolationLevel.MANUAL: "loop in manual",
    IsolationLevel.AIR: "air off",
    IsolationLevel.LINE: "line isolated",
}
HINT = (
    "Hints by kind of finding, not a work permit: the permit, lock-out and line-breaking rules of "
    "the site and the instructions of the makers decide."
)
ISOLATION = {
    IsolationLevel.DESK: "No isolation: this is work at the desk.",
    IsolationLevel.LOOK: (
        "Valve in service: it may move at any time and without warning. Keep hands and tools out "
        "of yoke, stem and linkage."
    ),
    IsolationLevel.MANUAL: (
        "Loop in manual, agreed with the control room; think of cascades, interlocks and what a "
        "move of 5 % does to the process; where it allows none, have somebody at the bypass."
    ),
    IsolationLevel.AIR: (
        "Air shut and vented, locked and tagged: the valve goes to its fail position, so agree on "
        "bypass or safe state first. Volume tanks, boosters and lock-up valves keep pressure. The "
        "actuator's spring holds energy: release it as the maker says before anything is opened, "
        "and never hang on the coupling to hold the plug."
    ),
    IsolationLevel.LINE: (
        "Pressure boundary: bypass open, block valves before and after the valve shut, locked and "
        "tagged; depressurise, drain, flush, and prove it at vent and bonnet. Medium may be "
        "trapped between the block valves, in the bonnet and behind the packing; mind heat and "
        "hazardous medium. Gland nuts only when no pressure is left; leak test before it goes back."
    ),
}


@cache
def catalogue() -> Mapping[str, FieldAdvice]:
    """The advice for every kind of finding, by its name."""
    from stemwatch.models.mismatch.terms import catalogue as terms  # its kernels load slowly

    text = files("stemwatch.service.presenter").joinpath("advice.toml").read_text("utf-8")
    kinds = {kind: _advice(table) for kind, table in tomllib.loads(text).items()}
    return kinds | {slug: term.words.advice for slug, term in terms().items()}


def advice_for(kind: str) -> FieldAdvice:
    """The advice for ``kind``; the advice for an unknown effect where a newer version named
    ``kind``."""
    terms = catalogue()
    return terms.get(kind, terms["unknown"])


def term_words(slug: str) -> Words | None:
    """The words of a term of physics; ``None`` where this version does not know it."""
    from stemwatch.models.mismatch.terms import catalogue as terms

    term = terms().get(slug)
    return None if term is None else term.words


def effect_test(effect: Effect) -> FieldTest | None:
    """The manual test that shows ``effect``, with the response that its own parameters predict;
    ``None`` where this version does not know the effect or its parameters."""
    from stemwatch.models.mismatch.terms import catalogue as terms

    term = terms().get(effect.slug)
    try:
        return None if term is None else term.field_test(effect.parameters)
    except KeyError:
        return None


def steps_for(kinds: Iterable[str]) -> tuple[CheckStep, ...]:
    """The steps of several kinds together, none twice, ``MOST_STEPS`` at most.

    The first step of the first kind leads, then the cheapest. All steps of the first kind are
    included; those of the other kinds fill the remaining places in turn.
    """
    first, *queues = ([*advice_for(kind).steps] for kind in kinds)
    lead = first[0]
    steps = first
    while any(queues) and len(steps) < MOST_STEPS:
        for queue in queues:
            step = queue.pop(0) if queue else None
            if step is not None and step not in steps and len(steps) < MOST_STEPS:
                steps.append(step)
    return tuple(sorted(steps, key=lambda step: (step is not lead, step.level)))


def first_step(kind: str) -> str:
    """What to do first about ``kind``: the step that leads its work order."""
    return advice_for(kind).steps[0].text


def after_first_step(kind: str) -> str:
    """The steps after the first, as one paragraph."""
    return " ".join(step.text for step in advice_for(kind).steps[1:])


def parts_for(kinds: Iterable[str]) -> tuple[str, ...]:
    """The parts to have at hand for several kinds, each once; "none" only where no kind needs
    any."""
    kinds = tuple(kinds)
    return parts_needed(kinds) or advice_for(kinds[0]).parts[:1]


def parts_needed(kinds: Iterable[str]) -> tuple[str, ...]:
    """Those parts; empty where no kind needs any."""
    parts = dict.fromkeys(part for kind in kinds for part in advice_for(kind).parts)
    return tuple(part for part in parts if not part.startswith("none"))


def isolation_for(steps: Iterable[CheckStep]) -> tuple[tuple[IsolationLevel, str], ...]:
    """The isolation for each level that ``steps`` reach, the cheapest first; that of desk work only
    where there is no other."""
    levels = sorted({step.level for step in steps})
    away_from_desk = [level for level in levels if level > IsolationLevel.DESK]
    return tuple((level, ISOLATION[level]) for level in away_from_desk or levels)


def _advice(table: Mapping[str, object]) -> FieldAdvice:
    steps, parts, otherwise = table["steps"], table["parts"], table.get("otherwise", [])
    assert isinstance(steps, list)
    assert isinstance(parts, list)
    assert isinstance(otherwise, list)
    return FieldAdvice(
        title=str(table["title"]),
        parts=tuple(map(str, parts)),
        damage=str(table["damage"]),
        cause=str(table["cause"]),
        part=str(table["object"]),
        steps=check_steps(*map(str, steps)),
        otherwise=tuple(map(str, otherwise)),
    )
