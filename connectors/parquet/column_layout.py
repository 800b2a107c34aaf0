"""The layout of a Parquet file: which columns are time, tag, value and quality."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from stemwatch.connectors.connector import UnreadableSource
from stemwatch.connectors.historian.options import ReadOptions
from stemwatch.connectors.historian.tables.narrow import (
    QUALITY_NAMES,
    TAG_NAMES,
    UNIT_NAMES,
    VALUE_NAMES,
)
from stemwatch.connectors.historian.values.units import bare_tag, canonical, split_unit

Kind = Literal["wide", "narrow", "valves"]
TIME_NAMES = ("time", "timestamp", "ts", "datetime", "date_time", "utc", "zeit", "zeitstempel",
              "event_time", "eventtime", "sample_time", "time_utc", "date", "_time")  # fmt: skip
VALVE_NAMES = ("valve", "valve_id", "valveid", "loop", "loop_id", "asset", "equipment", "ventil")
SEPARATORS = (".", "/", ":", "_")
_QUALITY_ENDS = ("quality", "status", "statuscode", "qualität", "qual")
WORDS: Mapping[Kind, str] = {
    "wide": "Parquet, a column for each tag",
    "narrow": "Parquet, a row for each sample of a tag",
    "valves": "Parquet, a row for each instant of a valve",
}


@dataclass(frozen=True, kw_only=True)
class ColumnLayout:
    """The columns of one file.

    ``values`` maps a tag (wide), or what follows the valve's name (valves), to its column; of a
    narrow file it holds the one value column. ``key`` is the column, or the folder's key, that
    names the tag or the valve; ``None`` where the file is one tag, called ``fixed``.
    """

    kind: Kind
    time: str
    values: Mapping[str, str]
    qualities: Mapping[str, str]  # quality column of each value column
    units: Mapping[str, str]  # unit of each value column, where the file says it
    key: str | None = None
    unit_column: str | None = None
    fixed: str = ""


def decide_layout(
    schema: Any, keys: Mapping[str, str], options: ReadOptions, source_name: str, stem: str
) -> ColumnLayout:
    """The layout of a file with this Arrow ``schema`` and these folder ``keys``.

    Raises ``UnreadableSource`` where no column can be the time, or none holds numbers.
    """
    names = list(schema.names)
    time = _time_column(schema, options, source_name)
    value = _named(names, VALUE_NAMES, options.value_column, source_name)
    key = _key(schema, keys, options, source_name, narrow=value is not None)
    shared = _named(names, QUALITY_NAMES, options.quality_column, source_name)
    if (
        value is not None
        and value != time
        and (key is not None or _holds_one_tag(schema, value, time))
    ):
        return ColumnLayout(
            kind="narrow",
            time=time,
            values={value: value},
            qualities={value: shared} if shared else {},
            units={value: _unit(schema, value)},
            key=key,
            unit_column=_named(names, UNIT_NAMES, None, source_name),
            fixed=stem,
        )
    measured = _measured(schema, {time, key})
    qualities = _qualities(measured, names)
    if options.quality_column or key is not None:
        qualities = {name: shared for name in measured if shared} | qualities
    measured = [name for name in measured if name not in qualities.values()]
    if not measured:
        raise UnreadableSource(
            f"{source_name}: no column holds numbers beside the time {time!r}; its columns are "
            f"{columns_text(schema)}"
        )
    return ColumnLayout(
        kind="wide" if key is None else "valves",
        time=time,
        values={name if key is not None else bare_tag(name): name for name in measured},
        qualities=qualities,
        units={name: _unit(schema, name) for name in measured},
        key=key,
    )


def columns_text(schema: Any) -> str:
    """Columns with their types, the first dozen."""
    column_list = [f"{field.name} ({field.type})" for field in list(schema)[:12]]
    return ", ".join(column_list) + (", ..." if len(schema) > 12 else "")


def _time_column(schema: Any, options: ReadOptions, source_name: str) -> str:
    import pyarrow.types as kinds

    names = [str(name) for name in schema.names]
    if options.time_column is not None:
        return str(_named(names, (), options.time_column, source_name))
    stamps = [str(field.name) for field in schema if kinds.is_timestamp(field.type)]
    named = [name for name in TIME_NAMES for column in names if column.strip().lower() == name]
    by_name = [column for name in named for column in names if column.strip().lower() == name]
    best = [name for name in by_name if name in stamps] or (stamps if len(stamps) == 1 else by_name)
    if not best:
        raise UnreadableSource(
            f"{source_name}: none of the columns is the time; expected one of type timestamp, or "
            f"one called time or timestamp. Say time_column; the columns are {columns_text(schema)}"
        )
    return best[0]


def _named(
    names: Sequence[str], usual_names: Sequence[str], option: str | None, source_name: str
) -> str | None:
    lower = {name.strip().lower(): name for name in reversed(names)}
    if option is not None:
        if option.strip().lower() not in lower:
            raise UnreadableSource(
                f"{source_name}: there is no column {option!r}; the columns are "
                f"{', '.join(names[:20])}"
            )
        return lower[option.strip().lower()]
    return next((lower[name] for name in usual_names if name in lower), None)


def _key(
    schema: Any, keys: Mapping[str, str], options: ReadOptions, source_name: str, *, narrow: bool
) -> str | None:
    """The column or folder key that names tag or valve."""
    texts = [field.name for field in schema if is_text(field.type)]
    text_columns = [*(list(schema.names) if options.tag_column else texts), *keys]
    order = (*TAG_NAMES, *VALVE_NAMES) if narrow else VALVE_NAMES
    return _named(text_columns, order, options.tag_column, source_name)


def is_text(kind: Any) -> bool:
    """Whether an Arrow type holds text, plain or as a dictionary."""
    import pyarrow.types as kinds

    if kinds.is_dictionary(kind):
        kind = kind.value_type
    return bool(
        kinds.is_string(kind) or kinds.is_large_string(kind) or str(kind) in ("string_view",)
    )


def is_number(kind: Any) -> bool:
    """Whether an Arrow type holds numbers or truth values, plain or as a dictionary."""
    import pyarrow.types as kinds

    if kinds.is_dictionary(kind):
        kind = kind.value_type
    return bool(
        kinds.is_floating(kind)
        or kinds.is_integer(kind)
        or kinds.is_decimal(kind)
        or kinds.is_boolean(kind)
    )


def _measured(schema: Any, used_columns: set[str | None]) -> list[str]:
    return [
        field.name
        for field in schema
        if field.name not in used_columns
        and not field.name.startswith("__index_level_")
        and (is_number(field.type) or is_text(field.type))
    ]


def _qualities(measured: Sequence[str], names: Sequence[str]) -> dict[str, str]:
    """``FIC1.OP_quality`` belongs to ``FIC1.OP``."""
    lower = {name.lower(): name for name in names}
    return {
        name: lower[f"{name.lower()}{sign}{end}"]
        for name in measured
        for sign in (*SEPARATORS, " ")
        for end in _QUALITY_ENDS
        if f"{name.lower()}{sign}{end}" in lower
    }


def _holds_one_tag(schema: Any, value: str, time: str) -> bool:
    """Whether a file without a tag column holds one tag: nothing else in it is a number."""
    others = {field.name for field in schema if is_number(field.type)} - {value, time}
    return all(name.lower() in QUALITY_NAMES for name in others)


def _unit(schema: Any, name: str) -> str:
    unit = (schema.field(name).metadata or {}).get(b"unit", b"").decode("utf-8", "replace")
    return canonical(unit) if unit else split_unit(name)[1]
