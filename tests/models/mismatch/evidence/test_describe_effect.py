"""The sentence about what S and J leave out."""

from __future__ import annotations

import pytest

from stemwatch.models.mismatch.evidence.describe_effect import sentence_of
from stemwatch.models.mismatch.findings import Finding


@pytest.mark.parametrize(
    ("refused", "said"),
    [
        ((), "nothing else is needed."),
        (("travel_stop",), "nothing else is needed. 1 effect could not be tested here."),
        (("travel_stop", "dead_time"), "needed. 2 effects could not be tested here."),
    ],
)
def test_what_could_not_be_tested_is_counted(refused, said):
    """Nothing is left out, as far as could be tested."""
    sentence = sentence_of(Finding.NONE, (), dict.fromkeys(refused, "why"), None, "", "")
    assert sentence.startswith("S and J explain this recording")
    assert sentence.endswith(said)


def test_where_an_effect_is_doubted_nothing_else_is_meant_by_they():
    """The doubt speaks of effects, and what may leave something out are S and J."""
    doubt = "Asymmetric lag would explain parts of this recording"
    said = sentence_of(Finding.UNKNOWN, (), {}, None, doubt, "")
    assert said == f"{doubt}: it cannot be told whether anything is left out, and nothing is named."
