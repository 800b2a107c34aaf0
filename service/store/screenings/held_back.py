"""Where a screening says that its named effects do not stand among all valves of its run.

A key beside the fields of the mismatch in its JSON column: what was found stays as it was found.
"""

from __future__ import annotations

from typing import Any

from sqlalchemy import JSON, ColumnElement, case, type_coerce

from stemwatch.models.mismatch.findings import Finding
from stemwatch.service.store.screenings.tables import ScreeningRow

KEY = "held_back"


def remark_column() -> ColumnElement[str | None]:
    """The sentence in SQL, without the rest of the long column, and of the few that are named only;
    null where there is none."""
    kept = type_coerce(ScreeningRow.mismatch, JSON)[KEY].as_string()
    named = ScreeningRow.mismatch_finding == Finding.NAMED.value
    return case((named, kept), else_=None).label(KEY)


def remark_of(stored: Any) -> str:
    """The sentence that says so; empty where the effects stand, or where nothing was named."""
    said = stored.get(KEY) if isinstance(stored, dict) else None
    return said if isinstance(said, str) else ""
