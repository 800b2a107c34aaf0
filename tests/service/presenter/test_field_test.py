"""A test by hand names a step that can move this valve, and what to expect."""

from __future__ import annotations

from dataclasses import replace

import pytest

from stemwatch.models.estimate import Estimate
from stemwatch.models.mismatch.terms import catalogue
from stemwatch.models.screening_result import Screening
from stemwatch.models.verdict import Verdict
from stemwatch.service.presenter.finding import field_test, present
from stemwatch.service.presenter.physics_words import PARAMETERS, parameter_name
from tests.service.report.conftest import screening

GREEK = ("theta", "zeta", "sigma", "omega", "alpha", "beta", "gamma", "delta", "kappa", "lambda")


def of(S: float, J: float, verdict: Verdict = Verdict.STICKY) -> Screening:
    """A valve with these numbers, known to a tenth of S."""
    return replace(
        screening("FIC-1", verdict, samples=60),
        S=Estimate(value=S, low=0.9 * S, high=1.1 * S, unit="%"),
        J=Estimate(value=J, low=0.9 * J, high=1.1 * J, unit="%"),
    )


@pytest.mark.parametrize(
    ("S", "J", "step", "expected", "jump"),
    [
        (5.0, 2.5, "1 %", "about 5 (4 to 6)", "a jump of about 2.50 %"),
        (6.2, 0.0, "1 %", "about 6 (6 to 7)", "no jump"),
        (2.0, 2.0, "0.5 %", "about 4", "a jump of about 2.00 %"),
        (1.0, 0.0, "0.2 %", "about 5 (4 to 6)", "no jump"),
    ],
)
def test_steps_are_counted_from_the_valves_own_numbers(
    S: float, J: float, step: str, expected: str, jump: str
) -> None:
    """About S divided by the step, within the interval."""
    said = field_test(of(S, J))
    assert f"step OP by {step} one way" in said
    assert f"Expect {expected} before it moves back, with {jump}" in said
    assert said in present(of(S, J), stands=None).next_step


def test_nothing_is_tested_where_there_is_nothing_to_confirm() -> None:
    """A healthy valve, and one whose S no hand can count."""
    assert field_test(of(0.3, 0.0, Verdict.HEALTHY)) == ""
    assert field_test(of(0.4, 0.0, Verdict.WATCH)) == ""
    unknown = replace(of(5.0, 1.0), S=Estimate.unknown("why", unit="%"))
    assert field_test(unknown) == ""


@pytest.mark.parametrize("slug", sorted(catalogue()))
def test_every_number_of_an_effect_has_words(slug: str) -> None:
    """A page says "dead time", not "theta"."""
    import numpy as np

    from stemwatch.models.mismatch.term import Look

    term = catalogue()[slug]
    look = Look(
        interval_s=1.0, duration_s=3600.0, op_low=30.0, op_high=60.0, mv_low=30.0, mv_high=60.0,
        sigma=0.05, S=1.0, J=0.5,
    )  # fmt: skip
    names = term.parameters(np.asarray(term.starts(look))[0])
    for name in names:
        said = parameter_name(name, slug)
        letters = said not in GREEK and len(said) > 3
        assert name in PARAMETERS or f"{slug}.{name}" in PARAMETERS or letters, said
