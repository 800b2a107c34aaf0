"""``HistorianFile``: the connector for one text export of a historian."""

from __future__ import annotations

import os
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from stemwatch.connectors.connector import WHOLE, Connector, TagInfo, TagMapping, ValveTags, Window
from stemwatch.connectors.historian.options import ReadOptions
from stemwatch.connectors.settings import (
    Encoding,
    Interval,
    Name,
    SourceSettings,
    Zone,
    contradiction,
)
from stemwatch.models.recording import Recording, Role

if TYPE_CHECKING:
    from stemwatch.connectors.historian.inspection import Inspection
    from stemwatch.connectors.historian.opened_file import OpenedFile

_DEFAULTS = ReadOptions()


class TextExportSettings(SourceSettings):
    """``[[sources]]`` without a kind, or of kind ``csv``: text exports and how to read them.

    What is not given is decided by the reader from the file itself, and the report says so.
    """

    kind: Literal["csv"] | None = Field(default=None, description='"csv", or nothing')
    path: Annotated[str, Field(min_length=1)] | None = Field(
        default=None,
        description="a file or pattern such as exports/*.csv, relative to the plant file",
    )
    folder: Annotated[str, Field(min_length=1)] | None = Field(
        default=None,
        description="a folder that exports are dropped into, relative to the plant file",
    )
    zone: Zone | None = Field(default=None, description="an IANA time zone such as Europe/Berlin")
    encoding: Encoding | None = Field(
        default=None, description="an encoding such as utf-8 or cp1252"
    )
    separator: Literal[",", ";", "\t", "|", " "] | None = Field(
        default=None, description='one of "," ";" "\\t" "|" " "'
    )
    decimal: Literal[".", ","] | None = Field(default=None, description='"." or ","')
    day_first: bool | None = Field(
        default=None, description="true (31.12.2025) or false (12/31/2025)"
    )
    time_format: Name | None = Field(
        default=None, description='a format such as "%d.%m.%Y %H:%M:%S"'
    )
    time_column: Name | None = Field(
        default=None, description="the heading of the time column, as text"
    )
    interval_s: Interval | None = Field(
        default=None, description="seconds between samples, above 0"
    )
    tag_column: Name | None = Field(
        default=None, description="the heading of the column of tag names, as text"
    )
    value_column: Name | None = Field(
        default=None, description="the heading of the column of values, as text"
    )
    quality_column: Name | None = Field(
        default=None, description="the heading of the column of quality codes, as text"
    )
    good_quality: list[Name] | None = Field(
        default=None, description='a list of the codes that mean good, such as ["192", "Good"]'
    )
    ambiguous_hour: Literal["infer", "first", "second"] | None = Field(
        default=None,
        description='"infer", "first" (summer time) or "second" (standard time): which hour is '
        "meant where clocks are put back and one local hour occurs twice",
    )
    missing_hour: Literal["shift", "leave_out"] | None = Field(
        default=None,
        description='"shift" (forward by an hour) or "leave_out": what becomes of rows in the '
        "hour that clocks skip when they are put forward",
    )

    @model_validator(mode="after")
    def _one_place(self) -> Self:
        if (self.path is None) == (self.folder is None):
            found_text = "nothing" if self.path is None else "both path and folder"
            expected = (
                "a file or pattern such as exports/*.csv, relative to the plant file; or folder "
                "instead, for exports that are dropped there"
            )
            raise contradiction(("path",), found_text, expected)
        return self

    @model_validator(mode="after")
    def _two_marks(self) -> Self:
        if self.separator is not None and self.separator == self.decimal:
            found_text = f"{self.decimal!r}, which is also the separator"
            raise contradiction(("decimal",), found_text, "two different marks")
        return self

    def read_options(self) -> dict[str, Any]:
        """The given options under the names of ``ReadOptions``; the reader decides the others."""
        options = self.model_dump(exclude={"name", "kind", "path", "folder"}, exclude_none=True)
        if "good_quality" in options:
            options["good_quality"] = tuple(options["good_quality"])
        return options


class HistorianFile:
    """One CSV or text export, read as it was written.

    The file is read once, when it is first asked for anything, and never written. Whatever is not
    said in ``options`` is decided from the whole file; each decision is a sentence in the
    recording's provenance. Implements ``stemwatch.connectors.connector.Connector``.
    """

    settings = TextExportSettings

    def __init__(self, path: str | os.PathLike[str], options: ReadOptions = _DEFAULTS) -> None:
        self.path = Path(path)
        self.options = options
        self._opened: OpenedFile | None = None
        # One at a time: pages ask for several plots of one file at once, and what is converted for
        # the one is let go by the other.
        self._guard = threading.Lock()

    def _open(self, wanted: Sequence[str] | None) -> OpenedFile:
        """The file, opened once; ``wanted`` tags will be asked for, or with ``None`` all."""
        # Late: reading needs numpy and the layouts, `stemwatch --help` does not.
        from stemwatch.connectors.historian.opened_file import open_file

        if self._opened is None:
            self._opened = open_file(self.path, self.options, wanted)
        return self._opened

    def tags(self) -> Sequence[TagInfo]:
        """Every tag with unit, description and, where there is no doubt, role and valve."""
        with self._guard:
            return self._tags(self._open(None))

    def _tags(self, opened: OpenedFile) -> list[TagInfo]:
        import numpy as np

        infos = []
        for role in opened.roles():
            column = opened.column(role.tag)
            facts = {} if role.own_interval_s is None else {"own_interval_s": role.own_interval_s}
            infos.append(role.info(int(np.isfinite(column.values).sum()), facts))
        return infos

    def read(self, valve: ValveTags, window: Window = WHOLE) -> Recording:
        """The recording of one valve.

        Raises ``UnknownTag`` for a tag that is not there, ``ConnectorError`` for one tag given as
        both OP and MV, a window without samples or without a known zone, and a time span that
        needs more than 50 million samples.
        """
        from stemwatch.connectors.historian.recordings import assemble

        wanted = [mapping.tag for mapping in valve.tags.values()]
        with self._guard:
            return assemble(self._open(wanted), valve, window)

    def inspect(self) -> Inspection:
        """What the reader understood and how good the data is, without reading any valve."""
        from stemwatch.connectors.historian.inspection import inspect_file

        with self._guard:
            return inspect_file(self._open(None))


def propose_valves(source: Connector) -> list[ValveTags]:
    """The valves of a source whose OP leaves no doubt, with every other role that leaves none.

    Sorted by name. A valve without a position tag is proposed without MV: which tag is the
    position is never guessed.
    """
    return valves_among(source.tags())


def valves_among(infos: Sequence[TagInfo]) -> list[ValveTags]:
    """The valves that ``propose_valves`` proposes from these tags of a source."""
    valves: dict[str, dict[Role, TagMapping]] = {}
    for info in infos:
        if info.proposed_role is not None and info.proposed_valve:
            mapping = TagMapping(tag=info.tag, unit=info.unit)
            valves.setdefault(info.proposed_valve, {})[info.proposed_role] = mapping
    return [
        ValveTags(valve=name, tags=tags) for name, tags in sorted(valves.items()) if Role.OP in tags
    ]
