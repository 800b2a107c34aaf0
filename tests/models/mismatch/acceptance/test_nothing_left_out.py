"""S and J do not pass for the whole truth where friction or force is not what they can follow."""

from __future__ import annotations

import pytest

from stemwatch.models.mismatch.explain import explain
from stemwatch.models.mismatch.findings import Finding, Mismatch
from stemwatch.models.studies.simulator.hidden import draw_hidden


def explained(seed: int, number: int) -> Mismatch:
    """A valve of the proof's draw, explained."""
    return explain(draw_hidden(number + 1, seed)[number].simulated().recording)


@pytest.mark.long
@pytest.mark.parametrize(
    "number",
    [
        8,  # a force that swings
        pytest.param(28, marks=pytest.mark.long),  # friction that comes and goes, behind noise
    ],
)
def test_breakaways_that_scatter_as_those_of_no_stem_are_not_explained(number: int) -> None:
    """Each run follows them, because it lets go where the stem is seen to."""
    mismatch = explained(2122, number)
    assert mismatch.finding is Finding.UNKNOWN
    assert "more than real stems scatter" in mismatch.sentence


def test_what_follows_the_turns_is_not_explained_either() -> None:
    """A spring with hysteresis in a quiet loop, of which no error of the reading is named, where
    its own term is not looked for."""
    case = draw_hidden(909, 4090)[908]
    recording = case.simulated().recording
    mismatch = explain(recording, refused={"spring_hysteresis": "it is not looked for here"})
    assert mismatch.finding is Finding.UNKNOWN
    assert "each turn of the stem" in mismatch.sentence


@pytest.mark.long
@pytest.mark.parametrize(
    "number",
    [
        28,  # a wave of friction makes drag more likely, and leaves most of itself over
        68,  # a spring in a quarter of an hour: a weak line, and runs leave no more than noise
    ],
)
def test_no_name_that_leaves_more_than_noise_or_scatter_of_a_stem(number: int) -> None:
    """The likelihood sees what runs do not."""
    mismatch = explained(4090, number)
    assert mismatch.finding is Finding.UNKNOWN
    assert mismatch.effects == ()


@pytest.mark.long
def test_drag_is_not_named_of_a_stem_that_is_shaken() -> None:
    """Behind an archive, where only the likelihood takes its slips for a slow slide."""
    mismatch = explained(4090, 1128)
    assert mismatch.finding is Finding.UNKNOWN
    assert "14.2 s" in mismatch.sentence
