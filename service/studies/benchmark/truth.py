"""The sealed truth of a benchmark, and the digests that prove that nothing was changed."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from hashlib import sha256
from pathlib import Path

from stemwatch.service.studies.proof.truth import BrokenSeal, digest_of

STICKS_FROM = 1.0  # S in percent of OP span; no valve of the set lies between 0.7 and 1.4 %
NONE, OTHER = "none", "other"


@dataclass(frozen=True, kw_only=True)
class ValveTruth:
    """What is true of one recording. ``S`` and ``J`` in percent of OP span, as they read off the
    noise-free OP-MV loop. ``cause`` is the slug of the effect beside friction, ``none`` or
    ``other``; empty where the cause is not asked, because the valve has several."""

    case: str
    position: bool  # whether the recording has MV
    S: float
    J: float
    cause: str = ""

    @property
    def sticks(self) -> bool:
        """Whether the valve sticks."""
        return self.S >= STICKS_FROM


@dataclass(frozen=True, kw_only=True)
class BenchmarkTruth:
    """The truth of all cases, the seed that makes the set again, and the recordings' digest."""

    seed: int
    recordings: str  # SHA-256, see ``recordings_digest``
    cases: tuple[ValveTruth, ...]

    def sealed(self) -> str:
        """The text whose digest the page prints: one case a line, keys sorted."""
        lines = ",\n".join(json.dumps(asdict(case), sort_keys=True) for case in self.cases)
        head = json.dumps({"seed": self.seed, "recordings": self.recordings})
        return f"{head[:-1]}, " + f'"cases": [\n{lines}\n]}}\n'


def opened(text: str, digest: str) -> BenchmarkTruth:
    """The truth. Raises ``BrokenSeal`` where ``text`` is not what was sealed as ``digest``."""
    if (found := digest_of(text)) != digest:
        raise BrokenSeal(
            f"the truth is not the one of this benchmark: its SHA-256 is {found}, the page of the "
            f"folder prints {digest}; nothing was scored. Give the truth that belongs to it"
        )
    stored = json.loads(text)
    cases = tuple(ValveTruth(**case) for case in stored["cases"])
    return BenchmarkTruth(seed=stored["seed"], recordings=stored["recordings"], cases=cases)


def recordings_digest(files: Sequence[Path]) -> str:
    """SHA-256 over the SHA-256 of each file, in the order of their names."""
    total = sha256()
    for file in sorted(files, key=lambda path: path.name):
        total.update(sha256(file.read_bytes()).digest())
    return total.hexdigest()
