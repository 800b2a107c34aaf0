"""``OpenedFile``: one file read once; its tags are converted when they are asked for."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from stemwatch.connectors.connector import UnreadableSource
from stemwatch.connectors.historian.layouts import parse_source
from stemwatch.connectors.historian.options import ReadOptions
from stemwatch.connectors.historian.reading_notes import ReadingNotes
from stemwatch.connectors.historian.tables.document import open_document
from stemwatch.connectors.historian.tables.layout_input import LayoutInput
from stemwatch.connectors.historian.tables.raw_table import RawColumn, RawTable
from stemwatch.connectors.historian.tags.roles import Candidate, propose_roles
from stemwatch.connectors.historian.tags.tag_names import parse_tag
from stemwatch.connectors.historian.times.time_column import Instants, read_instants
from stemwatch.connectors.historian.values.columns import Column, convert, own_interval_s
from stemwatch.connectors.historian.values.numbers import decide_decimal
from stemwatch.models.recording import Role


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
    _roles: list[Candidate] | None = None

    @property
    def where(self) -> str:
        """The path, for messages."""
        return str(self.path)

    @property
    def names(self) -> list[str]:
        """Every tag, in the file's order."""
        return [column.tag for column in self.table.columns]

    @property
    def known(self) -> bool:
        """Whether the times are instants in UTC."""
        return self.instants.known

    @property
    def zone(self) -> str:
        """How times became UTC, in one sentence."""
        return self.instants.zone

    @property
    def layout(self) -> str:
        """The layout in words."""
        return self.table.layout

    @property
    def decisions(self) -> list[str]:
        """What the reader decided."""
        return self.notes.decisions

    @property
    def problems(self) -> list[str]:
        """What it had to leave out."""
        return self.notes.problems

    def column(self, tag: str, *, as_mode: bool = False) -> Column:
        """The tag's samples. Raises ``KeyError`` for a tag that is not there."""
        key = (tag, as_mode)
        if key not in self._columns:
            raw = next((c for c in self.table.columns if c.tag == tag), None)
            if raw is None:
                raise KeyError(tag)
            self._columns[key] = convert(
                raw,
                self.instants,
                decimal=self.decimal,
                good=self.options.good_quality,
                name=str(self.path),
                lines=self.table.numbers,
                as_mode=as_mode,
            )
        return self._columns[key]

    def roles(self) -> list[Candidate]:
        """A candidate for each tag, in the file's order."""
        if self._roles is None:
            named = [(c.tag, c.unit, c.description, self._own(c)) for c in self.table.columns]
            stem = self.path.name.removesuffix(".gz").rsplit(".", 1)[0]
            self._roles = propose_roles(named, stem=stem, mv_is_output=self.table.mv_is_output)
        return self._roles

    def _own(self, raw: RawColumn) -> float | None:
        command = parse_tag(raw.tag).role in (Role.OP, Role.SP, Role.MODE)
        return own_interval_s(self.column(raw.tag), command=command)


def open_file(path: Path, options: ReadOptions) -> OpenedFile:
    """Read and understand the file at ``path``, once.

    Raises ``UnreadableSource`` where it is not there, not text, or not a table of samples.
    """
    notes = ReadingNotes()
    document = open_document(path, options.encoding, notes)
    table = parse_source(LayoutInput(document, options, notes))
    if not table.columns or not table.numbers:
        raise UnreadableSource(
            f"{path}: {len(table.columns)} tags and {len(table.numbers)} rows were found; expected "
            "at least one tag with values"
        )
    decimal = _decimal(table, options, str(path), notes)
    instants = read_instants(table, options, str(path), notes)
    opened = OpenedFile(
        path=path,
        options=options,
        digest=document.digest,
        encoding=document.encoding,
        table=table,
        instants=instants,
        decimal=decimal,
        notes=notes,
    )
    if not any(np.isfinite(opened.column(c.tag).values).any() for c in table.columns):
        _refuse_empty(opened)
    return opened


def _decimal(table: RawTable, options: ReadOptions, name: str, notes: ReadingNotes) -> str:
    if options.decimal is not None:
        return options.decimal
    if table.decimal is not None:
        return table.decimal
    mark, why = decide_decimal((c.cells for c in table.columns), table.separator, name)
    notes.decide(why)
    return mark


def _refuse_empty(opened: OpenedFile) -> None:
    """Not one number in any tag: the reader has not understood the file, or there is nothing."""
    first = opened.table.columns[0]
    shown = next((cell for cell in first.cells if cell.strip()), "")
    raise UnreadableSource(
        f"{opened.path}: none of the {len(opened.table.columns)} tags has a number that can be "
        f"used; {first.tag!r} begins with {shown[:40]!r}. Check separator and decimal mark, and "
        "that the export holds values"
    )
