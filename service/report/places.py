"""Where a residual lives, facet by facet, before and after: bars on one scale."""

from __future__ import annotations

from dataclasses import dataclass

from stemwatch.models.mismatch.findings import Cell, Mismatch
from stemwatch.service.report.mismatch_words import facet_title
from stemwatch.service.report.words import finite


@dataclass(frozen=True, kw_only=True)
class Place:
    """One cell: rms before and after in percent of span, and both as percent of a full bar.

    ``share`` of the squared residual before and ``weight`` of the samples, 0 to 1; ``hot`` where
    the place holds significantly more of the residual than its size.
    """

    label: str
    before: float | None
    after: float | None
    before_length: float
    after_length: float
    share: float | None
    weight: float | None
    hot: bool


@dataclass(frozen=True, kw_only=True)
class Facet:
    """All places of one facet, under its heading."""

    title: str
    places: tuple[Place, ...]


def facets(mismatch: Mismatch) -> list[Facet]:
    """The facets in the order of the map; the longest bar of all is the largest rms before."""
    before = mismatch.before.cells
    after = {(cell.facet, cell.label): cell for cell in mismatch.after.cells}
    hot = {(place.facet, place.label) for place in mismatch.before.hot}
    every = [finite(cell.rms) or 0.0 for cell in (*before, *after.values())]
    top = max(every, default=0.0)
    found: dict[str, list[Place]] = {}
    for cell in before:
        key = (cell.facet, cell.label)
        found.setdefault(cell.facet, []).append(_place(cell, after.get(key), key in hot, top))
    return [
        Facet(title=facet_title(facet), places=tuple(places)) for facet, places in found.items()
    ]


def _place(before: Cell, after: Cell | None, hot: bool, top: float) -> Place:
    rms = finite(before.rms)
    rms_after = None if after is None else finite(after.rms)
    return Place(
        label=before.label,
        before=rms,
        after=rms_after,
        before_length=_length(rms, top),
        after_length=_length(rms_after, top),
        share=finite(before.share),
        weight=finite(before.weight),
        hot=hot,
    )


def _length(rms: float | None, top: float) -> float:
    return 0.0 if rms is None or top <= 0.0 else round(100.0 * min(rms / top, 1.0), 1)
