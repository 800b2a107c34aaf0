"""``SqlAddress``: a SQL historian as it travels to the worker that asks it."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from stemwatch.connectors.archive.secret import Secret
from stemwatch.connectors.historian.options import ReadOptions

if TYPE_CHECKING:
    from stemwatch.connectors.sql.connector import SqlArchive

CHUNK = 20_000
_SQLITE = "sqlite:///"


@dataclass(frozen=True, kw_only=True)
class SqlAddress:
    """Where a SQL historian is and how it is asked. Implements ``archive.ArchiveAddress``.

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

    def open(self) -> SqlArchive:
        """The archive; no connection is made yet."""
        from stemwatch.connectors.sql.connector import SqlArchive

        return SqlArchive(self)

    def __str__(self) -> str:
        return f"database {self.name}"


def beside(url: str, folder: Path) -> str:
    """``url`` with a relative SQLite path counted from ``folder``; any other as it is."""
    name = url.removeprefix(_SQLITE)
    if name == url or not name or name.startswith(("/", ":memory:", "file:")):
        return url
    return f"{_SQLITE}{(folder / name).as_posix()}"
