"""The sealed truth: one digest for the same truths, and no scoring of a changed one."""

from __future__ import annotations

import hashlib
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from stemwatch.service.studies.proof.answers import BlindAnswer
from stemwatch.service.studies.proof.rates import score
from stemwatch.service.studies.proof.truth import BrokenSeal, CaseTruth, Seal, seal


def case(number: int, **changes) -> CaseTruth:
    """A case with a dead time hidden in it."""
    return CaseTruth(
        **{
            "file": f"FIC-{number:04d}.csv",
            "hidden": ("dead_time",),
            "effects": ("dead_time",),
            "record_effects": ("quantisation",),
            "concealment": "quantised",
            "excited": True,
            "excitation": {"dead_time": 0.7},
            "S": 5.0 + 0.1 * number,
            "J": 2.0,
            "scatter": 0.05,
            "samples": 3600,
            "sizes": {"dead_time.delay_s": 1.0 / 3.0},
        }
        | changes
    )


def test_what_was_sealed_is_what_is_opened() -> None:
    """Every number comes back as it was, sorted by file."""
    truths = [case(2), case(1, effects=(), hidden=()), case(3)]
    assert sorted(truths, key=lambda truth: truth.file) == list(seal(truths).open())


def test_the_order_of_the_cases_does_not_change_the_digest() -> None:
    """Workers end in any order; the digest is of the truths."""
    assert seal([case(1), case(2)]).digest == seal([case(2), case(1)]).digest


def test_the_digest_is_that_of_the_kept_file() -> None:
    """Whoever keeps the truth can check it with sha256sum."""
    sealed = seal([case(1)])
    assert hashlib.sha256(sealed.text.encode()).hexdigest() == sealed.digest


@given(place=st.integers(0, 10_000), letter=st.sampled_from("0123456789ax "))
def test_a_tampered_truth_is_refused(place: int, letter: str) -> None:
    """Changing any one character after the sealing breaks the seal, and the message says so."""
    sealed = seal([case(1), case(2)])
    at = place % len(sealed.text)
    text = sealed.text[:at] + letter + sealed.text[at + 1 :]
    if text == sealed.text:
        return
    with pytest.raises(BrokenSeal, match="nothing was scored"):
        Seal(text=text, digest=sealed.digest).open()


def test_another_truth_has_another_digest() -> None:
    """The smallest change of a number shows."""
    item = case(1)
    assert seal([item]).digest != seal([replace(item, S=item.S + 1e-12)]).digest


def test_a_truth_without_an_answer_is_not_scored() -> None:
    """Answers that do not match the sealed files stop the count."""
    with pytest.raises(ValueError, match=r"1 files have only .* FIC-0002\.csv"):
        score([case(1), case(2)], [BlindAnswer(file="FIC-0001.csv", verdict="none")])
