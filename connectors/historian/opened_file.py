"""``OpenedFile``: one file read once; its tags are converted when they are asked for."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import accumulate
from pathlib import Path

import numpy as np

from stemwatch.connectors.connector import UnreadableSource
from stemwatch.connectors.historian.columns import (
    Column,
    at_times,
    convert,
    own_interval_s,
)
from stemwatch.connectors.historian.layouts import parse_source
from stemwatch.connectors.historian.options import ReadOptions
from stemwatch.connectors.historian.raw_table import RawColumn, RawTable
from stemwatch.connectors.historian.reading_notes import ReadingNotes
from stemwatch.connectors.historian.tables.document import open_document
from stemwatch.connectors.historian.tables.large_file import large_input
from stemwatch.connectors.historian.tables.layout_input import LayoutInput
from stemwatch.connectors.historian.tables.text_pieces import NotInPieces
from stemwatch.connectors.historian.tags.roles import Candidate, propose_roles
from stemwatch.connectors.historian.tags.tag_names import parse_tag
from stemwatch.connectors.historian.times.instants import Instants
from stemwatch.connectors.historian.times.time_column import read_instants
from stemwatch.connectors.historian.times.timeline import Timeline
from stemwatch.connectors.historian.unused_options import say_unused, why_not_in_text
from stemwatch.connectors.historian.values.decimal_mark import decide_decimal
from stemwatch.connectors.historian.values.stored_text import StoredText, has_been_read
from stemwatch.models.recording import Role

_NUMBERS_AT_ONCE = 8_000_000  # numbers that one pass over a large file reads; as texts about 160 MB
_NUMBERS_KEPT = 12_000_000  # numbers of converted columns, about 30 bytes each


@dataclass
class OpenedFile:
    """The parsed table, its times, and the columns converted so far."""

    path: Path
    options: ReadOptions
    digest: str
    encoding: str
    table: RawTable
    instants: Instants
    decimal: str
    notes: ReadingNotes
    _columns: dict[tuple[str, bool], Column] = field(default_factory=dict)
    _times: Timeline | None = None  # of the tag that was converted last
    _all: bool = False  # used when every tag is inspected in turn
    _roles: list[Candidate] | None = None

    @property
    def source_name(self) -> str:
        """The path, for messages."""
        return str(self.path)

    @property
    def names(self) -> list[str]:
        """Every tag, in the file's order."""
        return [column.tag for column in self.table.columns]

    @property
    def in_utc(self) -> bool:
        """Whether the times are instants in UTC."""
        return self.instants.in_utc

    @property
    def zone(self) -> str:
        """How times became UTC, in one sentence."""
        return self.instants.zone

    @property
    def layout(self) -> str:
        """Which layout the file was taken for, in words."""
        return self.table.layout

    @property
    def decisions(self) -> list[str]:
        """What the reader decided."""
        return self.notes.decisions

    @property
    def unused_options(self) -> dict[str, str]:
        """The options that made no difference, each with its sentence."""
        return self.notes.unused

    @property
    def problems(self) -> list[str]:
        """What it had to leave out."""
        return self.notes.problems

    def column(self, tag: str, *, as_mode: bool = False) -> Column:
        """The tag's samples. Raises ``KeyError`` for a tag that is not there."""
        key = (tag, as_mode)
        if key not in self._columns:
            raw = self._by_tag[tag]
            if self._all:
                self._read_following(raw)
            elif self.in_pieces:
                self._read([raw])
            column = convert(
                raw,
                self.instants,
                decimal=self.decimal,
                good=self.options.good_quality,
                name=str(self.path),
                lines=self.table.numbers,
                as_mode=as_mode,
            )
            self._columns[key] = at_times(column, self._times)
            self._times = self._columns[key].times
            self._forget(raw)
        return self._columns[key]

    @cached_property
    def in_pieces(self) -> bool:
        """Whether the cells stay in the file until they are asked for."""
        return any(isinstance(column.cells, StoredText) for column in self.table.columns)

    @cached_property
    def _column_index_by_tag(self) -> dict[str, int]:
        return {column.tag: index for index, column in enumerate(self.table.columns)}

    @cached_property
    def _by_tag(self) -> dict[str, RawColumn]:
        return {column.tag: column for column in reversed(self.table.columns)}

    def read_ahead(self, tags: Iterable[str]) -> None:
        """Read these tags in one pass over the file, where it is read in pieces."""
        if self.in_pieces:
            self._read([self._by_tag[tag] for tag in tags if (tag, False) not in self._columns])

    def expect(self, tags: Sequence[str] | None) -> None:
        """Announce the tags that will be requested (``None``: all), so that the first pass reads
        them too."""
        self._all = self._all or tags is None
        self.read_ahead(self.known(tags or ()))

    def known(self, tags: Iterable[str]) -> list[str]:
        """Those of the tags that are there."""
        return [tag for tag in tags if tag in self._by_tag]

    def _read_following(self, raw: RawColumn) -> None:
        """Read this column and, in the same pass, as many after it as need little memory."""
        if not self.in_pieces or has_been_read(raw.cells):
            return
        self._read(_at_once(self.table.columns[self._column_index_by_tag[raw.tag] :]))

    def _read(self, columns: Sequence[RawColumn]) -> None:
        """Numbers, quality codes and marks of held values of these in one pass."""
        numbers = _in_file(columns)
        extra_cells = [cells for column in columns for cells in (column.quality_codes, column.held)]
        texts = [c for c in extra_cells if isinstance(c, StoredText) and c.codes is None]
        if numbers:
            numbers[0].columns.read(numbers, texts, self.decimal)

    def _forget(self, raw: RawColumn) -> None:
        """Keep no text of a column that is converted, and of large files few columns."""
        if not self.in_pieces:
            return
        for cells in (raw.cells, raw.quality_codes, raw.held):
            if isinstance(cells, StoredText):
                cells.forget()
        while len(self._columns) * len(raw.cells) > _NUMBERS_KEPT and len(self._columns) > 1:
            del self._columns[next(iter(self._columns))]

    def roles(self) -> list[Candidate]:
        """A candidate for each tag, in the file's order."""
        self._all = True
        if self._roles is None:
            named = [
                (c.tag, c.unit, c.description, self._own_interval_s(c)) for c in self.table.columns
            ]
            stem = self.path.name.removesuffix(".gz").rsplit(".", 1)[0]
            self._roles = propose_roles(named, stem=stem, mv_is_output=self.table.mv_is_output)
        return self._roles

    def _own_interval_s(self, raw: RawColumn) -> float | None:
        command = parse_tag(raw.tag).role in (Role.OP, Role.SP, Role.MODE)
        return own_interval_s(self.column(raw.tag), command=command)


def open_file(path: Path, options: ReadOptions, wanted: Sequence[str] | None = ()) -> OpenedFile:
    """Read and understand the file at ``path``, once; ``wanted`` tags will be asked for, or with
    ``None`` all.

    Raises ``UnreadableSource`` where it is not there, not text, or not a table of samples.
    """
    large = large_input(path, options)
    if large is not None:
        try:
            return _opened(large, parse_source(large), wanted)
        except NotInPieces:
            pass
    notes = ReadingNotes()
    document = open_document(path, options.encoding, notes)
    source = LayoutInput(document, options, notes)
    return _opened(source, parse_source(source), wanted)


def _opened(source: LayoutInput, table: RawTable, wanted: Sequence[str] | None) -> OpenedFile:
    options, notes = source.options, source.notes
    if not table.columns or not table.numbers:
        raise UnreadableSource(
            f"{source.name}: {len(table.columns)} tags and {len(table.numbers)} rows were found; "
            "expected at least one tag with values"
        )
    decimal = _decimal(table, options, source.name, notes)
    first = _in_file(_at_once([c for c in table.columns if wanted is None or c.tag in wanted]))
    if first:
        first[0].columns.read_next(first, decimal)  # read in the same pass as the times
    opened = OpenedFile(
        path=source.document.path,
        options=options,
        digest=source.document.digest,
        encoding=source.document.encoding,
        table=table,
        instants=read_instants(table, options, source.name, notes),
        decimal=decimal,
        notes=notes,
    )
    _mark_used(opened, source.options)
    say_unused(options, notes, why_not_in_text(table, opened.instants))
    opened.expect(wanted)
    order = [*opened.known(wanted or ()), *opened.names]
    if not any(np.isfinite(opened.column(tag).values).any() for tag in order):
        _refuse_empty(opened)
    return opened


def _at_once(columns: Sequence[RawColumn]) -> list[RawColumn]:
    """The first of the columns, and as many after it as need little memory together."""
    cells = list(accumulate(len(column.cells) for column in columns))
    return list(columns[: max(1, bisect_right(cells, _NUMBERS_AT_ONCE))])


def _in_file(columns: Sequence[RawColumn]) -> list[StoredText]:
    return [column.cells for column in columns if isinstance(column.cells, StoredText)]


def _mark_used(opened: OpenedFile, options: ReadOptions) -> None:
    """Mark the options that were used, as far as the result shows it."""
    table, used = opened.table, opened.notes.used
    used.add("encoding")
    if any(column.quality_codes is not None for column in table.columns):
        used.add("good_quality")
    if options.separator == table.separator:
        used.add("separator")
    if (options.time_column or "").strip().lower() == table.times.name.strip().lower():
        used.add("time_column")


def _decimal(table: RawTable, options: ReadOptions, name: str, notes: ReadingNotes) -> str:
    if options.decimal is not None:
        notes.use("decimal")
        return options.decimal
    if table.decimal is not None:
        return table.decimal
    mark, reasoning = decide_decimal((c.cells for c in table.columns), table.separator, name)
    notes.decide(reasoning)
    return mark


def _refuse_empty(opened: OpenedFile) -> None:
    """Raise where no tag has a number: the file was misread, or it has no data."""
    first = opened.table.columns[0]
    example = next((cell for cell in first.cells if cell.strip()), "")
    raise UnreadableSource(
        f"{opened.path}: none of the {len(opened.table.columns)} tags has a number that can be "
        f"used; {first.tag!r} begins with {example[:40]!r}. Check separator and decimal mark, and "
        "that the export holds values"
    )
