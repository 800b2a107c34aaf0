"""``SqlArchive``: a historian in a database as a source of recordings."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Self
from zoneinfo import ZoneInfo

from pydantic import Field, model_validator

from stemwatch.connectors.archive.settings import ArchiveSettings
from stemwatch.connectors.connector import (
    WHOLE,
    ArchiveAddress,
    ConnectorError,
    TagInfo,
    UnknownTag,
    UnreadableSource,
    ValveTags,
    Window,
    nearest_names,
)
from stemwatch.connectors.historian.options import ReadOptions
from stemwatch.connectors.secret import Secret
from stemwatch.connectors.settings import Duration, Name, NotEmpty, contradiction
from stemwatch.connectors.sql.query_rows import mistake_in
from stemwatch.models.recording import Recording, Role

if TYPE_CHECKING:
    from sqlalchemy import Connection

    from stemwatch.connectors.archive.valve_columns import ValveColumns
    from stemwatch.connectors.historian.columns import Column
    from stemwatch.connectors.historian.reading_notes import ReadingNotes
    from stemwatch.connectors.historian.times.instants import Instants
    from stemwatch.connectors.sql.database import Database
    from stemwatch.connectors.sql.query_rows import Samples

LAYOUT = "a query for each tag"
CHUNK = 20_000
TIMEOUT_S = 120.0
_SQLITE = "sqlite:///"
_URL = "a database URL such as postgresql://user@host/database"
_FIRST, _LAST = datetime(1970, 1, 2, tzinfo=UTC), datetime(2262, 1, 1, tzinfo=UTC)


@dataclass(frozen=True, kw_only=True)
class SqlAddress:
    """Where a SQL historian is and how it is asked. An ``ArchiveAddress``.

    ``query`` selects time, value and perhaps quality for ``:tag`` from ``:start`` (inclusive) to
    ``:end`` (exclusive). ``tags_query`` selects tag and perhaps unit and samples of all tags.
    ``bounds_format`` is the strftime format of the bounds, for times that are kept as text.
    """

    name: str
    url: Secret
    query: str
    tags_query: str = ""
    options: ReadOptions = field(default_factory=ReadOptions)
    before_s: float = 0.0
    bounds_format: str = ""
    chunk: int = CHUNK
    timeout_s: float = TIMEOUT_S

    def open(self) -> SqlArchive:
        """The archive; no connection is made yet."""
        return SqlArchive(self)

    def __str__(self) -> str:
        return f"database {self.name}"


def url_in_folder(url: str, folder: Path) -> str:
    """``url`` with a relative SQLite path counted from ``folder``; any other as it is."""
    name = url.removeprefix(_SQLITE)
    if name == url or not name or name.startswith(("/", ":memory:", "file:")):
        return url
    return f"{_SQLITE}{(folder / name).as_posix()}"


class SqlSettings(ArchiveSettings):
    """``kind = "sql"``: a database that is asked with a query of the user's own."""

    url: NotEmpty | None = Field(default=None, description=_URL)
    url_variable: Name | None = Field(
        default=None, description="the name of the environment variable that holds the URL"
    )
    query: NotEmpty = Field(
        description="one SELECT of time, value and perhaps quality, with :tag, :start and :end"
    )
    tags_query: NotEmpty | None = Field(
        default=None, description="one SELECT of tag and perhaps unit, which lists all tags"
    )
    bounds_format: Name | None = Field(
        default=None,
        description="how :start and :end are written, where times are kept as text, such as "
        "%Y-%m-%dT%H:%M:%S",
    )
    ambiguous_hour: Literal["infer", "first", "second"] | None = Field(
        default=None, description='"infer", "first" (summer time) or "second" (standard time)'
    )
    missing_hour: Literal["shift", "leave_out"] | None = Field(
        default=None, description='"shift" (forward by an hour) or "leave_out"'
    )
    timeout_s: Duration = Field(default=TIMEOUT_S, description="seconds, above 0")

    @model_validator(mode="after")
    def _one_url(self) -> Self:
        if (self.url is None) == (self.url_variable is None):
            found_text = "nothing" if self.url is None else "both url and url_variable"
            raise contradiction(("url",), found_text, f"{_URL}; or url_variable instead")
        return self

    @model_validator(mode="after")
    def _only_reads(self) -> Self:
        for key, query in (("query", self.query), ("tags_query", self.tags_query)):
            if query is not None and (fault := mistake_in(query, with_tag=key == "query")):
                raise contradiction((key,), fault.found, fault.expected)
        return self

    def address(self, folder: Path, zone: str | None) -> ArchiveAddress:
        """Of the database; a path in a SQLite URL counts from ``folder``."""
        url = (
            Secret(text=url_in_folder(self.url, folder))
            if self.url
            else Secret(variable=self.url_variable or "")
        )
        return SqlAddress(
            name=self.name,
            url=url,
            query=self.query,
            tags_query=self.tags_query or "",
            bounds_format=self.bounds_format or "",
            options=self.read_options(zone),
            before_s=0.0 if self.before_s is None else self.before_s,
            timeout_s=self.timeout_s,
        )


class SqlArchive:
    """A database behind a query template; implements ``stemwatch.connectors.connector.Connector``.

    Raises ``UnreadableSource`` for a template that is not one SELECT with the right parameters.
    """

    settings = SqlSettings

    def __init__(self, address: SqlAddress) -> None:
        self.address = address
        for text, with_tag in ((address.query, True), (address.tags_query, False)):
            if text and (fault := mistake_in(text, with_tag=with_tag)):
                raise UnreadableSource(
                    f"{address}: the query cannot be used: found {fault.found}; expected "
                    f"{fault.expected}"
                )

    @cached_property
    def _database(self) -> Database:
        from stemwatch.connectors.sql.database import Database

        address = self.address
        return Database(address.url, str(address), address.timeout_s, address.options.zone)

    def tags(self) -> Sequence[TagInfo]:
        """What the query of tags lists, with unit and samples where it gives them, and with role
        and valve proposed from its name; nothing where no such query was given."""
        if not self.address.tags_query:
            return []
        from stemwatch.connectors.historian.tags.roles import propose_roles
        from stemwatch.connectors.sql.database import run_query

        with self._database.reading() as connection:
            names, parts = run_query(connection, self.address.tags_query, {}, self.address.chunk)
            lower = [name.lower() for name in names]
            column_index = {
                key: lower.index(key) for key in ("tag", "unit", "samples") if key in lower
            }
            column_index.setdefault("tag", 0)
            rows = [row for part in parts for row in part]
        listed = [row for row in rows if row[column_index["tag"]] is not None]
        tags = [
            (
                str(row[column_index["tag"]]),
                str(row[column_index["unit"]] or "") if "unit" in column_index else "",
                "",
                None,
            )
            for row in listed
        ]
        return [
            proposed.info(_count(row[column_index["samples"]]) if "samples" in column_index else 0)
            for row, proposed in zip(
                listed, propose_roles(tags, stem="", mv_is_output=False), strict=True
            )
        ]

    def present(self, valve: ValveTags) -> ValveTags:
        """``valve`` without the roles beside OP and MV whose tag was never archived."""
        from stemwatch.connectors.archive.valve_columns import with_existing

        def existing(optional: frozenset[str]) -> set[str]:
            with self._database.reading() as connection:
                return {tag for tag in optional if self._has_tag(connection, tag)}

        return with_existing(valve, existing)

    def read(self, valve: ValveTags, window: Window = WHOLE) -> Recording:
        """The recording of one valve: one query for each tag, in one read-only transaction.

        Raises ``UnknownTag`` for a tag without a row at any time, and ``ConnectorError`` for a
        window without samples of OP, local times without a zone, and a database that does not
        answer.
        """
        from stemwatch.connectors.historian.recordings import assemble, need_op

        need_op(str(self.address), valve)
        with self._database.reading() as connection:
            loaded = self._load(connection, valve, window)
        return assemble(loaded, valve, window)

    def _load(self, connection: Connection, valve: ValveTags, window: Window) -> ValveColumns:
        from stemwatch.connectors.archive.valve_columns import ValveColumns, need_samples
        from stemwatch.connectors.historian.reading_notes import ReadingNotes

        notes, columns = ReadingNotes(), {}
        zone_is_known, zone = True, ""
        for role, mapping in valve.tags.items():
            column, instants = self._column(connection, mapping.tag, role, window, notes)
            columns[mapping.tag] = column
            if instants is not None:
                zone_is_known, zone = zone_is_known and instants.in_utc, zone or instants.zone
        asked = f"the query was asked from {self._window_text(window)}"
        op = columns[valve.tags[Role.OP].tag]
        need_samples(op, window, str(self.address), lambda: asked)
        if not self._database.only_reads:
            notes.decide(
                f"{self._database.dialect} knows no read-only transaction; the query is one "
                "SELECT, but let the account that asks have no right to write."
            )
        return ValveColumns(
            source_name=str(self.address),
            layout=LAYOUT,
            columns=columns,
            in_utc=zone_is_known,
            zone=zone,
            decisions=notes.decisions,
            problems=notes.problems,
        )

    def _column(
        self, connection: Connection, tag: str, role: Role, window: Window, notes: ReadingNotes
    ) -> tuple[Column, Instants | None]:
        from stemwatch.connectors.archive.valve_columns import (
            bounds_of,
            empty_column,
            within_bounds,
        )
        from stemwatch.connectors.sql.query_rows import column_of, instants_of

        samples = self._samples(connection, tag, window)
        if not samples.times:
            if not self._has_tag(connection, tag):
                raise self._unknown(tag)
            return empty_column(tag), None
        options, name = self.address.options, str(self.address)
        instants = instants_of(samples, options, name, notes)
        column = column_of(tag, samples, instants, options, name, "", as_mode=role is Role.MODE)
        if not instants.in_utc:
            return column, instants
        return within_bounds(column, bounds_of(window, self.address.before_s)), instants

    def _samples(self, connection: Connection, tag: str, window: Window) -> Samples:
        from stemwatch.connectors.sql.database import run_query
        from stemwatch.connectors.sql.query_rows import gathered

        parameters = {"tag": tag, **self._bounds(window)}
        names, parts = run_query(connection, self.address.query, parameters, self.address.chunk)
        samples = gathered(parts, names, str(self.address))
        self._check_texts(samples, parameters["start"])
        return samples

    def _bounds(self, window: Window) -> dict[str, Any]:
        """``start`` and ``end`` as the database compares them."""
        start = window.start
        if start is not None:
            start -= timedelta(seconds=self.address.before_s)
        return {
            "start": self._bound(start or _FIRST),
            "end": self._bound(window.stop or _LAST),
        }

    def _bound(self, instant: datetime) -> Any:
        """A bound as the database compares it: an instant, a local time of the given zone, or a
        text where times are kept as text."""
        zone, dialect = self.address.options.zone, self._database.dialect
        if dialect == "postgresql" and not self.address.bounds_format:
            return instant if zone is None else instant.astimezone(ZoneInfo(zone))
        local = instant.astimezone(UTC if zone is None else ZoneInfo(zone)).replace(tzinfo=None)
        if self.address.bounds_format:
            return local.strftime(self.address.bounds_format)
        return local.isoformat(sep=" ") if dialect == "sqlite" else local

    def _check_texts(self, samples: Samples, start: Any) -> None:
        """Check that bounds are written as the times are, since texts are compared by letters."""
        first = samples.times[0] if samples.times else None
        if not isinstance(first, str) or not isinstance(start, str):
            return
        shapes = [re.sub(r"\d", "0", text)[: len("2026-01-05 06:00:00")] for text in (first, start)]
        if shapes[0] != shapes[1]:
            raise ConnectorError(
                f"{self.address}: times are kept as texts such as {first!r}, but were compared "
                f"with {start!r}, so that rows would be lost; expected bounds written as the times "
                "are. Say bounds_format, such as %Y-%m-%dT%H:%M:%S, or convert in the query"
            )

    def _has_tag(self, connection: Connection, tag: str) -> bool:
        """Whether the tag has a row at any time; also checks how times are written."""
        from itertools import islice

        from stemwatch.connectors.sql.database import run_query
        from stemwatch.connectors.sql.query_rows import gathered

        parameters = {"tag": tag, **self._bounds(WHOLE)}
        names, parts = run_query(connection, self.address.query, parameters, 1)
        samples = gathered(islice(parts, 1), names, str(self.address))
        self._check_texts(samples, parameters["start"])
        return bool(samples.times)

    def _unknown(self, tag: str) -> UnknownTag:
        names = [info.tag for info in self.tags()]
        hint = (
            f"the nearest of {len(names)} are {nearest_names(tag, names)}"
            if names
            else "say tags_query, which lists the tags, and the nearest are shown here"
        )
        return UnknownTag(
            f"{self.address}: the query gives no sample of {tag!r} at any time; {hint}"
        )

    def _window_text(self, window: Window) -> str:
        return " to ".join(str(bound) for bound in self._bounds(window).values())


def _count(cell: Any) -> int:
    """How many samples a cell says; 0 where it says no number."""
    try:
        return int(cell)
    except (TypeError, ValueError, OverflowError):
        return 0
