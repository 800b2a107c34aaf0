"""``Base``: what every table has in common."""

from __future__ import annotations

from datetime import datetime
from typing import Any, ClassVar

from sqlalchemy import Double, ForeignKey, LargeBinary, MetaData
from sqlalchemy.orm import DeclarativeBase, Mapped, mapped_column

from stemwatch.service.store.columns import CleanJson, CleanText, UtcDateTime

_NAMES = {
    "ix": "ix_%(column_0_N_label)s",
    "uq": "uq_%(table_name)s_%(column_0_N_name)s",
    "fk": "fk_%(table_name)s_%(column_0_N_name)s_%(referred_table_name)s",
    "pk": "pk_%(table_name)s",
}


class Base(DeclarativeBase):
    """Constraint names are fixed here, so that migrations can drop what they created."""

    metadata = MetaData(naming_convention=_NAMES)
    type_annotation_map: ClassVar[dict[Any, Any]] = {
        str: CleanText,
        float: Double,
        datetime: UtcDateTime,
        dict[str, Any]: CleanJson,
        list[str]: CleanJson,
        bytes: LargeBinary,
    }


def of_valve() -> Mapped[str]:
    """A column that names the valve a row belongs to, and goes with it."""
    return mapped_column(ForeignKey("valves.id", ondelete="CASCADE"))
