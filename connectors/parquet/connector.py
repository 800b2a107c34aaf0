"""``ParquetArchive``: a company's archive of Parquet files as a source of recordings."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from stemwatch.connectors.archive.settings import ArchiveSettings
from stemwatch.connectors.connector import (
    WHOLE,
    ArchiveAddress,
    ConnectorError,
    TagInfo,
    UnknownTag,
    ValveTags,
    Window,
    nearest_names,
)
from stemwatch.connectors.historian.options import ReadOptions
from stemwatch.connectors.parquet.catalog import ENDINGS
from stemwatch.connectors.settings import Name
from stemwatch.models.recording import Recording, Role

if TYPE_CHECKING:
    from stemwatch.connectors.archive.valve_columns import ValveColumns
    from stemwatch.connectors.historian.columns import Column

_DEFAULTS = ReadOptions()


@dataclass(frozen=True)
class ParquetAddress:
    """Where a Parquet archive is and how to read it. An ``ArchiveAddress``.

    ``before_s`` seconds before each window are read too, for tags that are written when they
    change.
    """

    path: str
    options: ReadOptions = field(default_factory=ReadOptions)
    before_s: float = 0.0

    def open(self) -> ParquetArchive:
        """The archive; nothing is read yet."""
        return ParquetArchive(self.path, self.options, before_s=self.before_s)

    def __str__(self) -> str:
        return self.path


class ParquetSettings(ArchiveSettings):
    """``kind = "parquet"``: a file, a folder, or a partitioned folder."""

    path: Annotated[str, Field(min_length=1)] = Field(
        description="a Parquet file, a folder of them or a pattern, relative to the plant file"
    )
    time_column: Name | None = Field(default=None, description="the name of the time column")
    tag_column: Name | None = Field(
        default=None, description="the name of the column, or folder key, of tags or valves"
    )
    value_column: Name | None = Field(default=None, description="the name of the value column")
    quality_column: Name | None = Field(default=None, description="the name of the quality column")
    ambiguous_hour: Literal["infer", "first", "second"] | None = Field(
        default=None, description='"infer", "first" (summer time) or "second" (standard time)'
    )
    missing_hour: Literal["shift", "leave_out"] | None = Field(
        default=None, description='"shift" (forward by an hour) or "leave_out"'
    )

    def address(self, folder: Path, zone: str | None) -> ArchiveAddress:
        """The address of the archive's files; a relative path counts from ``folder``."""
        path = self.path if "://" in self.path else str(folder / self.path)
        return ParquetAddress(path, self.read_options(zone), before_s=self.before_s or 0.0)


_WHY_NOT = {
    "encoding": "Parquet says its own",
    "separator": "Parquet has columns",
    "decimal": "the values are numbers",
    "good_quality": "there are no quality codes",
    "interval_s": "each row has its time",
    "day_first": "the times are no texts that can be read both ways",
    "time_format": "the times are no texts",
    "ambiguous_hour": "no local time is in the hour that autumn repeats",
    "missing_hour": "no local time is in the hour that spring skips",
}


class ParquetArchive:
    """One Parquet file, a folder of them, or a partitioned folder.

    Implements ``stemwatch.connectors.connector.Connector``. Three layouts are understood, told by
    the columns: a column for each tag; a row for each sample with tag, time, value and quality; a
    row for each instant of a valve with the columns op, mv, pv, sp, mode, whose tags are then
    ``VALVE.op`` and so on. Of ``options`` those that name columns, zone and good codes count.
    """

    settings = ParquetSettings

    def __init__(
        self,
        path: str | os.PathLike[str],
        options: ReadOptions = _DEFAULTS,
        *,
        before_s: float = 0.0,
    ) -> None:
        # Late: pyarrow is loaded where an archive is read, `stemwatch --help` does not need it.
        from stemwatch.connectors.parquet.catalog import Catalog

        self.path = os.fspath(path)
        self.options = options
        self.before_s = before_s
        self._catalog = Catalog(self.path)

    def tags(self) -> Sequence[TagInfo]:
        """Every tag with its unit, how many values it has where the footers say it (else 0), and
        a role where its name or column leaves no doubt."""
        from stemwatch.connectors.parquet.listing import list_tags

        return list_tags(self._catalog.files(), self.options, Path(self.path).stem)

    def names(self) -> list[str]:
        """Every tag, without looking at samples where the footers name them."""
        from stemwatch.connectors.parquet.reading import keys_in

        return list(keys_in(self._catalog.files(), self.options))

    def present(self, valve: ValveTags) -> ValveTags:
        """``valve`` without the roles beside OP and MV whose tag is not in the archive."""
        from stemwatch.connectors.archive.valve_columns import with_existing

        return with_existing(valve, lambda tags: {tag for tag in tags if self._has_tag(tag)})

    def read(self, valve: ValveTags, window: Window = WHOLE) -> Recording:
        """The recording of one valve, out of as many files as the window touches.

        Raises ``UnknownTag`` for a tag that no file has, ``ConnectorError`` for a window without
        samples of OP or local times without a zone, and ``UnreadableSource`` where the archive, or
        every file that the window touches, cannot be read.
        """
        from stemwatch.connectors.historian.recordings import assemble, need_op

        need_op(self.path, valve)
        return assemble(self._load(valve, window), valve, window)

    def _load(self, valve: ValveTags, window: Window) -> ValveColumns:
        from stemwatch.connectors.archive.valve_columns import (
            ValveColumns,
            bounds_of,
            need_samples,
        )
        from stemwatch.connectors.historian.reading_notes import ReadingNotes
        from stemwatch.connectors.historian.unused_options import say_unused
        from stemwatch.connectors.parquet.column_layout import WORDS
        from stemwatch.connectors.parquet.reading import column_of, read_pieces

        notes, bounds = ReadingNotes(), bounds_of(window, self.before_s)
        files = self._catalog.files()
        tags = list(dict.fromkeys(mapping.tag for mapping in valve.tags.values()))
        pieces = read_pieces(files, tags, bounds, self.options, notes)
        columns: dict[str, Column] = {}
        zone_is_known, zone = True, ""
        for role, mapping in valve.tags.items():
            if mapping.tag not in pieces:
                columns[mapping.tag] = self._empty(mapping.tag)
                continue
            columns[mapping.tag], instants = column_of(
                mapping.tag,
                pieces[mapping.tag],
                bounds,
                self.options,
                notes,
                self.path,
                as_mode=role is Role.MODE,
            )
            zone_is_known, zone = zone_is_known and instants.in_utc, zone or instants.zone
        op = valve.tags[Role.OP].tag

        def contents() -> str:
            return ". ".join([self._contents_of_tag(op), *notes.problems[:1]])

        need_samples(columns[op], window, self.path, contents)
        layouts = {file.layout(self.options).kind for file in files if file.is_open}
        for option in ("time_column", "tag_column", "value_column", "quality_column"):
            notes.use(option)  # a missing tag was reported as an error before
        say_unused(self.options, notes, _WHY_NOT | {"zone": zone.rstrip(".") or "no time is local"})
        return ValveColumns(
            source_name=self.path,
            layout="; ".join(WORDS[kind] for kind in sorted(layouts)),
            columns=columns,
            in_utc=zone_is_known,
            zone=zone,
            decisions=[*notes.decisions, *self._held_values()],
            unused_options=notes.unused,
            problems=notes.problems,
        )

    def _held_values(self) -> list[str]:
        """The sentence on values from before the window; none where none were read."""
        if not self.before_s:
            return []
        return [f"{self.before_s:g} s before the window were read for values that still held."]

    def _has_tag(self, tag: str) -> bool:
        from stemwatch.connectors.parquet.reading import place_of

        for file in self._catalog.files():
            try:
                layout = file.layout(self.options)
                tag_place = place_of(tag, layout)
                if tag_place and (tag_place.key is None or file.has_key(layout, tag_place.key)):
                    return True
            except ConnectorError:
                continue
        return False

    def _empty(self, tag: str) -> Column:
        """A tag without a row in the window. Raises ``UnknownTag`` where it never had one."""
        from stemwatch.connectors.archive.valve_columns import empty_column

        if self._has_tag(tag):
            return empty_column(tag)
        names = self.names()
        raise UnknownTag(
            f"{self.path}: there is no tag {tag!r} among {len(names)}; the nearest are "
            f"{nearest_names(tag, names)}"
        )

    def _contents_of_tag(self, tag: str) -> str:
        from stemwatch.connectors.parquet.listing import covered

        return covered(self._catalog.files(), tag, self.options)


def is_parquet(path: str | os.PathLike[str]) -> bool:
    """Whether a path names a Parquet file, or a folder with one in it and below."""
    location = Path(path)
    if location.is_file():
        return location.name.lower().endswith(ENDINGS)
    if not location.is_dir():
        return False
    return any(
        path.name.lower().endswith(ENDINGS) for path in location.rglob("*") if path.is_file()
    )


def split_archives(sources: Sequence[str]) -> tuple[list[str], list[str]]:
    """Split the sources that a user named into Parquet archives and possible text exports.

    A folder may hold both and is then in both lists; a pattern is taken by its ending.
    """
    archives = [
        source
        for source in sources
        if is_parquet(source) or (source.lower().endswith(ENDINGS) and not Path(source).exists())
    ]
    return archives, [
        source for source in sources if source not in archives or Path(source).is_dir()
    ]
