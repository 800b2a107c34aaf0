"""``SampleBatch``: samples on their way from a live source to the store."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.recording import Floats, QualityCodes

Instants = NDArray[np.int64]

# A sample with this reason replaces the existing one with its time, since neither is certain.
CAME_TWICE = "the computer's clock was set back: this time came twice"


@dataclass(frozen=True, kw_only=True, eq=False)
class SampleBatch:
    """``n`` samples of one source, as columns; a sample is known by ``(source, tag, at)``.

    ``at_us`` (n,) microseconds since 1970 UTC; ``values`` (n,) engineering units, NaN where
    ``quality`` (n,) of ``Quality`` is not GOOD; ``reasons`` (n,) why not, empty where it is.
    Raises ``ValueError`` for columns of different lengths.
    """

    source: str
    tags: tuple[str, ...]
    at_us: Instants
    values: Floats
    quality: QualityCodes
    reasons: tuple[str, ...]

    def __post_init__(self) -> None:
        columns = (self.tags, self.at_us, self.values, self.quality, self.reasons)
        lengths = [len(column) for column in columns]
        if len(set(lengths)) != 1:
            raise ValueError(f"{self.source}: columns of one length expected, received {lengths}")

    def __len__(self) -> int:
        return len(self.tags)

    @property
    def good(self) -> int:
        """How many samples are good."""
        return int(np.count_nonzero(np.asarray(self.quality) == 0))


def one_instant(
    source: str,
    tags: Sequence[str],
    at_us: int,
    values: Floats,
    quality: QualityCodes,
    reasons: Sequence[str],
) -> SampleBatch:
    """A batch whose samples all bear the time ``at_us``."""
    return SampleBatch(
        source=source,
        tags=tuple(tags),
        at_us=np.full(len(tags), at_us, dtype=np.int64),
        values=np.asarray(values, dtype=np.float64),
        quality=np.asarray(quality, dtype=np.uint8),
        reasons=tuple(reasons),
    )


def joined(batches: Sequence[SampleBatch]) -> SampleBatch:
    """The batches of one source as one. Raises ``ValueError`` for none, or for two sources."""
    sources = {batch.source for batch in batches}
    if len(sources) != 1:
        raise ValueError(f"batches of one source expected, received {sorted(sources)}")
    return SampleBatch(
        source=batches[0].source,
        tags=tuple(tag for batch in batches for tag in batch.tags),
        at_us=np.concatenate([batch.at_us for batch in batches]),
        values=np.concatenate([batch.values for batch in batches]),
        quality=np.concatenate([batch.quality for batch in batches]),
        reasons=tuple(reason for batch in batches for reason in batch.reasons),
    )
