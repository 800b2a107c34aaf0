"""The valves of a part of the plant, and the sites, areas and units that there are."""

from __future__ import annotations

from sqlalchemy import ColumnElement, select
from sqlalchemy.orm import Session

from stemwatch.service.plant_path import LEVELS, PartOfPlant, PlantPath, names_by_level
from stemwatch.service.store.screenings.tables import ValveRow


def in_part(part: PartOfPlant) -> list[ColumnElement[bool]]:
    """The conditions for a row of valves to be in ``part``."""
    return [getattr(ValveRow, level).in_(names) for level, names in part.asked.items()]


def read_levels(session: Session) -> dict[str, tuple[str, ...]]:
    """The sites, areas and units that valves are in, by name."""
    columns = (getattr(ValveRow, level) for level in LEVELS)
    rows = session.execute(select(*columns).distinct())
    return names_by_level(PlantPath(**dict(zip(LEVELS, row, strict=True))) for row in rows)


def read_valves_in(session: Session, part: PartOfPlant) -> list[str]:
    """The valves of a part of the plant, by id."""
    query = select(ValveRow.id).where(*in_part(part)).order_by(ValveRow.id)
    return list(session.scalars(query))
