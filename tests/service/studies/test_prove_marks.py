"""The rules by which a blind trial counts one case: hand-made truths and answers."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from stemwatch.service.studies.proof.answers import BlindAnswer, NamedEffect, read_answer
from stemwatch.service.studies.proof.marks import CaseOutcome, mark
from stemwatch.service.studies.proof.truth import CaseKind, CaseTruth

SLUGS = ("actuator_lag", "viscous_drag", "dead_time", "lost_motion", "zero_shift")


def truth(*effects: str, excited: bool = True) -> CaseTruth:
    """A case of an hour in which ``effects`` are hidden."""
    return CaseTruth(
        file="FIC-0001.csv",
        hidden=effects,
        effects=effects,
        record_effects=(),
        concealment="routine",
        excited=excited,
        S=5.0,
        J=2.0,
        scatter=0.05,
        samples=3600,
    )


def said(*names: str | tuple[str, ...], verdict: str = "named") -> BlindAnswer:
    """An answer; a tuple is a name with its class, the name first."""
    given = [(name,) if isinstance(name, str) else name for name in names]
    return BlindAnswer(
        file="FIC-0001.csv",
        verdict=verdict if names else ("none" if verdict == "named" else verdict),
        names=tuple(NamedEffect(slug=item[0], members=item) for item in given),
    )


@pytest.mark.parametrize(
    ("hidden", "answer", "outcome"),
    [
        (["dead_time"], said("dead_time"), CaseOutcome.EXACT),
        (["dead_time"], said(("actuator_lag", "dead_time")), CaseOutcome.CLASS),
        (["dead_time"], said("lost_motion"), CaseOutcome.WRONG),
        # The first name counts: a right one that stands second does not mend it.
        (["dead_time"], said("lost_motion", "dead_time"), CaseOutcome.WRONG),
        (["dead_time"], said(), CaseOutcome.MISS),
        (["dead_time"], said(verdict="unknown"), CaseOutcome.MISS),
        ([], said(), CaseOutcome.QUIET),
        ([], said(verdict="unknown"), CaseOutcome.QUIET),
        ([], said(("zero_shift", "flow_force"), verdict="candidates"), CaseOutcome.FALSE_ALARM),
        (["unknown"], said(verdict="unknown"), CaseOutcome.CAUGHT),
        (["unknown"], said(), CaseOutcome.MISS),
        (["unknown"], said("dead_time"), CaseOutcome.MISNAMED),
        (["dead_time", "lost_motion"], said("lost_motion", "dead_time"), CaseOutcome.BOTH),
        (["dead_time", "lost_motion"], said("dead_time"), CaseOutcome.ONE),
        (["dead_time", "lost_motion"], said("zero_shift", "dead_time"), CaseOutcome.ONE),
        (["dead_time", "lost_motion"], said("zero_shift"), CaseOutcome.WRONG),
        (["dead_time", "lost_motion"], said(), CaseOutcome.MISS),
        # One name cannot be both, however wide its class is.
        (["dead_time", "lost_motion"], said(("dead_time", "lost_motion")), CaseOutcome.ONE),
        # The first name fits either, the second one only the first truth.
        (
            ["dead_time", "lost_motion"],
            said(("dead_time", "lost_motion"), ("viscous_drag", "dead_time")),
            CaseOutcome.BOTH,
        ),
        # An effect of the record is no physics: beside it, a name of physics is a false alarm.
        (["frozen_signal"], said(), CaseOutcome.QUIET),
        (["frozen_signal"], said("lost_motion"), CaseOutcome.FALSE_ALARM),
        (["frozen_signal", "dead_time"], said("dead_time"), CaseOutcome.EXACT),
    ],
)
def test_each_rule_of_the_count(hidden, answer, outcome) -> None:
    """What was hidden and what was said decide the outcome, by the first name and its class."""
    assert outcome is mark(truth(*hidden), answer).outcome


def test_every_name_without_truth_is_a_wrong_name() -> None:
    """A further name that is wrong is kept, although the first one is right."""
    result = mark(truth("dead_time"), said("dead_time", "zero_shift", ("lost_motion", "dead_time")))
    assert CaseOutcome.EXACT is result.outcome
    assert ("zero_shift",) == result.wrong_names
    assert result.right_name is True


def test_nothing_named_is_neither_right_nor_wrong() -> None:
    """Silence takes no part in how often a name is right."""
    result = mark(truth("dead_time"), said())
    assert result.right_name is None
    assert not result.named


@given(
    hidden=st.lists(st.sampled_from(SLUGS), unique=True, max_size=2),
    names=st.lists(st.sampled_from(SLUGS), unique=True, max_size=3),
)
def test_naming_what_is_hidden_is_never_wrong(hidden, names) -> None:
    """Whatever else is said, the names that are hidden are not among the wrong ones."""
    result = mark(truth(*hidden), said(*names))
    assert set(result.wrong_names) == set(names) - set(hidden)
    if hidden and names == hidden:
        assert result.outcome in (CaseOutcome.EXACT, CaseOutcome.BOTH)


@pytest.mark.parametrize(
    ("effects", "kind", "label"),
    [
        ((), CaseKind.NULL, "nothing hidden"),
        (("quantisation",), CaseKind.NULL, "nothing hidden"),
        (("dead_time",), CaseKind.SINGLE, "dead_time"),
        (("lost_motion", "dead_time"), CaseKind.PAIR, "dead_time + lost_motion"),
        (("unknown",), CaseKind.UNKNOWN, "outside: unknown"),
    ],
)
def test_the_kind_of_a_case(effects, kind, label) -> None:
    """Physics makes the kind; effects of the record do not."""
    assert kind is truth(*effects).kind
    assert label == truth(*effects).label


def answer_object(**changes):
    """An object of the JSON of explain with one named effect."""
    numbers = {"value": 3.0, "low": 2.5, "high": 3.5, "reason": None}
    silent = {"value": None, "low": None, "high": None, "reason": "too few slips"}
    return {
        "version": 1,
        "recording": "somewhere/FIC-0007.csv",
        "verdict": "named",
        "effects": [{"slug": "dead_time", "class": ["dead_time", "actuator_lag"]}],
        "record_effects": [{"slug": "quantisation"}],
        "not_testable": [{"slug": "travel_stop", "reason": "never reached"}],
        "stiction": {"naive": {"S": numbers, "J": silent}, "restated": {"S": numbers, "J": silent}},
        "heldout": {"fit_naive": 40.0, "fit_extended": 80.0, "rmse_naive": 2.0},
        "seconds": 0.7,
    } | changes


def test_an_answer_is_read_by_its_contract() -> None:
    """Names, classes, numbers and withheld numbers arrive; the folder does not matter."""
    answer = read_answer(answer_object())
    assert ("FIC-0007.csv", "named") == (answer.file, answer.verdict)
    assert answer.names[0].holds("actuator_lag")
    assert (3.0, None) == (answer.naive.S, answer.naive.J)
    assert (80.0, None) == (answer.fit_extended, answer.rmse_extended)
    assert (("quantisation",), ("travel_stop",)) == (answer.record_effects, answer.not_testable)


def test_a_refusal_for_a_frozen_position_has_found_the_freeze() -> None:
    """A recording that is refused because its reading was frozen has found that effect."""
    reason = "Cannot tell: the position reading was frozen for 47 % of the time. Check it."
    silent = {"value": None, "low": None, "high": None, "reason": reason}
    refused = answer_object(
        verdict="not_testable",
        effects=[],
        record_effects=[],
        stiction={"naive": {"S": silent, "J": silent}, "restated": {"S": silent, "J": silent}},
    )
    assert ("frozen_signal",) == read_answer(refused).record_effects


def test_an_answer_that_breaks_the_contract_is_refused() -> None:
    """A missing field is named, and the recording that lacks it."""
    broken = answer_object()
    del broken["effects"]
    with pytest.raises(ValueError, match=r"lacks 'effects' for somewhere/FIC-0007\.csv"):
        read_answer(broken)


def test_a_recording_that_could_not_be_read_is_an_answer() -> None:
    """Nulls in place of objects are no crash: nothing was named."""
    answer = read_answer(
        answer_object(verdict="not_testable", effects=[], stiction=None, heldout=None)
    )
    assert () == answer.names
    assert answer.naive.S is None
