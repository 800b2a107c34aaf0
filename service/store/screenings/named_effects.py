"""Which of the effects that a stored screening names are defects, without reading its mismatch.

Physics that belongs to the machine (``Effect.inherent``) is named but asks for no work. The slugs
of the others are one more key in the JSON of a mismatch; one that an older version stored lacks it,
and all its effects count as defects.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from sqlalchemy import JSON, ColumnElement, and_, case, func, not_, type_coerce

from stemwatch.models.mismatch.findings import Finding, Mismatch
from stemwatch.service.store.screenings.false_discoveries import remark_column
from stemwatch.service.store.screenings.tables import ScreeningRow

KEY = "defects"


def defects_key(mismatch: Mismatch) -> dict[str, str]:
    """What is stored beside a mismatch: the slugs of its defects, with blanks between them."""
    return {KEY: " ".join(effect.slug for effect in mismatch.defects)}


def named_column(source: Any = ScreeningRow) -> ColumnElement[bool]:
    """Whether a screening names any effect; never NULL. ``source`` is the table or an alias of
    it."""
    words = [Finding.NAMED.value, Finding.CANDIDATES.value]
    return func.coalesce(source.mismatch_finding.in_(words), False)


def defects_column(source: Any = ScreeningRow) -> ColumnElement[str | None]:
    """What ``defects_key`` stored, as an SQL column; NULL where nothing was named or an older
    version stored it. Read only where effects are named, since the JSON is long."""
    stored_kinds = type_coerce(source.mismatch, JSON)[KEY].as_string()
    return case((named_column(source), stored_kinds), else_=None).label(KEY)


def defective_column(source: Any = ScreeningRow) -> ColumnElement[bool]:
    """Whether a defect is named that stands among all valves of its run; never NULL."""
    is_held_back = not_(func.coalesce(remark_column(source), "") != "")
    return and_(
        named_column(source), is_held_back, func.coalesce(defects_column(source), "all") != ""
    )


def defects_of(slugs: Sequence[str] | None, stored: str | None) -> tuple[str, ...]:
    """The defects among the named ``slugs``, by what ``defects_column`` has."""
    return tuple(slugs or ()) if stored is None else tuple(stored.split())
