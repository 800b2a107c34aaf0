"""What is said to speak for a loop as the source of its group."""

from __future__ import annotations

import numpy as np

from stemwatch.models.oscillation_groups.plant_groups import evidence_sentences
from stemwatch.models.oscillation_groups.sources import NAMES, MemberEvidence, SourceRanking

STICKS = "its valve sticks by its measured position"


def said(*sticking: float) -> tuple[str, ...]:
    """Of the first of loops that differ only in what their positions tell: 1, 0 not known, -1."""
    values = np.zeros((len(sticking), len(NAMES)))
    values[:, NAMES.index("sticking")] = sticking
    members = tuple(range(len(sticking)))
    ranking = SourceRanking(members=members, probability=(0.3,) * len(members), none=0.1)
    return evidence_sentences(MemberEvidence(members=members, values=values), ranking)[0]


def test_a_valve_of_which_nothing_is_known_is_not_said_to_stick() -> None:
    """Beside valves that are known not to stick it is the likelier source, but for no such reason;
    a valve that sticks by its position is."""
    assert STICKS in said(1.0, -1.0, -1.0)
    assert STICKS not in said(0.0, -1.0, -1.0)
