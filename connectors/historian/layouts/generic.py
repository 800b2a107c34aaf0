"""Any other table: wide or narrow, with or without preamble, units, descriptions or times."""

from __future__ import annotations

from collections.abc import Sequence

from stemwatch.connectors.connector import UnreadableSource
from stemwatch.connectors.historian.raw_table import RawTable
from stemwatch.connectors.historian.tables.layout_input import LayoutInput
from stemwatch.connectors.historian.tables.narrow import (
    ATTRIBUTE_NAMES,
    DESCRIPTION_NAMES,
    QUALITY_NAMES,
    TAG_NAMES,
    UNIT_NAMES,
    VALUE_NAMES,
    NarrowColumns,
    demand,
    narrow_table,
    pick,
)
from stemwatch.connectors.historian.tables.rows import Rows
from stemwatch.connectors.historian.tables.structure import (
    Structure,
    column_names,
    find_structure,
    is_number,
)
from stemwatch.connectors.historian.tables.wide import wide_table
from stemwatch.connectors.historian.times.time_formats import is_time
from stemwatch.connectors.historian.values.value_texts import text_quality
from stemwatch.models.recording import Quality


class Generic:
    """Matches every file; tried last."""

    name = "generic"
    order = 1000

    def matches(self, head: list[str]) -> bool:
        return True

    def parse(self, source: LayoutInput) -> RawTable:
        return parse_table(source)


def parse_table(source: LayoutInput, layout: str = "") -> RawTable:
    """The table of a file. ``layout`` names a known product in the provenance."""
    separator = source.separator()
    rows = source.rows(separator)
    structure = find_structure(rows, source.options, source.name)
    header = column_names(structure).tags
    column_roles = narrow_columns(source, rows, structure, header)
    if column_roles is None:
        refuse_text(source, rows, structure)
    body = source.body(
        rows, structure.first_row, structure.width, separator, headers=structure.headers
    )
    if column_roles is not None:
        return narrow_table(
            source,
            body.columns,
            body.numbers,
            header,
            column_roles,
            separator=separator,
            layout=layout or "narrow table: one row per sample",
        )
    return wide_table(
        source, body, structure, separator, layout or "wide table: one column per tag"
    )


def narrow_columns(
    source: LayoutInput, rows: Rows, structure: Structure, header: Sequence[str]
) -> NarrowColumns | None:
    """Which columns hold tag, value and quality; ``None`` for a wide table."""
    options = source.options
    for option in (options.tag_column, options.value_column, options.quality_column):
        demand(header, option, source)
    if not structure.time:
        return None
    tag = pick(header, TAG_NAMES, options.tag_column)
    value = pick(header, VALUE_NAMES, options.value_column)
    quality = pick(header, QUALITY_NAMES, options.quality_column)
    if tag is None:
        tag = _tags_by_content(rows, structure)
        if tag is not None and value is None:
            value = _values_by_content(source, rows, structure, header, tag, quality)
    if tag is None or value is None or tag == value:
        return None
    for option in ("tag_column", "value_column", "quality_column"):
        source.notes.use(option)
    return NarrowColumns(
        tag=tag,
        time=structure.time,
        value=value,
        quality=quality,
        unit=pick(header, UNIT_NAMES),
        description=pick(header, DESCRIPTION_NAMES),
        attribute=pick(header, ATTRIBUTE_NAMES),
    )


def _tags_by_content(rows: Rows, structure: Structure) -> int | None:
    """The column of a few repeated names that look like tags."""
    sample = _sample(rows, structure)
    for column in range(structure.width):
        if column in structure.time or column in structure.numeric:
            continue
        words = [row[column].strip() for row in sample]
        distinct = set(words)
        tags = all(
            "." in w or "_" in w or "/" in w or any(c.isdigit() for c in w) for w in distinct
        )
        if tags and 1 <= len(distinct) <= max(1, len(words) // 3):
            return column
    return None


def _values_by_content(
    source: LayoutInput,
    rows: Rows,
    structure: Structure,
    header: Sequence[str],
    tag: int,
    quality: int | None,
) -> int | None:
    """The one column of numbers beside the column ``tag``; ``None`` for a wide table with a column
    of names. Raises ``UnreadableSource`` where several may be it, and rows of one time but of
    different tags show that the table is narrow."""
    if len(structure.numeric) == 1 and structure.width <= 5:
        return structure.numeric[0]
    if not _rows_share_times(_sample(rows, structure), structure, tag):
        return None
    values = [column for column in structure.numeric if column != quality]
    if len(values) == 1:
        return values[0]
    names = ", ".join(repr(header[column]) for column in values[:6])
    raise UnreadableSource(
        f"{source.name}: each row is one sample of a tag of column {header[tag]!r}, and its value "
        f"may be in {names}; say which: value_column in the plant file or in Python, such as "
        f"value_column = {header[values[0]]!r}"
    )


def _sample(rows: Rows, structure: Structure) -> list[list[str]]:
    return [r for r in rows.cells[structure.first_row :][:2000] if len(r) == structure.width]


def _rows_share_times(sample: Sequence[list[str]], structure: Structure, tag: int) -> bool:
    """Whether most rows share their time with others, each of another tag."""
    tags_at: dict[tuple[str, ...], list[str]] = {}
    for row in sample:
        time = tuple(row[column].strip() for column in structure.time)
        tags_at.setdefault(time, []).append(row[tag].strip())
    shared = [tags for tags in tags_at.values() if len(tags) > 1]
    return all(len(set(tags)) == len(tags) for tags in shared) and 2 * sum(map(len, shared)) > len(
        sample
    )


def refuse_text(source: LayoutInput, rows: Rows, structure: Structure) -> None:
    """A table of words, such as a list of labels or a readme, is no recording."""
    if structure.time and structure.numeric:
        return
    sample = [r for r in rows.cells[structure.first_row :][:500] if len(r) == structure.width]
    cells = [cell for row in sample for cell in row if cell.strip()]
    numbers = sum(is_number(cell) for cell in cells)
    if structure.time:
        if numbers:
            return
        raise UnreadableSource(
            f"{source.name}: line {rows.numbers[structure.first_row]}: there are times but no "
            "column of numbers; expected at least one tag with values"
        )
    words = sum(
        not is_number(cell) and not is_time(cell) and text_quality(cell) is Quality.BAD
        for cell in cells
    )
    if len(sample) < 2:
        raise UnreadableSource(
            f"{source.name}: line {rows.numbers[structure.first_row]}: only one row of data was "
            "found; at least two are needed to tell the interval"
        )
    if words > 0.1 * len(cells):
        raise UnreadableSource(
            f"{source.name}: there is no time column and {words} of {len(cells)} cells are words "
            f"(such as {sample[0][0][:40]!r} in line {rows.numbers[structure.first_row]}); this is "
            "probably not a recording but a list or a text"
        )


LAYOUT = Generic()
