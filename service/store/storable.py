"""Texts and numbers in the form that both SQLite and PostgreSQL accept, and rows as values."""

from __future__ import annotations

import math
import re
from dataclasses import fields
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Value = TypeVar("Value", bound="DataclassInstance")

_NOT_STORABLE = re.compile("[\x00\ud800-\udfff]")


def clean_text(text: str) -> str:
    """``text`` with U+FFFD in place of NUL and lone surrogates, which databases refuse."""
    return _NOT_STORABLE.sub("\ufffd", text)


def finite(value: float | None) -> float | None:
    """``value``, or ``None`` where it is not a finite number."""
    return float(value) if value is not None and math.isfinite(value) else None


def from_row(kind: type[Value], row: object, /, **others: Any) -> Value:
    """A ``kind`` whose fields are the columns of ``row`` with their names, but for ``others``."""
    names = (field.name for field in fields(kind) if field.name not in others)
    return kind(**{name: getattr(row, name) for name in names}, **others)


def columns_of(value: DataclassInstance, /, **others: Any) -> dict[str, Any]:
    """The fields of ``value`` by their names, as ``from_row`` takes them, but for ``others``."""
    names = (field.name for field in fields(value) if field.name not in others)
    return {name: getattr(value, name) for name in names} | others
