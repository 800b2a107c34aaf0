"""Cases on their way to the judge: drawn, simulated, written under names that mean nothing."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stemwatch.connectors.historian import HistorianFile, propose_valves
from stemwatch.models.recording import Role
from stemwatch.models.studies.simulator.hidden import CONCEALMENTS, EFFECTS, simulate_hidden
from stemwatch.service.executors import InProcess
from stemwatch.service.studies.proof.answers import JudgeFailed, judge
from stemwatch.service.studies.proof.draw import draw_cases, file_names, write_cases

SEED = 5


@pytest.fixture(scope="module")
def drawn():
    """Three short cases: a null and two effects."""
    return [
        *draw_cases(1, SEED, "none", "short"),
        *draw_cases(1, SEED, "dead_time", "short"),
        *draw_cases(1, SEED, "quantisation", "short"),
    ]


@pytest.fixture(scope="module")
def written(drawn, tmp_path_factory):
    """Their CSV files, and the sealed truth."""
    folder = tmp_path_factory.mktemp("cases")
    return folder, write_cases(drawn, SEED, folder, InProcess(), lambda _: None)


def test_the_folder_holds_csv_files_and_nothing_else(written) -> None:
    """What the judge is given is one file a case, none of them with the truth."""
    folder, sealed = written
    files = sorted(path.name for path in folder.iterdir())
    assert ["FIC-0001.csv", "FIC-0002.csv", "FIC-0003.csv"] == files
    assert files == [item.file for item in sealed.open()]


def test_a_file_tells_nothing_but_its_samples(written) -> None:
    """Header, units and rows: no word of an effect, a concealment or a seed."""
    folder, _ = written
    for path in folder.iterdir():
        head, units, *rows = path.read_text("utf-8").splitlines()
        tags = ",".join(f"{path.stem}.{word}" for word in ("OP", "ZT", "PV", "SP"))
        assert f"Time,{tags}" == head
        assert ",%,%,%,%" == units
        assert all(re.fullmatch(r"[-+:0-9 ]+(,-?[0-9]+\.[0-9]{4}){4}", row) for row in rows)


@given(count=st.integers(1, 300), seed=st.integers(0, 2**31))
def test_the_numbers_of_the_files_are_shuffled(count: int, seed: int) -> None:
    """Each number once; in a long row hardly a case keeps the place it was drawn at."""
    names = file_names(count, seed)
    in_order = [f"FIC-{number:04d}.csv" for number in range(1, count + 1)]
    assert in_order == sorted(names)
    total = sum(ours == theirs for ours, theirs in zip(names, in_order, strict=True))
    assert count < 20 or total < count / 2


def test_the_reader_finds_the_recording_that_was_simulated(written, drawn) -> None:
    """Roles are proposed without help, and values come back to four decimals."""
    folder, sealed = written
    (truth,) = [item for item in sealed.open() if item.effects == ("dead_time",)]
    source = HistorianFile(folder / truth.file)
    (tags,) = propose_valves(source)
    recording = source.read(tags)
    simulated = drawn[1].simulated()
    assert 1.0 == recording.interval_s
    for role in (Role.OP, Role.MV, Role.PV, Role.SP):
        ours, theirs = recording.get(role), simulated.recording.get(role)
        np.testing.assert_allclose(ours.values, theirs.values, atol=5.1e-5)


def test_the_truth_is_what_the_plant_has(written, drawn) -> None:
    """S, J, effects and whether the record shows them come from the simulation."""
    _, sealed = written
    by_effect = {item.effects: item for item in sealed.open()}
    case, simulated = simulate_hidden(drawn[1])
    result = by_effect["dead_time",]
    assert (simulated.truth.S, simulated.truth.J) == (result.S, result.J)
    assert (case.excited, case.excitation) == (result.excited, dict(result.excitation))
    assert () == by_effect[()].physics
    assert "quantisation" in by_effect["quantisation",].record_effects


@pytest.mark.parametrize(
    ("effect", "concealment", "effects", "concealments"),
    [
        ("travel_stop", "", {("travel_stop",)}, {"routine"}),
        ("travel_stop", "quiet", {("travel_stop",)}, {"quiet"}),
        ("none", "noisy", {()}, {"noisy"}),
        ("unknown", "", {("unknown",)}, {"routine"}),
        ("vibration", "", {("unknown",)}, {"routine"}),
    ],
)
def test_a_part_of_the_population(effect, concealment, effects, concealments) -> None:
    """One effect, nothing, or what is outside the catalogue, under the concealment asked for."""
    cases = draw_cases(4, SEED, effect, concealment)
    assert effects == {case.effects for case in cases}
    assert concealments == {case.concealment for case in cases}


@pytest.mark.parametrize("concealment", ["rich", "positioner"])
def test_one_concealment_has_nulls_unknowns_and_every_effect(concealment) -> None:
    """A part by concealment is a trial in itself."""
    cases = draw_cases(40, SEED, "", concealment)
    assert 40 == len(cases)
    assert {concealment} == {case.concealment for case in cases}
    assert set(EFFECTS) <= {slug for case in cases for slug in case.effects}
    assert 8 == sum(case.effects == () for case in cases)
    assert 4 == sum(case.effects == ("unknown",) for case in cases)


@pytest.mark.parametrize(
    ("effect", "concealment", "words"),
    [("stickyness", "", "actuator_lag"), ("", "hidden", CONCEALMENTS[0])],
)
def test_a_word_that_is_never_drawn_is_refused_with_those_that_are(
    effect, concealment, words
) -> None:
    """The message names what there is."""
    with pytest.raises(ValueError, match=words):
        draw_cases(3, SEED, effect, concealment)


def test_a_judge_without_an_answer_is_an_error_and_no_miss(written) -> None:
    """A process that ends with wrong usage stops the trial, with its last words."""
    folder, _ = written
    with pytest.raises(JudgeFailed, match=r"(?s)FIC-0001\.csv .* exit status 2.*--no-such-option"):
        judge(folder, ["FIC-0001.csv"], InProcess(), lambda _: None, ["--no-such-option"])
