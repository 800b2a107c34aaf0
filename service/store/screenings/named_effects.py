"""Which named defects of a stored screening stand, read without parsing its mismatch.

Physics that belongs to the machine (``Effect.inherent``) is named but asks for no work. The slugs
of the others are an additional key in the JSON of a mismatch; where an older version stored the
mismatch, the key is missing and all its effects count as defects. Why they do not stand among all
valves of the run is another key. The slugs that windows of weeks confirm, known once the run is
finished, are a key in the JSON of its evidence; where the valve has a history that decides, it says
which defects stand, whatever this window names.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from sqlalchemy import JSON, ColumnElement, and_, case, func, not_, type_coerce

from stemwatch.models.mismatch.findings import Finding, Mismatch
from stemwatch.service.store.screenings.tables import ScreeningRow

KEY = "defects"
HELD_BACK = "held_back"
CONFIRMED = "confirmed"


def defects_key(mismatch: Mismatch) -> dict[str, str]:
    """What is stored beside a mismatch: the slugs of its defects, with blanks between them."""
    return {KEY: " ".join(effect.slug for effect in mismatch.defects)}


def named_column(source: Any = ScreeningRow) -> ColumnElement[bool]:
    """Whether a screening names any effect; never NULL. ``source``: the table or an alias of it."""
    words = [Finding.NAMED.value, Finding.CANDIDATES.value]
    return func.coalesce(source.mismatch_finding.in_(words), False)


def remark_column(source: Any = ScreeningRow) -> ColumnElement[str | None]:
    """The remark as an SQL column, read only for screenings with named effects, since the JSON is
    long; NULL where there is none. ``source`` is the table of screenings or an alias of it."""
    kept = type_coerce(source.mismatch, JSON)[HELD_BACK].as_string()
    return case((named_column(source), kept), else_=None).label(HELD_BACK)


def remark_of(stored: Any) -> str:
    """The remark in a stored mismatch; empty where the effects stand or nothing was named."""
    remark = stored.get(HELD_BACK) if isinstance(stored, dict) else None
    return remark if isinstance(remark, str) else ""


def defects_column(source: Any = ScreeningRow) -> ColumnElement[str | None]:
    """What ``defects_key`` stored, as an SQL column; NULL where nothing was named or an older
    version stored it. Read only where effects are named, since the JSON is long."""
    kept = type_coerce(source.mismatch, JSON)[KEY].as_string()
    return case((named_column(source), kept), else_=None).label(KEY)


def confirmed_column(source: Any = ScreeningRow) -> ColumnElement[str | None]:
    """The slugs that the windows of weeks confirm and that stand, with blanks between them, as an
    SQL column; NULL where the valve has no history that decides."""
    kept: ColumnElement[str | None] = type_coerce(source.evidence, JSON)[CONFIRMED].as_string()
    return kept.label(CONFIRMED)


def confirmed_of(evidence: Any) -> tuple[str, ...] | None:
    """The same from a stored evidence."""
    kept = evidence.get(CONFIRMED) if isinstance(evidence, dict) else None
    return tuple(kept.split()) if isinstance(kept, str) else None


def standing_columns(source: Any = ScreeningRow) -> tuple[ColumnElement[str | None], ...]:
    """The columns beside ``mismatch_slugs`` from which ``standing_defects`` are told."""
    return remark_column(source), defects_column(source), confirmed_column(source)


def standing_defects(row: Any) -> tuple[str, ...]:
    """The defects that stand of a row with ``mismatch_slugs`` and ``standing_columns``: confirmed
    by the windows of weeks, or without a history named and not held back."""
    if row.confirmed is not None:
        return tuple(row.confirmed.split())
    return () if row.held_back else defects_of(row.mismatch_slugs, row.defects)


def defective_column() -> ColumnElement[bool]:
    """Whether there is a defect that stands, as ``standing_defects`` tells it; never NULL."""
    stands = not_(func.coalesce(remark_column(), "") != "")
    newest = and_(named_column(), stands, func.coalesce(defects_column(), "all") != "")
    confirmed = confirmed_column()
    return case((confirmed.is_not(None), confirmed != ""), else_=newest)


def defects_of(slugs: Sequence[str] | None, stored: str | None) -> tuple[str, ...]:
    """The defects among the named ``slugs``, by what ``defects_column`` has."""
    return tuple(slugs or ()) if stored is None else tuple(stored.split())
