"""A ``Mismatch`` or an ``OpenQuestion`` as JSON and back, by the type hints of their dataclasses.
Each is stored as a whole, since hardly anything queries its parts."""

from __future__ import annotations

import types
from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from enum import Enum
from functools import lru_cache
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

from stemwatch.models.mismatch.findings import Mismatch
from stemwatch.models.mismatch.open_question import OpenQuestion
from stemwatch.service.store.screenings.named_effects import defects_key

Value = TypeVar("Value")


def mismatch_json(mismatch: Mismatch | None) -> dict[str, Any] | None:
    """The mismatch as JSON, without the samples of its free runs, and without the scores, which are
    stored apart (``evidence``)."""
    if mismatch is None:
        return None
    packed: dict[str, Any] = pack(replace(mismatch, runs=None, scores=()))
    return packed | defects_key(mismatch)


def mismatch_of(stored: Any) -> Mismatch | None:
    """The mismatch from its JSON; ``None`` for a form written by another version."""
    return _unpacked_or_none(Mismatch, stored)


def question_json(question: OpenQuestion | None) -> dict[str, Any] | None:
    """What a test needs of a recording without a mismatch, as JSON."""
    return None if question is None else pack(question)


def question_of(stored: Any) -> OpenQuestion | None:
    """The inverse of ``question_json``; ``None`` for a form written by another version."""
    return _unpacked_or_none(OpenQuestion, stored)


def _unpacked_or_none(kind: type[Value], stored: Any) -> Value | None:
    if not isinstance(stored, dict):
        return None
    try:
        return unpack(kind, stored)
    except (KeyError, TypeError, ValueError):
        return None


def pack(value: Any) -> Any:
    """``value`` in the types of JSON. Dataclasses become objects with a key for each field."""
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: pack(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, Mapping):
        return {str(key): pack(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [pack(inner) for inner in value]
    return value.item() if hasattr(value, "item") else value


def unpack(kind: type[Value], packed: Any) -> Value:
    """The inverse of ``pack`` for a value of type ``kind``; missing fields keep their defaults.

    Raises ``TypeError``, ``ValueError`` or ``KeyError`` where ``packed`` does not fit ``kind``.
    """
    value: Value = _unpack(kind, packed)
    return value


def _unpack(kind: Any, packed: Any) -> Any:
    origin, arguments = get_origin(kind), get_args(kind)
    if origin in (Union, types.UnionType):
        if packed is None:
            return None
        return _unpack(
            next(argument for argument in arguments if argument is not type(None)), packed
        )
    if origin is tuple:
        return _tuple(arguments, packed)
    if origin is not None and isinstance(origin, type) and issubclass(origin, Mapping):
        return {key: _unpack(arguments[1], inner) for key, inner in packed.items()}
    if isinstance(kind, type) and is_dataclass(kind):
        hints = _hints(kind)
        return kind(**{key: _unpack(hints[key], packed[key]) for key in packed if key in hints})
    if isinstance(kind, type) and issubclass(kind, Enum):
        return kind(packed)
    # Numbers that are not finite are stored as null.
    return float("nan") if kind is float and packed is None else packed


def _tuple(arguments: tuple[Any, ...], packed: Any) -> tuple[Any, ...]:
    if len(arguments) == 2 and arguments[1] is Ellipsis:
        return tuple(_unpack(arguments[0], inner) for inner in packed)
    return tuple(_unpack(kind, inner) for kind, inner in zip(arguments, packed, strict=True))


@lru_cache(maxsize=64)
def _hints(kind: type) -> dict[str, Any]:
    return get_type_hints(kind)
