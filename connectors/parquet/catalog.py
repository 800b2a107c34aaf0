"""The files of an archive and the keys in their folders, such as ``date=2026-01-05/area=100``."""

from __future__ import annotations

import calendar
import glob
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import date, timedelta
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from stemwatch.connectors.archive.valve_columns import Bounds
from stemwatch.connectors.connector import UnreadableSource
from stemwatch.connectors.historian.times.epoch import instant_of
from stemwatch.connectors.parquet.archive_file import ArchiveFile

ENDINGS = (".parquet", ".parq", ".pq")
FRESH_S = 10.0  # files are listed again after this time, since a service runs for months
_DATES = ("date", "day", "dt")
# A partition by local date may lie a zone away from the UTC date.
_MARGIN = timedelta(days=1)


@dataclass
class Catalog:
    """The files below ``path``: a file, a folder, a pattern, or a URI such as ``s3://bucket/x``.

    Hidden files and folders, and those that begin with ``_``, are no data (Hadoop's rule).
    """

    path: str
    _files: dict[tuple[str, int, Any], ArchiveFile] = field(default_factory=dict)
    _listed: float | None = None

    def files(self) -> list[ArchiveFile]:
        """Every file in order of its path. Raises ``UnreadableSource`` where there is none."""
        if self._listed is None or time.monotonic() - self._listed > FRESH_S:
            self._files = self._list()
            self._listed = time.monotonic()
        return list(self._files.values())

    def _list(self) -> dict[tuple[str, int, Any], ArchiveFile]:
        filesystem, base, infos = _infos(self.path)
        files: dict[tuple[str, int, Any], ArchiveFile] = {}
        for info in sorted(infos, key=lambda info: str(info.path)):
            if base and _hidden(str(info.path)[len(base) :].lstrip("/")):
                continue
            version = (str(info.path), int(info.size), info.mtime_ns)
            known_files = self._files.get(version)
            files[version] = known_files or ArchiveFile(
                filesystem, info.path, partition_keys(info.path)
            )
        if not files:
            raise UnreadableSource(
                f"{self.path}: no Parquet file was found; expected a file, a folder with *.parquet "
                "files in it, or a pattern such as archive/*.parquet"
            )
        return files


def _infos(path: str) -> tuple[Any, str, list[Any]]:
    """File system, the part of every path that is no partition, and the files."""
    from pyarrow import fs

    if "://" in path:
        filesystem, base = fs.FileSystem.from_uri(path)
    else:
        filesystem, base = fs.LocalFileSystem(), str(Path(path).absolute())
    if any(sign in base for sign in "*?[") and not Path(base).exists():
        names = [name for name in glob.glob(base, recursive=True) if Path(name).is_file()]
        return filesystem, "", filesystem.get_file_info(names)
    (info,) = filesystem.get_file_info([base])
    if info.type == fs.FileType.File:
        return filesystem, "", [info]
    if info.type == fs.FileType.NotFound:
        return filesystem, base, []
    entries = filesystem.get_file_info(fs.FileSelector(base, recursive=True))
    files = [info for info in entries if info.is_file and str(info.path).lower().endswith(ENDINGS)]
    return filesystem, base, files


def partition_keys(path: str) -> dict[str, str]:
    """The keys in the folders of a path: ``area=100/part-0.parquet`` gives ``area`` 100."""
    keys: dict[str, str] = {}
    for part in path.replace("\\", "/").split("/")[:-1]:
        name, sign, value = part.partition("=")
        if sign and name:
            keys[name] = unquote(value)
    return keys


def _hidden(relative: str) -> bool:
    return any(part.startswith((".", "_")) for part in relative.replace("\\", "/").split("/"))


def may_hold(keys: Mapping[str, str], bounds: Bounds) -> bool:
    """Whether a file may have samples in ``bounds``, by the date in its folders.

    Understands ``date=``, ``day=`` and ``dt=`` with an ISO date, and ``year=``, ``month=``,
    ``day=``; anything else excludes nothing. A day is kept on either side, because a folder's
    date may be local.
    """
    span = _span(keys)
    if span is None:
        return True
    start, stop = bounds
    first, last = span
    # Folders may bear any date, such as 9999-12-31 for none, which must not be counted on from.
    if stop is not None and instant_of(stop).date() + _MARGIN < first:
        return False
    return start is None or instant_of(start).date() - _MARGIN <= last


def _span(keys: Mapping[str, str]) -> tuple[date, date] | None:
    """First and last day of a partition."""
    folded_keys = {name.lower(): value for name, value in keys.items()}
    for name in _DATES:
        if name in folded_keys and len(folded_keys[name]) >= 8:
            try:
                of_partition = date.fromisoformat(folded_keys[name][:10])
            except ValueError:
                continue
            return of_partition, of_partition
    try:
        year = int(folded_keys["year"])
        month = int(folded_keys["month"]) if "month" in folded_keys else None
        day = int(folded_keys["day"]) if "day" in folded_keys and month else None
        first = date(year, month or 1, day or 1)
    except (KeyError, ValueError):
        return None
    if day:
        return first, first
    if month:
        return first, first.replace(day=calendar.monthrange(year, month)[1])
    return first, date(year, 12, 31)
