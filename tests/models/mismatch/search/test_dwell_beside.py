"""Dwell beside another effect: told by breakaways and likelihood together, and by neither alone."""

from __future__ import annotations

import numpy as np
import pytest

from stemwatch.models.mismatch.explain import explain
from stemwatch.models.mismatch.fit.batched_search import conclude
from stemwatch.models.mismatch.fit.crossfit import scored
from stemwatch.models.mismatch.search.breakaway_levels import DWELL, breakaway_evidence
from stemwatch.models.studies.simulator.hidden import draw_hidden
from tests.models.mismatch.fitted_chain import (
    candidate,
    evaluator_of,
    hypothesis,
    simulated_by_chain,
)


def hidden(place, seed):
    """A valve of the plant, and what is said of it."""
    case = draw_hidden(400, seed)[place]
    run = case.simulated()
    return case, run, explain(run.recording)


@pytest.mark.long
def test_dwell_beside_a_positioner_that_overshoots() -> None:
    """Both are named, and S is that of a stem that has not rested."""
    case, run, mismatch = hidden(37, 4061)
    assert set(case.hidden) == {DWELL, "underdamped_positioner"}
    assert {effect.slug for effect in mismatch.effects} == set(case.hidden)
    S = mismatch.restated.S
    assert abs(S.value - run.truth.S) < abs(mismatch.naive.S.value - run.truth.S)


@pytest.mark.long
def test_breakaways_alone_do_not_name_it() -> None:
    """Thirteen of them show dwell by 3.5 standard errors where only one speed is limited; the
    record as a whole does not."""
    case, _, mismatch = hidden(225, 2114)
    assert case.hidden == ("asymmetric_rate_limit",)
    assert [effect.slug for effect in mismatch.effects] == ["asymmetric_rate_limit"]


@pytest.mark.parametrize(
    ("slug", "values"),
    [("growing_stiction", [0.8]), ("flow_force", [6.0]), ("sensor_drift", [4.0, 0.0, 0.0, 0.0])],
)
def test_what_is_fitted_beside_moves_no_levels(slug, values) -> None:
    """Growth, forces over place and drifts are taken into account: the rise has about its size."""
    recording = simulated_by_chain(samples=7200, dwell_dependent_breakaway=[0.4], **{slug: values})
    evaluator = evaluator_of(recording)
    layout = evaluator.layout(hypothesis(slug))
    row = candidate(layout, 4.4, 1.6)
    row[layout.places[slug]] = values
    fitted = conclude(evaluator, scored(layout, np.vstack((row, row))))
    seen = next(item for item in breakaway_evidence(evaluator, fitted) if item.slug == DWELL)
    assert seen.convincing
    assert 0.2 < seen.size < 0.6
