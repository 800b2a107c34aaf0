"""The whole record shows effects that no trajectory does, and names nothing where nothing is."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from stemwatch.models.mismatch.explain import explain
from stemwatch.models.mismatch.findings import Finding
from stemwatch.models.mismatch.likelihood import RecordLikelihood
from stemwatch.models.studies.simulator.hidden import draw_effect, draw_nulls, simulate_hidden
from tests.models.mismatch.fitted_chain import (
    candidate,
    evaluator_of,
    hypothesis,
    simulated_by_chain,
)


@cache
def explained(slug, concealment, place, seed):
    """The recording of a valve of the plant with a hidden effect, and what is said of it."""
    drawn = draw_effect(slug, place + 1, seed, concealment) if slug else None
    case = drawn[place] if drawn else draw_nulls(place + 1, seed, concealment)[place]
    _, run = simulate_hidden(case)
    return run, explain(run.recording)


def test_a_climb_ends_at_what_is_true() -> None:
    """S, J and noise from a start that is off."""
    recording = simulated_by_chain(S=5.0, J=1.5)
    evaluator = evaluator_of(recording)
    likelihood, layout = RecordLikelihood(evaluator), evaluator.layout(hypothesis())
    start = np.append(candidate(layout, 4.4, 1.2), likelihood.first_of_record)
    found = likelihood.maximised(layout, [start])
    S, J = found.candidate[0], found.candidate[0] * found.candidate[1]
    assert pytest.approx(5.0, abs=0.15) == S
    assert pytest.approx(1.5, abs=0.15) == J
    assert np.exp(found.of_record[0]) == pytest.approx(0.05, rel=0.5)


def test_a_richer_hypothesis_at_its_neutral_values_is_as_likely() -> None:
    """What a term gains is its own."""
    recording = simulated_by_chain()
    evaluator = evaluator_of(recording)
    likelihood = RecordLikelihood(evaluator)
    simple, rich = evaluator.layout(hypothesis()), evaluator.layout(hypothesis("lost_motion"))
    alone = likelihood.at(simple, np.append(candidate(simple), likelihood.first_of_record))
    beside = likelihood.at(rich, np.append(candidate(rich), likelihood.first_of_record))
    assert beside.total == pytest.approx(alone.total, abs=1e-9)
