"""A test by hand names a step that can move this valve, and what to expect."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from stemwatch.models.estimate import Estimate
from stemwatch.models.mismatch.terms import catalogue
from stemwatch.models.screening_result import Screening
from stemwatch.models.stickslip.kernel import START, simulate
from stemwatch.models.verdict import Verdict
from stemwatch.service.presenter.finding import field_test, present
from stemwatch.service.presenter.physics_words import (
    PARAMETERS,
    no_limit,
    parameter_name,
    record_parameter,
)
from tests.service.report.conftest import screening


def of(S: float, J: float, verdict: Verdict = Verdict.STICKY) -> Screening:
    """A valve with these numbers, known to a tenth of S."""
    return replace(
        screening("FIC-1", verdict, samples=60),
        S=Estimate(value=S, low=0.9 * S, high=1.1 * S, unit="%"),
        J=Estimate(value=J, low=0.9 * J, high=1.1 * J, unit="%"),
    )


@pytest.mark.parametrize(
    ("S", "J", "step", "expected", "moves"),
    [
        (5.0, 2.5, 1.0, "5 (5 to 6)", "a jump of 2.5 to 3.5 % of OP"),
        (4.4, 4.4, 1.0, "5 (4 to 5)", "a jump of 4.4 to 5.4 % of OP"),
        (6.2, 0.0, 1.0, "7 (6 to 7)", "a move of no more than one step"),
        (3.3, 5.0, 1.0, "4 (3 to 4)", "a jump of 5.0 to 6.0 % of OP"),
        (2.0, 2.0, 0.5, "4 (4 to 5)", "a jump of 2.0 to 2.5 % of OP"),
        (1.7, 0.3, 0.5, "4", "a jump of 0.3 to 0.8 % of OP"),
        (1.0, 0.0, 0.2, "5 (5 to 6)", "a move of no more than one step"),
    ],
)
def test_steps_are_counted_from_the_valves_own_numbers(
    S: float, J: float, step: float, expected: str, moves: str
) -> None:
    """As many steps back as add up to S, by the interval of S; then J and what they are more."""
    sentence = field_test(of(S, J))
    assert f"step OP by {step:g} % in one direction" in sentence
    assert f"Expect about {expected} steps back until it moves, then {moves}." in sentence
    assert sentence in present(of(S, J), stands=None).next_step


@pytest.mark.parametrize("J", [0.0, 0.4, 2.0, 5.0])
@pytest.mark.parametrize("S", [0.7, 1.3, 1.7, 2.6, 3.3, 4.4, 6.2, 9.1])
def test_the_stick_slip_element_moves_at_the_step_that_is_told(S: float, J: float) -> None:
    """The element that S and J belong to, stepped as the test says."""
    sentence = field_test(of(S, J))
    match = re.search(r"step OP by ([\d.]+) % .* Expect about (\d+)", sentence)
    assert match is not None
    step = float(match[1])
    counts, moved = steps_back(S, J, step)
    assert counts == int(match[2])
    if "a jump of" in sentence:
        assert J - 0.01 <= moved <= J + step + 0.01
    else:
        assert moved <= step + step / 2


def steps_back(S: float, J: float, step: float) -> tuple[int, float]:
    """Steps one way until the element moves, then back: after how many it moves, and how far."""
    levels, out = [50.0], [50.0]
    while out[-1] == out[0]:
        levels.append(levels[-1] + step)
        out = stepped(levels, S, J)
    rests, back = out[-1], 0
    while out[-1] == rests:
        back += 1
        levels.append(levels[-1] - step)
        out = stepped(levels, S, J)
    return back, rests - out[-1]


def stepped(levels: list[float], S: float, J: float) -> list[float]:
    """Where the element stands after each of ``levels``, percent, held for ten samples."""
    op = np.repeat(levels, 10)
    parameters = np.array([S, J, 0.0, 0.0, 0.0, np.inf, np.inf, 0.0, 1.0, 0.0])
    start, out = np.zeros(op.size, np.uint8), np.empty(op.size)
    start[0] = START
    simulate(op, np.full(op.size, 50.0), start, 1.0, parameters, out)
    return [float(x) for x in np.round(out[9::10], 9)]


def test_nothing_is_tested_where_there_is_nothing_to_confirm() -> None:
    """A healthy valve, and one whose S no hand can count."""
    assert field_test(of(0.3, 0.0, Verdict.HEALTHY)) == ""
    assert field_test(of(0.4, 0.0, Verdict.WATCH)) == ""
    unknown = replace(of(5.0, 1.0), S=Estimate.unknown("why", unit="%"))
    assert field_test(unknown) == ""


@pytest.mark.parametrize("slug", sorted(catalogue()))
def test_every_number_of_an_effect_has_words(slug: str) -> None:
    """A page says "dead time", not "theta"."""
    from stemwatch.models.mismatch.term import RecordingSummary

    term = catalogue()[slug]
    summary = RecordingSummary(
        interval_s=1.0, duration_s=3600.0, op_low=30.0, op_high=60.0, mv_low=30.0, mv_high=60.0,
        unit_s=1.0, sigma=0.05, S=1.0, J=0.5,
    )  # fmt: skip
    names = term.parameters(np.asarray(term.starts(summary))[0])
    for name in names:
        assert name in PARAMETERS or f"{slug}.{name}" in PARAMETERS
        assert len(parameter_name(name, slug)) > 3


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        ("step_percent", 0.1, "step 0.10 %"),
        ("late_s", 2.5, "OP stored late by 2.5 s"),
        ("frozen_share", 0.82, "frozen share 82 %"),
        ("stretches", 3.0, "stretches 3"),
    ],
)
def test_what_the_recorder_did_has_a_unit(name: str, value: float, text: str) -> None:
    """No bare number stands behind a name."""
    assert record_parameter(name, value) == text


def test_a_stem_that_is_free_has_no_top_speed() -> None:
    """The bound that stands for none is neither a number of the effect nor of its field test."""
    free, slow = (Estimate(value=v, low=0.9 * v, high=1.1 * v, unit="%/s") for v in (100.0, 0.5))
    assert (no_limit(free), no_limit(slow)) == (True, False)
    test = catalogue()["asymmetric_rate_limit"].field_test(
        {"rate_rising": free, "rate_falling": slow}
    )
    assert test.fails == "rising without such a limit and falling in about 40 s (36 to 44)"
