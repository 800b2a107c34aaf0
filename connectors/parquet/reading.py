"""Reads a valve's tags in a window from all files of an archive into columns."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from stemwatch.connectors.archive.number_column import Codes, number_column
from stemwatch.connectors.archive.valve_columns import Bounds
from stemwatch.connectors.connector import UnreadableSource
from stemwatch.connectors.historian.columns import Column, convert
from stemwatch.connectors.historian.options import ReadOptions
from stemwatch.connectors.historian.raw_table import RawColumn
from stemwatch.connectors.historian.reading_notes import ReadingNotes
from stemwatch.connectors.historian.times.instants import Instants
from stemwatch.connectors.historian.values.units import canonical
from stemwatch.connectors.parquet.archive_file import ArchiveFile, as_floats
from stemwatch.connectors.parquet.catalog import may_hold
from stemwatch.connectors.parquet.column_layout import SEPARATORS, ColumnLayout, is_number
from stemwatch.connectors.parquet.timestamps import (
    Stamps,
    file_bounds,
    instants_in_utc,
    is_naive,
    read_stamps,
)
from stemwatch.models.recording import Bools

Number = TypeVar("Number", bound=np.generic)


@dataclass(frozen=True)
class TagPlace:
    """Where a file keeps a tag: the key its rows bear (``None``: every row) and the column."""

    key: str | None
    column: str


@dataclass
class TagPieces:
    """Rows of one tag, row group by row group."""

    stamps: list[Stamps] = field(default_factory=list)
    values: list[Any] = field(default_factory=list)  # Arrow, as the files have them
    codes: list[Any] = field(default_factory=list)  # Arrow or None, one for each of ``values``
    quality_name: str = "quality"
    unit: str = ""
    times_were_text: bool = False  # the times were texts or numbers


def place_of(tag: str, layout: ColumnLayout) -> TagPlace | None:
    """Where a file of this layout would keep ``tag``."""
    if layout.kind == "wide":
        return TagPlace(None, layout.values[tag]) if tag in layout.values else None
    if layout.kind == "narrow":
        column = next(iter(layout.values))
        if layout.key is None:
            return TagPlace(None, column) if tag == layout.fixed else None
        return TagPlace(tag, column)
    for ending, column in layout.values.items():
        for sign in SEPARATORS:
            if tag.lower().endswith(sign + ending.lower()) and len(tag) > len(ending) + 1:
                return TagPlace(tag[: -len(ending) - 1], column)
    return None


def read_pieces(
    files: Sequence[ArchiveFile],
    tags: Sequence[str],
    bounds: Bounds,
    options: ReadOptions,
    notes: ReadingNotes,
) -> dict[str, TagPieces]:
    """What ``files`` hold of ``tags`` between the bounds, in the files' order.

    A file that cannot be read is noted as a problem and costs the others nothing. Raises
    ``UnreadableSource`` where no file at all could be read.
    """
    pieces: dict[str, TagPieces] = {}
    files_read, broken = 0, []
    for file in files:
        if not may_hold(file.keys, bounds):
            continue
        files_read += 1
        try:
            _read_file(file, tags, bounds, options, notes, pieces)
        except UnreadableSource as error:
            broken.append(error)
            notes.problem(str(error))
    if broken and len(broken) == files_read:
        raise broken[0]
    return pieces


def _read_file(
    file: ArchiveFile,
    tags: Sequence[str],
    bounds: Bounds,
    options: ReadOptions,
    notes: ReadingNotes,
    pieces: dict[str, TagPieces],
) -> None:
    layout = file.layout(options)
    places = {tag: tag_place for tag in tags if (tag_place := place_of(tag, layout))}
    if not places:
        return
    naive = is_naive(file.fragment.physical_schema, layout.time)
    bounds_in_file = file_bounds(bounds, naive, options, file.path)
    keys = None if layout.key is None else sorted({str(p.key) for p in places.values()})
    groups = file.groups(layout)
    groups_to_read = groups.wanted(keys, bounds_in_file)
    mixed = [g for g in groups_to_read if groups.only(g) is None]
    columns = _columns(layout, places.values(), with_key=bool(mixed), file=file)
    for group, table in file.read(groups_to_read, columns, layout.key if mixed else None):
        stamps = read_stamps(table.column(layout.time), layout.time, options, file.path, notes)
        for tag, tag_place in places.items():
            rows = _rows(table, layout, tag_place, groups.only(group))
            if rows is not False:
                _add(pieces.setdefault(tag, TagPieces()), table, stamps, rows, layout, tag_place)


def _columns(layout: ColumnLayout, places: Any, *, with_key: bool, file: ArchiveFile) -> list[str]:
    names = [layout.time]
    for tag_place in places:
        names += [tag_place.column, layout.qualities.get(tag_place.column, "")]
    names.append(layout.unit_column or "")
    if with_key and layout.key is not None and layout.key not in file.keys:
        names.append(layout.key)
    return [name for name in dict.fromkeys(names) if name]


def _rows(table: Any, layout: ColumnLayout, tag_place: TagPlace, only: str | None) -> Bools | bool:
    """Which rows are the place's: all (True), none (False) or a mask."""
    if tag_place.key is None:
        return True
    if only is not None:
        return only == tag_place.key
    mask = rows_with(table.column(layout.key), tag_place.key)
    return mask if mask.any() else False


def rows_with(column: Any, key: str) -> Bools:
    """(n,) True where a column of texts, plain or as a dictionary, is ``key``."""
    import pyarrow as pa
    import pyarrow.compute as pc
    import pyarrow.types as kinds

    if not kinds.is_dictionary(column.type):
        is_tag = pc.equal(pc.cast(column, pa.string()), key)
        return np.asarray(pc.fill_null(is_tag, False).to_numpy().astype(bool))
    masks: list[Bools] = []
    for chunk in column.chunks:
        dictionary_index = pc.index(pc.cast(chunk.dictionary, pa.string()), key).as_py()
        is_tag = pc.fill_null(pc.equal(chunk.indices, dictionary_index), False)
        masks.append(is_tag.to_numpy(zero_copy_only=False).astype(bool))
    return np.concatenate(masks) if masks else np.zeros(0, dtype=bool)


def _add(
    pieces: TagPieces,
    table: Any,
    stamps: Stamps,
    rows: Bools | bool,
    layout: ColumnLayout,
    tag_place: TagPlace,
) -> None:
    import pyarrow as pa

    value = table.column(tag_place.column)
    quality = layout.qualities.get(tag_place.column)
    code = None if quality is None else table.column(quality)
    if not isinstance(rows, bool):
        keep = pa.array(rows)
        value = value.filter(keep)
        code = None if code is None else code.filter(keep)
        stamps = Stamps(ns=stamps.ns[rows], ok=stamps.ok[rows], naive=stamps.naive)
    pieces.values.append(value)
    pieces.codes.append(code)
    pieces.stamps.append(stamps)
    pieces.quality_name = quality or pieces.quality_name
    pieces.times_were_text = not str(table.schema.field(layout.time).type).startswith(
        ("timestamp", "date")
    )
    pieces.unit = pieces.unit or layout.units.get(tag_place.column, "")
    if not pieces.unit and layout.unit_column and len(value):
        units = table.column(layout.unit_column)
        first = units.filter(pa.array(rows))[0] if not isinstance(rows, bool) else units[0]
        pieces.unit = canonical(str(first.as_py() or ""))


def column_of(
    tag: str,
    pieces: TagPieces,
    bounds: Bounds,
    options: ReadOptions,
    notes: ReadingNotes,
    source_name: str,
    *,
    as_mode: bool,
) -> tuple[Column, Instants]:
    """The column of a tag between the bounds, and what is known of its times.

    Raises ``UnreadableSource`` where quality codes cannot be understood.
    """
    instants = _instants(pieces, options, notes)
    in_window = _in_window(instants, bounds)
    if not in_window.all():
        instants = replace(instants, ns=instants.ns[in_window], ok=instants.ok[in_window])
    codes = _codes(pieces, in_window, options)
    if codes is not None:
        notes.use("good_quality")
    if all(is_number(value.type) for value in pieces.values):
        values = _joined([as_floats(value) for value in pieces.values], in_window)
        column = number_column(
            tag,
            instants.ns,
            instants.ok,
            values,
            source_name=source_name,
            unit=pieces.unit,
            codes=codes,
            as_mode=as_mode,
        )
        return column, instants
    cells = [text for value in pieces.values for text in _texts(value)]
    raw = RawColumn(
        tag=tag,
        cells=[cells[row] for row in np.flatnonzero(in_window).tolist()],
        unit=pieces.unit,
        quality_codes=None if codes is None else [codes.words[i] for i in codes.index],
        quality_name=pieces.quality_name,
    )
    notes.use("decimal")
    decimal, good = options.decimal or ".", options.good_quality
    column = convert(raw, instants, decimal=decimal, good=good, name=source_name, as_mode=as_mode)
    return column, instants


def _instants(pieces: TagPieces, options: ReadOptions, notes: ReadingNotes) -> Instants:
    stamps = Stamps(
        ns=_joined([stamp.ns for stamp in pieces.stamps]),
        ok=_joined([stamp.ok for stamp in pieces.stamps]),
        naive=any(stamp.naive for stamp in pieces.stamps),
    )
    return instants_in_utc(stamps, pieces.times_were_text, options, notes)


def _joined(parts: Sequence[NDArray[Number]], keep: Bools | None = None) -> NDArray[Number]:
    """The parts in one, or what ``keep`` leaves of it; a single part that is kept is not copied."""
    values = parts[0] if len(parts) == 1 else np.concatenate(parts)
    return values if keep is None or keep.all() else values[keep]


def _in_window(instants: Instants, bounds: Bounds) -> Bools:
    start, stop = bounds
    in_window = np.ones(instants.ns.size, dtype=bool)
    if start is not None:
        in_window &= instants.ns >= start
    if stop is not None:
        in_window &= instants.ns < stop
    return in_window


def _codes(pieces: TagPieces, in_window: Bools, options: ReadOptions) -> Codes | None:
    """Quality codes of all pieces; an empty one where a piece has none."""
    if all(code is None for code in pieces.codes):
        return None
    words: dict[str, int] = {"": 0}
    parts = [
        np.zeros(len(value), dtype=np.int64) if code is None else _encoded(code, words)
        for value, code in zip(pieces.values, pieces.codes, strict=True)
    ]
    index = np.concatenate(parts)[in_window]
    used = np.unique(index)
    used_words = [word for word, number in words.items() if number in set(used.tolist())]
    return Codes(
        words=used_words,
        index=np.searchsorted(used, index),
        name=pieces.quality_name,
        good=options.good_quality,
    )


def _encoded(code: Any, words: dict[str, int]) -> NDArray[np.int64]:
    """(n,) numbers in ``words`` of a column of codes; new ones are added to it."""
    import pyarrow.compute as pc
    import pyarrow.types as kinds

    if not kinds.is_dictionary(code.type):
        code = pc.dictionary_encode(code)
    parts = []
    for chunk in code.chunks:
        number_of_word = [
            words.setdefault(_word(entry), len(words)) for entry in chunk.dictionary.to_pylist()
        ]
        word_index = pc.fill_null(chunk.indices, len(number_of_word)).to_numpy(zero_copy_only=False)
        parts.append(np.array([*number_of_word, 0], dtype=np.int64)[word_index])
    return np.concatenate(parts) if parts else np.zeros(0, dtype=np.int64)


def _word(code: object) -> str:
    return "" if code is None else str(code).strip()


def _texts(array: Any) -> Iterator[str]:
    return ("" if cell is None else str(cell) for cell in array.to_pylist())


def keys_in(files: Sequence[ArchiveFile], options: ReadOptions) -> Mapping[str, None]:
    """Every tag of the archive, in the files' order. Files that cannot be read are left out."""
    tags: dict[str, None] = {}
    for file in files:
        try:
            layout = file.layout(options)
            keys = file.key_values(layout)
        except UnreadableSource:
            continue
        tags |= dict.fromkeys(tags_of(layout, keys))
    return tags


def tags_of(layout: ColumnLayout, keys: Sequence[str]) -> list[str]:
    """The tags of a file whose key column holds ``keys``."""
    if layout.kind == "wide":
        return list(layout.values)
    if layout.kind == "narrow":
        return [layout.fixed] if layout.key is None else list(keys)
    return [f"{key}.{ending}" for key in keys for ending in layout.values]
