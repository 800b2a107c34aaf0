"""The verdict with its reason and the next step, and the words that all verdicts share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stemwatch.models.decision.decision_evidence import DecisionEvidence
from stemwatch.models.recording import Bools
from stemwatch.models.verdict import NoVerdict, Shape, Verdict

# J/S at which one shape ends and the next begins (Choudhury 2005 names them at 0, 1 exactly).
DEADBAND_BELOW = 0.1
NO_OFFSET = (0.85, 1.15)
MOST_CONFIDENCE = 0.99  # bootstrap draws do not cover what no model here describes


@dataclass(frozen=True, kw_only=True)
class Decision:
    """The verdict with its reason, the next step, its rank and its confidence."""

    verdict: Verdict
    reason: str
    advice: str
    shape: Shape | None = None
    severity: float = 0.0
    confidence: float | None = None
    no_verdict: NoVerdict | None = None  # why it is undetermined
    numbers_hold: bool = True  # False where S and J do not describe the valve and must not be shown


def shape_of(S: float, J: float) -> Shape:
    """The shape of the OP-MV loop by its ratio J/S."""
    ratio = J / S if S > 0 else 0.0
    if ratio < DEADBAND_BELOW:
        return Shape.DEADBAND
    if ratio < NO_OFFSET[0]:
        return Shape.UNDERSHOOT
    return Shape.NO_OFFSET if ratio <= NO_OFFSET[1] else Shape.OVERSHOOT


def share_of(draws: Bools) -> float:
    """The share of ``draws`` that are True, at most ``MOST_CONFIDENCE``."""
    return min(float(np.mean(draws)), MOST_CONFIDENCE)


def percent(value: float | None) -> str:
    """A value in percent, as text."""
    return "?" if value is None else f"{value:.1f} %"


def S_text(evidence: DecisionEvidence) -> str:
    """S with its interval, as text."""
    S = evidence.S
    return f"{percent(S.value)} ({percent(S.low)} to {percent(S.high)})"
