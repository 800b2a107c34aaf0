"""The advice: whole, in order, and short enough for where it is printed."""

from __future__ import annotations

import pkgutil
import re

import pytest

from stemwatch.models.field_advice import IsolationLevel, check_steps
from stemwatch.models.mismatch import terms
from stemwatch.service.presenter import work_decision as k
from stemwatch.service.presenter.advice import (
    ISOLATION,
    MOST_STEPS,
    advice_for,
    catalogue,
    first_step,
    isolation_for,
    parts_for,
    steps_for,
)

EFFECTS = [
    iter_module.name
    for iter_module in pkgutil.iter_modules(terms.__path__)
    if iter_module.name[0] != "_"
]
OWN = [
    *k.STICTION.values(),
    *[k.HEALTHY, k.RECORDING, k.WATCH, k.DEPARTED, k.UNKNOWN, k.UNEXPLAINED],
    *sorted(k.SIGNAL),
]


def test_every_kind_of_finding_has_advice_and_no_other_has():
    """All effects, four shapes of stiction, and every way in which a position fails."""
    assert len(EFFECTS) == 26
    assert set(catalogue()) == {*EFFECTS, *OWN}


@pytest.mark.parametrize("kind", [*EFFECTS, *OWN])
def test_advice_is_whole(kind):
    """A title that fits a short text, parts, codes, and steps from the cheapest to the dearest."""
    advice = advice_for(kind)
    assert 5 <= len(advice.title) <= 30
    assert advice.parts
    assert advice.part
    assert re.fullmatch("[A-Z]{3}", advice.damage)
    assert re.fullmatch(r"\d\.\d", advice.cause)
    levels = [step.level for step in advice.steps]
    assert levels == sorted(levels)
    assert all(step.text[0].isupper() and step.text.endswith((".", "?")) for step in advice.steps)


@pytest.mark.parametrize("slug", EFFECTS)
def test_a_term_has_all_its_words_in_one_place(slug):
    """What it is, what to check, the test that tells; page, PDF, mail and order read these."""
    words = terms.catalogue()[slug].words
    assert advice_for(slug) is words.advice
    assert words.plain
    assert words.plain[0].islower()
    assert words.decide.endswith(".")
    assert words.check == " ".join(step.text for step in words.advice.steps)


def test_a_step_without_a_level_is_refused_with_the_levels_there_are():
    """Whoever adds a term reads what a step begins with."""
    with pytest.raises(ValueError, match=r"begins with how far one must go \(desk, look, manual"):
        check_steps("Look at the stem.")


def test_an_effect_of_a_newer_version_gets_the_advice_for_the_unknown():
    """A database may be ahead of the program."""
    assert advice_for("of_next_year") is advice_for(k.UNKNOWN)


def test_steps_of_several_kinds_keep_all_of_the_first():
    """The others fill the room that is left; what both ask for stands there once."""
    both = steps_for(["stiction_undershoot", "lost_motion"])
    assert set(advice_for("stiction_undershoot").steps) <= set(both)
    assert len(both) == MOST_STEPS
    assert [step.level for step in both] == sorted(step.level for step in both)
    assert steps_for(["stiction_deadband", "dead_time"])[0].text == first_step("stiction_deadband")
    assert steps_for(["lost_motion", "lost_motion"]) == advice_for("lost_motion").steps


def test_isolation_covers_exactly_the_levels_that_the_steps_reach():
    """No line is broken for a look, and no step goes further than what is said of it."""
    steps = steps_for(["stiction_undershoot"])
    levels = [level for level, _ in isolation_for(steps)]
    assert levels == [IsolationLevel.LOOK, IsolationLevel.MANUAL, IsolationLevel.LINE]
    assert isolation_for(steps_for([k.RECORDING])) == (
        (IsolationLevel.DESK, ISOLATION[IsolationLevel.DESK]),
    )


def test_the_line_is_isolated_only_with_the_energies_named():
    """Bypass, block valves, air and spring, trapped medium, hazards."""
    text = ISOLATION[IsolationLevel.LINE] + ISOLATION[IsolationLevel.AIR]
    for word in ("bypass", "block valves", "spring", "trapped", "hazardous", "locked", "vent"):
        assert word in text


def test_no_parts_are_said_only_where_none_are_needed():
    """Beside a packing set, "none" would be nonsense."""
    assert (
        parts_for(["zero_shift", "stiction_undershoot"])[0]
        == "actuator spring, where the bench set cannot be reached"
    )
    assert parts_for([k.WRONG]) == ("none",)


def test_a_step_that_looks_for_an_overshoot_lets_the_stem_go() -> None:
    """Only a step larger than S moves a stem that sticks; J above S begins at an S of 1.5 %."""
    (look,) = (step for step in advice_for("stiction_overshoot").steps if "overshoot" in step.text)
    assert "more than S" in look.text
