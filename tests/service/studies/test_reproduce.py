"""``stemwatch reproduce paper``: what it prints and what it writes."""

from __future__ import annotations

import json
from typing import Any

import pytest
import typer
from typer.testing import CliRunner

from stemwatch.models.studies.reproduction.cases import CASES
from stemwatch.models.studies.reproduction.study import OURS, CaseResult, StudyTask, study, targets
from stemwatch.service.cli.reproduce import as_json, reproduce, show

pytestmark = pytest.mark.long  # a study: it simulates, fits and trains from the beginning


@pytest.fixture(scope="module")
def result() -> CaseResult:
    """The deadband case, one seed, two inputs of each kind."""
    return study(StudyTask(case=CASES[0], seeds=1, unseen_each=2))


@pytest.fixture(scope="module")
def written(result: CaseResult) -> dict[str, Any]:
    """The JSON as a reader gets it back."""
    return dict(json.loads(json.dumps(as_json([result], 1), allow_nan=False)))


def test_the_json_states_what_the_paper_leaves_open(written: dict[str, Any]) -> None:
    """Amplitude, sampling, S, J and layer sizes stand beside the results."""
    assert (written["amplitude"], written["samples_per_period"]) == (1.0, 150)
    assert written["layer_sizes"] == [10, 10, 1]
    (case,) = written["cases"]
    assert (case["case"]["shape"], case["case"]["S"], case["case"]["J"]) == ("deadband", 0.5, 0.0)


def test_the_json_holds_every_network_with_the_papers_figures(written: dict[str, Any]) -> None:
    """Six networks, the first two with what the paper published of them."""
    results = written["cases"][0]["results"]
    assert [item["network"] for item in results] == [
        "paper, feedforward",
        "paper, NARX",
        "ours, fitted start",
        "ours, fitted start, untrained",
        "ours, fitted start, sine only",
        "ours, random start",
    ]
    published = [item["published"] and item["published"]["rmse"] for item in results]
    assert published == [0.2336, 0.0869, None, None, None, None]
    assert {item["inputs"] for network in results for item in network["unseen"]} == {2}


def test_each_target_says_what_was_found_and_whether_it_is_met(result: CaseResult) -> None:
    """The sine and, for four kinds of input, the median and four in five; numbers from ours."""
    own = next(item for item in result.results if item.network == OURS)
    answer = targets(result)
    assert len(answer) == 9
    assert answer[0].found == own.rmse[own.chosen]
    assert [target.found for target in answer[1::2]] == [item.median for item in own.unseen]
    assert [target.met for target in answer] == [target.found <= target.limit for target in answer]


def test_the_table_names_case_networks_and_targets(
    result: CaseResult, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is printed has the paper's figures, the settings and the count of targets."""
    monkeypatch.setenv("COLUMNS", "160")
    show([result], 1)
    text = capsys.readouterr().out
    for expected in ("S 0.5, J 0", "0.2336", "0.0869", "random walks", "of 9 met", "grey-box"):
        assert expected in text


def test_a_missed_target_is_said_plainly(
    result: CaseResult, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """With a limit no network can reach, each miss is a line with both numbers."""
    monkeypatch.setattr("stemwatch.models.studies.reproduction.study.SINE_RMSE", -1.0)
    show([result], 1)
    text = " ".join(capsys.readouterr().out.split())
    assert "8 of 9 met" in text
    assert "Missed: deadband, the paper's sine:" in text


def test_an_unknown_study_is_refused_with_the_known_one() -> None:
    """``reproduce nothing`` ends with 2 and names ``paper``."""
    app = typer.Typer()
    app.command()(reproduce)
    done = CliRunner().invoke(app, ["nothing"])
    assert done.exit_code == 2
    assert "'paper'" in done.output
