"""The limits of naming beside valves with nothing hidden, as `calibrate-mismatch` wrote them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from stemwatch.models.mismatch import acceptance_limits

FILE = Path(__file__).parents[3] / "docs" / "figures" / "mismatch-limits.json"
FIRST = 4


@pytest.fixture(scope="module")
def kept() -> dict:
    """The file that stands beside the docs."""
    return json.loads(FILE.read_text(encoding="utf-8"))


def test_the_file_has_the_limits_of_the_product(kept) -> None:
    """Whoever changes a limit draws the nulls again."""
    assert kept["limits"] == {
        "mean": acceptance_limits.MEAN,
        "t": acceptance_limits.T,
        "mean times t": acceptance_limits.PRODUCT,
        "later": acceptance_limits.LATER,
        "pair": acceptance_limits.LEAST_OF_A_PAIR,
        "null rate": acceptance_limits.NULL_RATE,
    }


def test_no_null_has_a_pair_near_the_limit_of_pairs(kept) -> None:
    """Of all kinds of records and both frictions, each with its count."""
    everything, *parts = kept["groups"]
    assert everything["of"] == kept["cases"] == len(kept["valves"])
    assert 2 * everything["of"] == sum(group["of"] for group in parts)
    assert everything["pairs"] == 0
    assert everything["pair"][-1] < kept["limits"]["pair"]


def test_the_page_has_the_counts_of_the_file(kept) -> None:
    """One row of the table for each kind."""
    page = (FILE.parents[1] / "method.md").read_text(encoding="utf-8")
    for group in kept["groups"]:
        tail = f"{group['strongest'][2]:.2f} | {group['pair'][-1]:.2f} |"
        row = f"| {group['kind']} | {group['of']} | {group['passing']} | {group['pairs']} | {tail}"
        assert row in page, row


@pytest.mark.long
def test_the_file_is_what_the_command_writes(stemwatch, tmp_path, kept) -> None:
    """The valves that are drawn first, term by term."""
    file = tmp_path / "nulls.json"
    options = ("--cases", FIRST, "--seed", kept["seed"], "--workers", 1, "--json", file)
    outcome = stemwatch("calibrate-mismatch", *options)
    assert outcome.status == 0, outcome.said
    written = json.loads(file.read_text(encoding="utf-8"))
    for slug, pairs in written["scores"].items():
        for found, stored in zip(pairs, kept["scores"][slug], strict=False):
            assert found == pytest.approx(stored, rel=1e-2, abs=5e-3), slug
    for found, stored in zip(written["valves"], kept["valves"], strict=False):
        assert found[:2] == stored[:2]
        assert found[2:] == pytest.approx(stored[2:], rel=1e-2, abs=5e-3)
