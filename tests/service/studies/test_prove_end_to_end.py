"""``stemwatch prove`` and ``stemwatch calibrate-mismatch`` as a user runs them."""

from __future__ import annotations

import hashlib
import json
import re

import pytest

from stemwatch.service.executors import InProcess
from stemwatch.service.studies.proof.draw import draw_cases, write_cases

pytestmark = pytest.mark.long  # a study: it simulates, fits and trains from the beginning


@pytest.fixture(scope="module")
def proved(tmp_path_factory: pytest.TempPathFactory, stemwatch):
    """A trial of a null and four effects in short records, kept and with its JSON."""
    home = tmp_path_factory.mktemp("proof")
    file, folder = home / "proof.json", home / "kept"
    options = ("--seed", 31, "--cases", 5, "--concealment", "short", "--workers", 1)
    outcome = stemwatch("prove", *options, "--json", file, "--keep", folder)
    assert outcome.status == 0, outcome.said
    return outcome, json.loads(file.read_text("utf-8")), folder


def test_the_digest_is_printed_before_anything_else(proved) -> None:
    """The first line is the seal, and the kept truth has that digest."""
    outcome, result, folder = proved
    first = outcome.out.strip().splitlines()[0]
    digest = re.search(r"Truth of 5 cases sealed, SHA-256 ([0-9a-f]{64})", first)
    assert digest
    assert digest[1] == hashlib.sha256((folder / "truth.json").read_bytes()).hexdigest()
    assert digest[1] == result["digest"]


def test_the_tables_are_printed(proved) -> None:
    """Rates with targets, by effect, by concealment, and the check of the seal."""
    outcome, _, _ = proved
    for words in ("one effect, short", ">= 75%", "nothing hidden", "by concealment", "the digest"):
        assert words in outcome.said


def test_every_case_was_judged_from_its_file(proved) -> None:
    """One answer for each CSV file, and no case without a verdict."""
    _, result, folder = proved
    files = sorted(path.name for path in folder.glob("*.csv"))
    assert files == sorted(mark["said"]["file"] for mark in result["marks"])
    assert [] == [m for m in result["marks"] if m["said"]["verdict"] == "not_testable"]
    assert all(mark["said"]["seconds"] > 0.0 for mark in result["marks"])


def test_the_same_seed_gives_the_same_truth(proved, tmp_path) -> None:
    """The digest can be had again from the seed, by whoever doubts it."""
    _, result, _ = proved
    cases = draw_cases(5, 31, concealment="short")
    assert result["digest"] == write_cases(cases, 31, tmp_path, InProcess(), lambda _: None).digest


def test_a_kept_folder_must_be_empty(stemwatch, tmp_path) -> None:
    """The judge is to see the cases of this trial and nothing else."""
    (tmp_path / "old.csv").write_text("Time\n", encoding="utf-8")
    outcome = stemwatch("prove", "--cases", 1, "--keep", tmp_path)
    assert outcome.status == 2
    assert "is not empty" in outcome.said


def test_a_seed_of_the_calibration_is_said_not_to_be_blind(stemwatch) -> None:
    """Whoever takes a seed that thresholds rest on is told so."""
    options = ("--effect", "none", "--concealment", "short", "--workers", 1)
    outcome = stemwatch("prove", "--seed", 4000, "--cases", 1, *options)
    assert outcome.status == 0
    assert "this is not blind" in outcome.err


def test_a_word_that_is_never_drawn_ends_with_those_that_are(stemwatch) -> None:
    """Wrong usage is one sentence and status 2."""
    outcome = stemwatch("prove", "--cases", 1, "--effect", "stickyness")
    assert outcome.status == 2
    assert "actuator_lag" in outcome.said


def test_calibration_prints_limits_from_nulls(stemwatch, tmp_path) -> None:
    """Every term that can be tested has its quantiles, and there is one limit for all."""
    file = tmp_path / "nulls.json"
    outcome = stemwatch("calibrate-mismatch", "--cases", 4, "--workers", 1, "--json", file)
    assert outcome.status == 0, outcome.said
    loaded = json.loads(file.read_text("utf-8"))
    assert "One limit for all terms" in outcome.said
    assert {4} == {len(pairs) for pairs in loaded["scores"].values()}
    assert "actuator_lag" in loaded["scores"]
