"""The truth of a case, and the seal that proves it was not changed before the scoring."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from hashlib import sha256

RECORD_EFFECTS = ("quantisation", "historian_compression", "sampling_jitter", "frozen_signal")
OUTSIDE = "unknown"  # the slug of an effect that the catalogue does not have
WIDE_SCATTER = 0.08  # of the breakaway level; above it a null counts among those of wide scatter


class BrokenSeal(ValueError):
    """The opened truth is not the one whose digest was printed."""


class CaseKind(StrEnum):
    """Kinds of case, by the number of hidden effects."""

    NULL = "nothing hidden"
    SINGLE = "one effect"
    PAIR = "two effects"
    UNKNOWN = "outside the catalogue"


@dataclass(frozen=True, kw_only=True)
class CaseTruth:
    """One case: what was hidden, under what, and the valve's own S and J.

    ``file`` is the name of its CSV file. ``hidden`` is what the plant calls it, ``effects`` what a
    judge may call it: slugs of the catalogue, of records as well as of physics, or "unknown".
    ``record_effects`` are those of the record, hidden on purpose or concealing something else.
    ``excited`` is False where the recording cannot show every effect, ``excitation`` by how much
    each moves the reading (RMS, percent of span). ``S`` and ``J`` in percent of span as they read
    off the noise-free OP-MV loop, ``scatter`` as a share of the breakaway level, ``samples`` the
    length, ``sizes`` what was drawn.
    """

    file: str
    hidden: tuple[str, ...]
    effects: tuple[str, ...]
    record_effects: tuple[str, ...]
    concealment: str
    excited: bool
    S: float
    J: float
    scatter: float
    samples: int
    excitation: Mapping[str, float] = field(default_factory=dict)
    sizes: Mapping[str, float] = field(default_factory=dict)

    @property
    def physics(self) -> tuple[str, ...]:
        """The slugs that a right answer names."""
        return tuple(slug for slug in self.effects if slug not in (*RECORD_EFFECTS, OUTSIDE))

    @property
    def kind(self) -> CaseKind:
        """By the physics that is hidden; a record effect alone is no physics."""
        if OUTSIDE in self.effects:
            return CaseKind.UNKNOWN
        return (CaseKind.NULL, CaseKind.SINGLE, CaseKind.PAIR)[min(len(self.physics), 2)]

    @property
    def label(self) -> str:
        """The truth in a table of confusions."""
        if self.kind is CaseKind.UNKNOWN:
            return f"outside: {' + '.join(self.hidden)}"
        return " + ".join(sorted(self.physics)) or CaseKind.NULL.value


@dataclass(frozen=True, kw_only=True)
class Seal:
    """The truths as canonical JSON, and the SHA-256 digest (hexadecimal) of its UTF-8 bytes."""

    text: str
    digest: str

    def open(self) -> tuple[CaseTruth, ...]:
        """The truths. Raises ``BrokenSeal`` where the text is not the one that was sealed."""
        digest = digest_of(self.text)
        if digest != self.digest:
            raise BrokenSeal(
                f"the truth was changed after it was sealed: its digest is {digest}, the one "
                f"printed before the judging is {self.digest}; nothing was scored. Run it again."
            )
        return tuple(_from_json(load) for load in json.loads(self.text))


def seal(truths: Sequence[CaseTruth]) -> Seal:
    """Close ``truths``: keys sorted, one case a line, so that the same truths give one digest."""
    lines = [
        json.dumps(asdict(truth), sort_keys=True, allow_nan=False)
        for truth in sorted(truths, key=lambda truth: truth.file)
    ]
    text = "[\n" + ",\n".join(lines) + "\n]\n"
    return Seal(text=text, digest=digest_of(text))


def digest_of(text: str) -> str:
    """SHA-256 of the UTF-8 bytes of ``text``, as ``sha256sum`` prints it."""
    return sha256(text.encode("utf-8")).hexdigest()


def _from_json(stored: Mapping[str, object]) -> CaseTruth:
    """One case as it was sealed; lists become tuples again."""
    fields_read = {
        name: tuple(value) if isinstance(value, list) else value for name, value in stored.items()
    }
    return CaseTruth(**fields_read)  # type: ignore[arg-type]  # the very fields that asdict wrote
