"""The sentence about what S and J leave out."""

from __future__ import annotations

from typing import Any

from stemwatch.models.mismatch.evidence.describe_effect import sentence_of
from stemwatch.models.mismatch.findings import Finding


def test_where_an_effect_is_doubted_the_sentence_says_whose_omission_is_unknown() -> None:
    """The doubt speaks of effects, so that "they" would be these, and not S and J."""
    doubt = "Asymmetric lag would explain parts of this recording"
    no_map: Any = None  # a doubt needs none
    said = sentence_of(Finding.UNKNOWN, (), {}, no_map, doubt, "")
    assert said == f"{doubt}: it cannot be told whether anything is left out, and nothing is named."
