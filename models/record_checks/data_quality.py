"""The grade of a recording's data, and what is in the way of a verdict on it."""

from __future__ import annotations

from dataclasses import dataclass

from stemwatch.models.verdict import NoVerdict


@dataclass(frozen=True, kw_only=True)
class DataQuality:
    """Grade of the recording's data, A (clean) to D (no verdict possible), with reasons."""

    grade: str
    reasons: tuple[str, ...] = ()


@dataclass(frozen=True)
class Obstacle:
    """Why there can be no verdict, and what would make one possible; a sentence each."""

    slug: NoVerdict
    reason: str
    remedy: str
