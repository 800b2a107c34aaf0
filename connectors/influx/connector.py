"""``InfluxArchive``: an InfluxDB as a source of recordings."""

from __future__ import annotations

import fnmatch
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Self

from pydantic import Field, model_validator

from stemwatch.connectors.archive.settings import HttpArchiveSettings
from stemwatch.connectors.connector import (
    WHOLE,
    ArchiveAddress,
    TagInfo,
    UnknownTag,
    ValveTags,
    Window,
    nearest_names,
)
from stemwatch.connectors.influx.query import InfluxServer
from stemwatch.connectors.settings import Name, contradiction
from stemwatch.models.recording import Recording, Role

if TYPE_CHECKING:
    from stemwatch.connectors.historian.columns import Column
    from stemwatch.connectors.influx.query import InfluxQuery

LAYOUT = "InfluxDB, points of a tag through InfluxQL"
ZONE = "The server gives instants in UTC."
_URL = "the address of an InfluxDB such as https://host:8086"


@dataclass(frozen=True, kw_only=True)
class InfluxAddress(InfluxServer):
    """A server, as it is sent to the worker that reads it; an ``ArchiveAddress``."""

    before_s: float = 0.0
    pattern: str = "*"
    good: tuple[str, ...] = ()

    def open(self) -> InfluxArchive:
        """The archive; no connection is made yet."""
        return InfluxArchive(self)


class InfluxSettings(HttpArchiveSettings):
    """``kind = "influx"``: fields of an InfluxDB 2 or 3."""

    url: Name = Field(description=_URL)
    database: Name = Field(description="the name of the database, or of the bucket")
    measurement: Name | None = Field(
        default=None, description="the measurement; without it each tag is one of its own"
    )
    tag_key: Name | None = Field(
        default=None, description="the Influx tag that holds the name of the plant's tag"
    )
    field: Name = Field(default="value", description="the field that holds the value")
    quality_field: Name | None = Field(
        default=None, description="the field that holds the quality code"
    )
    page: Annotated[int, Field(ge=100, le=1_000_000)] = Field(
        default=50_000, description="values of a tag asked for at a time, 100 to 1000000"
    )
    pattern: Name = Field(default="*", description="names of the tags that are listed, such as F*")

    @model_validator(mode="after")
    def _complete(self) -> Self:
        self.check_url(_URL)
        if self.tag_key and not self.measurement:
            raise contradiction(("tag_key",), "tag_key alone", "measurement as well")
        if self.secrets_named > 1:
            raise contradiction(("secret_file",), "two places", "secret_variable or secret_file")
        if self.secrets_named:
            self.check_encrypted("token")
        return self

    def address(self, folder: Path, zone: str | None) -> ArchiveAddress:
        """Of the server; files count from ``folder``. Times are UTC, so that no zone is needed."""
        return InfluxAddress(
            url=self.url,
            database=self.database,
            measurement=self.measurement or "",
            tag_key=self.tag_key or "",
            value_field=self.field,
            quality_field=self.quality_field or "",
            secret=self.secret(folder),
            authority=self.authority_file(folder),
            timeout_s=self.timeout_s,
            page=self.page,
            before_s=self.before_s or 0.0,
            pattern=self.pattern,
            good=tuple(self.good_quality or ()),
        )


class InfluxArchive:
    """An InfluxDB; implements ``stemwatch.connectors.connector.Connector``."""

    settings = InfluxSettings

    def __init__(self, address: InfluxAddress) -> None:
        self.address = address

    def tags(self) -> Sequence[TagInfo]:
        """Every tag that fits the address's pattern, with role and valve proposed from its name;
        samples are not counted."""
        from stemwatch.connectors.historian.tags.roles import propose_roles
        from stemwatch.connectors.influx.query import connected

        with connected(self.address) as query:
            names = fnmatch.filter(query.tags(), self.address.pattern)
        tags = [(name, "", "", None) for name in names]
        return [tag.info() for tag in propose_roles(tags, stem="", mv_is_output=False)]

    def present(self, valve: ValveTags) -> ValveTags:
        """``valve`` without the roles beside OP and MV whose tag the archive does not have."""
        from stemwatch.connectors.archive.valve_columns import with_existing
        from stemwatch.connectors.influx.query import connected

        def existing(_: frozenset[str]) -> set[str]:
            with connected(self.address) as query:
                return set(query.tags())

        return with_existing(valve, existing)

    def read(self, valve: ValveTags, window: Window = WHOLE) -> Recording:
        """The recording of one valve, tag by tag.

        Raises ``UnknownTag`` for a tag that is not there, and ``ConnectorError`` for a window
        without values of OP, and a server that does not answer.
        """
        from stemwatch.connectors.archive.valve_columns import recording_of_columns
        from stemwatch.connectors.historian.recordings import need_op
        from stemwatch.connectors.influx.query import connected

        server = str(self.address)
        need_op(server, valve)
        with connected(self.address) as query:
            columns = {
                mapping.tag: self._column(query, mapping.tag, role, window)
                for role, mapping in valve.tags.items()
            }
        return recording_of_columns(server, LAYOUT, ZONE, columns, valve, window)

    def _column(self, query: InfluxQuery, tag: str, role: Role, window: Window) -> Column:
        import numpy as np

        from stemwatch.connectors.archive.number_column import Codes, number_column
        from stemwatch.connectors.archive.valve_columns import bounds_of, empty_column

        rows = query.points(tag, *bounds_of(window, self.address.before_s))
        if not rows.ns.size:
            self._need(query, tag)
            return empty_column(tag)
        codes = None
        if rows.codes:
            words, index = np.unique(np.array(rows.codes), return_inverse=True)
            good = self.address.good
            codes = Codes(words=words.tolist(), index=index.astype(np.int64), good=good)
        return number_column(
            tag,
            rows.ns,
            np.ones(rows.ns.size, dtype=bool),
            rows.values,
            source_name=str(self.address),
            codes=codes,
            as_mode=role is Role.MODE,
        )

    def _need(self, query: InfluxQuery, tag: str) -> None:
        """Raise ``UnknownTag`` with the names that come nearest, where there is no such tag."""
        known = query.tags()
        if tag in known:
            return
        names = nearest_names(tag, known) or "none: nothing is there"
        raise UnknownTag(f"{self.address}: there is no {tag!r}; the nearest are {names}")
