"""What stands above what was found beside S and J."""

from __future__ import annotations

from dataclasses import replace

from stemwatch.models.decision.verdicts import NEXT
from stemwatch.models.mismatch.findings import Finding
from stemwatch.models.verdict import Shape
from stemwatch.service.presenter.advice import advice_for, term_words
from stemwatch.service.presenter.finding import STEM_OF_A_DRIVE, present_effect, why_no_work
from stemwatch.service.presenter.physics_words import finding_title
from stemwatch.service.presenter.work_decision import STICTION
from tests.service.example_mismatches import named, of_every_kind, second_effect


def test_effects_without_rivals_are_named_beside_one_with_rivals() -> None:
    """Of them the recording leaves nothing open, and their sentences say so."""
    mismatch = named()
    assert [len(effect.members) for effect in mismatch.effects] == [1, 2]
    mixed = replace(mismatch, finding=Finding.CANDIDATES)
    alone = replace(mixed, effects=(second_effect(),))
    assert finding_title(mixed) == "named, with candidates that this recording cannot tell apart"
    assert finding_title(alone) == "candidates that this recording cannot tell apart"


def test_the_title_of_what_is_not_known_claims_no_difference() -> None:
    """The sentence below may say that it cannot be told whether anything is left out."""
    unknown = next(one for one in of_every_kind() if one.finding is Finding.UNKNOWN)
    assert finding_title(unknown) == "nothing that can be named"


def test_of_a_drive_it_is_said_what_the_stem_is() -> None:
    """The pages of a servo speak of a stem that it has not got; a valve's need no such word."""
    drive = replace(named().effects[0], slug="motor_drive", inherent=True)
    assert "belongs to such a machine" in why_no_work([drive])
    assert STEM_OF_A_DRIVE in why_no_work([drive])
    assert STEM_OF_A_DRIVE not in why_no_work([replace(drive, slug="slip_overshoot")])


def test_what_is_named_of_drives_alone_knows_no_stem() -> None:
    """A servo has a shaft, an actuator a stem: what is said of either calls it the moving part."""
    for slug in ("motor_drive", "load_by_position"):
        words = term_words(slug)
        assert words is not None
        assert "stem" not in f"{words.plain} {words.decide} {words.advice.title} {words.check}"


def test_what_needs_no_work_is_not_said_to_pass_a_test_that_it_does_not() -> None:
    """A zero of 0.8 % does not read within 0.4 %; it is only too small to need work."""
    (effect,) = named().effects[:1]
    card = present_effect(replace(effect, inherent=True))
    assert card.test is not None
    assert card.passes.endswith("; what was found here needs no work either")


def test_a_jump_past_the_command_is_not_said_to_be_no_friction() -> None:
    """Beside it slip overshoot may be named, which belongs to a stem that little damps."""
    said = (NEXT[Shape.OVERSHOOT], *advice_for(STICTION[Shape.OVERSHOOT]).otherwise)
    assert all("only where little damps the stem" in sentence for sentence in said)
