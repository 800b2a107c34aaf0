"""Reading a ``[[sources]]`` table with a ``kind``. One that is wrong costs itself only."""

from __future__ import annotations

from typing import Any

from pydantic import ValidationError

from stemwatch.service.plantfile.archives import KINDS
from stemwatch.service.plantfile.explain import Place, described, problems_of
from stemwatch.service.plantfile.found import Found
from stemwatch.service.plantfile.nearest import either_of, nearest


def read_archive(table: dict[str, Any], place: Place, found: Found, *, known: bool) -> None:
    """Keep the archive if nothing is wrong with it and its name is its own (``known``)."""
    kind = table["kind"]
    model = KINDS.get(kind) if isinstance(kind, str) else None
    if model is None:
        expected = either_of(KINDS) + "; without kind a source is a text export"
        expected += nearest(kind, KINDS) if isinstance(kind, str) else ""
        found.problems.append(place.problem(("kind",), described(kind), expected))
        return
    try:
        source = model.model_validate(table)
    except ValidationError as error:
        found.problems += problems_of(error, model, place)
        return
    if known:
        found.archives[source.name] = source
