"""A narrow table: one row per sample, with columns for tag, time, value and quality."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stemwatch.connectors.connector import UnreadableSource
from stemwatch.connectors.historian.raw_table import Index, RawColumn, RawTable, RawTimes
from stemwatch.connectors.historian.tables.layout_input import LayoutInput
from stemwatch.connectors.historian.values.quality_codes import Family
from stemwatch.connectors.historian.values.stored_text import (
    Kinds,
    cells_at,
    chosen,
    code_together,
    coded,
    first_filled,
    forget_codes,
    joined,
    rows_of_each,
)
from stemwatch.connectors.historian.values.units import bare_tag, canonical, split_unit

TAG_NAMES = (
    "tagname", "tag", "tag_name", "tag name", "point", "pointname", "point name", "name",
    "variable", "signal", "item", "itemname", "messstelle", "kks", "bezeichnung", "signalname",
    "point_name", "tagid", "tag id", "path", "pointid", "sensor", "varname",
)  # fmt: skip
VALUE_NAMES = (
    "value", "wert", "vvalue", "valeur", "valor", "valore", "val", "ip_trend_value", "messwert",
    "_value", "reading", "y", "varvalue",
)  # fmt: skip
QUALITY_NAMES = (
    "qualitydetail", "opcquality", "opc_quality", "dataquality", "quality", "status",
    "ip_trend_qstatus", "ip_trend_qlevel", "qualität", "qualitaet", "statuscode", "good", "qualite",
    "qualité", "confidence", "state", "qualitycode", "validity",
)  # fmt: skip
ATTRIBUTE_NAMES = ("attribute", "attribut", "parameter", "param", "field", "property")
UNIT_NAMES = ("unit", "units", "einheit", "unité", "unidad", "uom", "engunits", "eu")
DESCRIPTION_NAMES = ("description", "descriptor", "desc", "beschreibung", "descripción")


@dataclass(frozen=True, kw_only=True)
class NarrowColumns:
    """Column numbers, counted from 0."""

    tag: int | None  # None: the file holds one tag only
    time: tuple[int, ...]
    value: int
    quality: int | None = None
    unit: int | None = None
    description: int | None = None
    second_value: int | None = None  # where ``value`` is empty, such as vValue
    attribute: int | None = None  # what of the tag a row has, such as OP or PV of a controller


def pick(header: Sequence[str], names: Sequence[str], option: str | None = None) -> int | None:
    """The column with the user's name, else with the first of ``names`` that is there."""
    lower = [cell.strip().lower() for cell in header]
    for name in (option,) if option is not None else names:
        if name.strip().lower() in lower:
            return lower.index(name.strip().lower())
    return None


def demand(header: Sequence[str], name: str | None, source: LayoutInput) -> None:
    """Raise ``UnreadableSource`` where the user named a column that is not there."""
    if name is not None and pick(header, (), name) is None:
        raise UnreadableSource(
            f"{source.name}: there is no column {name!r}; the headers are {', '.join(header)}"
        )


def narrow_table(
    source: LayoutInput,
    columns: Sequence[Sequence[str]],
    numbers: Sequence[int],
    header: Sequence[str],
    column_of: NarrowColumns,
    *,
    separator: str,
    layout: str,
    family: Family = "unknown",
    day_first: bool | None = None,
    decimal: str | None = None,
) -> RawTable:
    """The table of a file with one sample per row."""
    times = RawTimes(
        texts=_joined(columns, column_of.time),
        name=header[column_of.time[0]] if header else "",
        day_first=day_first,
    )
    coded_ones = (column_of.tag, column_of.attribute, column_of.quality)
    code_together([columns[i] for i in coded_ones if i is not None])
    series = _series(columns, column_of, source)
    cells = _values(columns, column_of)
    quality_name = (
        header[column_of.quality] if column_of.quality is not None and header else "Quality"
    )
    units = _firsts(columns, column_of.unit, series)
    descriptions = _firsts(columns, column_of.description, series)
    codes = None if column_of.quality is None else columns[column_of.quality]
    raw = [
        _column(
            *(tag, rows, cells, codes, units.get(tag, ""), descriptions.get(tag, "")),
            *(quality_name, family),
        )
        for tag, rows in series.items()
    ]
    return RawTable(
        layout=layout,
        times=times,
        columns=raw,
        numbers=numbers,
        separator=separator,
        narrow=True,
        decimal=decimal,
    )


def _joined(columns: Sequence[Sequence[str]], time: tuple[int, ...]) -> Sequence[str]:
    if len(time) == 1:
        return columns[time[0]]
    return joined(columns[time[0]], columns[time[1]])


def _values(columns: Sequence[Sequence[str]], column_of: NarrowColumns) -> Sequence[str]:
    if column_of.second_value is None:
        return columns[column_of.value]
    return first_filled(columns[column_of.value], columns[column_of.second_value])


def _series(
    columns: Sequence[Sequence[str]], column_of: NarrowColumns, source: LayoutInput
) -> dict[str, Index]:
    """Rows of each tag, in file order."""
    if column_of.tag is None:
        n = len(columns[column_of.value])
        return {source.document.path.stem.split(".")[0]: np.arange(n, dtype=np.int64)}
    tags, tag_index = coded(columns[column_of.tag])
    forget_codes(columns[column_of.tag])
    if column_of.attribute is not None:
        tags, tag_index = _with_attributes(tags, tag_index, columns[column_of.attribute])
    rows = rows_of_each(tag_index, len(tags))
    return {tag: rows_of_tag for tag, rows_of_tag in zip(tags, rows, strict=True) if tag}


def _with_attributes(
    tags: Sequence[str], tag_index: Kinds, cells: Sequence[str]
) -> tuple[list[str], Kinds]:
    """The tags with their attributes, ``TAG.ATTRIBUTE``, and which of them each row has."""
    attributes, attribute_index = coded(cells)
    forget_codes(cells)
    both = tag_index.astype(np.int64) * len(attributes) + attribute_index
    kinds, index = np.unique(both, return_inverse=True)
    pairs = [(tags[kind // len(attributes)], attributes[kind % len(attributes)]) for kind in kinds]
    return [".".join(filter(None, pair)) if pair[0] else "" for pair in pairs], index


def _firsts(
    columns: Sequence[Sequence[str]], column: int | None, series: dict[str, Index]
) -> dict[str, str]:
    """What a column says on the first row of each tag."""
    if column is None:
        return {}
    rows = {tag: int(rows_of_tag[0]) for tag, rows_of_tag in series.items()}
    order = sorted(rows, key=rows.__getitem__)
    texts = cells_at(columns[column], np.array([rows[tag] for tag in order], dtype=np.int64))
    return {tag: text.strip() for tag, text in zip(order, texts, strict=True)}


def _column(
    tag: str,
    rows: Index,
    cells: Sequence[str],
    quality_codes: Sequence[str] | None,
    unit: str,
    description: str,
    quality_name: str,
    family: Family,
) -> RawColumn:
    return RawColumn(
        tag=bare_tag(tag),
        cells=chosen(cells, rows),
        unit=canonical(unit) or split_unit(tag)[1],
        description=description,
        rows=rows,
        quality_codes=None if quality_codes is None else chosen(quality_codes, rows),
        quality_name=quality_name,
        quality_family=family,
    )
