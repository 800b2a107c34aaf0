"""``ArchiveFile``: one Parquet file, its footer read once, and which row groups to read of it."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from stemwatch.connectors.archive.valve_columns import Bounds
from stemwatch.connectors.connector import UnreadableSource
from stemwatch.connectors.historian.options import ReadOptions
from stemwatch.connectors.parquet.column_layout import ColumnLayout, decide_layout

_UNIT_NS = {"milliseconds": 1_000_000, "microseconds": 1_000, "nanoseconds": 1}
_FURTHEST = 2**63 - 1


@dataclass(frozen=True)
class Groups:
    """Smallest and largest time and key of each row group, from the footer.

    ``first_ns``, ``last_ns`` (n,) as they stand in the file, widest where it does not say;
    ``keys`` the pair of each group or ``None``; ``rows`` (n,).
    """

    first_ns: Sequence[int]
    last_ns: Sequence[int]
    keys: Sequence[tuple[str, str] | None]
    rows: Sequence[int]

    def wanted(self, keys: Sequence[str] | None, bounds: Bounds) -> list[int]:
        """Groups that may hold one of ``keys`` (``None``: all) between the bounds."""
        start, stop = bounds
        able = range(len(self.rows)) if keys is None else self.holding(keys)
        return [
            group
            for group in able
            if (start is None or self.last_ns[group] >= start)
            and (stop is None or self.first_ns[group] < stop)
        ]

    def holding(self, keys: Sequence[str]) -> list[int]:
        """Groups whose key column may have one of ``keys`` in it."""
        pure, mixed = self._by_key
        groups = {group for key in keys for group in pure.get(key, ())}
        for group, low, high in mixed:
            if any(low <= key.encode() and (high is None or key.encode() <= high) for key in keys):
                groups.add(group)
        return sorted(groups)

    @cached_property
    def _by_key(self) -> tuple[dict[str, list[int]], list[tuple[int, bytes, bytes | None]]]:
        """Groups of one key by that key, and the others with their span.

        Parquet orders text by its bytes.
        """
        pure: dict[str, list[int]] = {}
        mixed: list[tuple[int, bytes, bytes | None]] = []
        for group, span in enumerate(self.keys):
            if span is None:
                mixed.append((group, b"", None))
            elif span[0] == span[1]:
                pure.setdefault(span[0], []).append(group)
            else:
                mixed.append((group, span[0].encode(), span[1].encode()))
        return pure, mixed

    def only(self, group: int) -> str | None:
        """The one key of all rows of a group, where the footer says that there is but one."""
        span = self.keys[group]
        return span[0] if span is not None and span[0] == span[1] else None


class ArchiveFile:
    """A file of the archive; nothing is read before it is needed."""

    def __init__(self, filesystem: Any, path: str, keys: Mapping[str, str]) -> None:
        self._filesystem = filesystem
        self.path = path
        self.keys = keys
        self._layouts: dict[ReadOptions, ColumnLayout] = {}
        self._groups: dict[str, Groups] = {}  # by the column of the times
        self._keyed: dict[str, Any] = {}  # fragments by the column that is read as a dictionary
        self._key_values: dict[str, list[str]] = {}  # by the column of the keys

    @cached_property
    def fragment(self) -> Any:
        """The file as a fragment of a dataset. Raises ``UnreadableSource``."""
        import pyarrow as pa

        try:
            fragment = _format().make_fragment(self.path, self._filesystem)
            fragment.ensure_complete_metadata()
        except (pa.ArrowException, OSError) as error:
            raise UnreadableSource(
                f"{self.path}: this is no readable Parquet file ({one_line(error)}); expected "
                "one with an intact footer. A file that is still being written has none: write it "
                "under another name and rename it"
            ) from None
        return fragment

    def layout(self, options: ReadOptions) -> ColumnLayout:
        """The roles of the columns. Raises ``UnreadableSource``."""
        if options not in self._layouts:
            stem = self.path.replace("\\", "/").rsplit("/", 1)[-1].rsplit(".", 1)[0]
            self._layouts[options] = decide_layout(
                self.fragment.physical_schema, self.keys, options, self.path, stem
            )
        return self._layouts[options]

    def groups(self, layout: ColumnLayout) -> Groups:
        """What the footer says of each row group; looked up once."""
        if layout.time not in self._groups:
            self._groups[layout.time] = _groups(self.fragment.metadata, layout, self.keys)
        return self._groups[layout.time]

    def read(
        self, groups: Sequence[int], columns: Sequence[str], key: str | None = None
    ) -> Iterator[tuple[int, Any]]:
        """(group, table of ``columns``) one by one, the column ``key`` as a dictionary.

        Raises ``UnreadableSource``.
        """
        import pyarrow as pa

        source = self.fragment if key is None or key in self.keys else self._with_dictionary(key)
        for group in groups:
            part = source.subset(row_group_ids=[group])
            try:
                yield group, part.to_table(columns=list(columns), use_threads=False)
            except (pa.ArrowException, OSError) as error:
                raise UnreadableSource(
                    f"{self.path}: row group {group + 1} cannot be read ({one_line(error)}); the "
                    "file is damaged or was replaced while it was read. Write it anew, or run again"
                ) from None

    def _with_dictionary(self, key: str) -> Any:
        """The fragment that reads ``key`` as a dictionary: thousands of rows bear one name."""
        if key not in self._keyed:
            self._keyed[key] = _format(dictionary_columns={key}).make_fragment(
                self.path, self._filesystem
            )
        return self._keyed[key]

    @property
    def is_open(self) -> bool:
        """Whether the footer was read."""
        return "fragment" in self.__dict__

    def has_key(self, layout: ColumnLayout, key: str) -> bool:
        """Whether any row bears ``key``. Raises ``UnreadableSource``."""
        groups = self.groups(layout)
        able = groups.holding([key])
        if any(groups.only(group) == key for group in able):
            return True
        return bool(able) and key in self.key_values(layout)

    def key_values(self, layout: ColumnLayout) -> list[str]:
        """What the key column holds, each once, in the order of first appearance.

        From the footer where each row group has one key, else by reading that column. Raises
        ``UnreadableSource``.
        """
        if layout.key is None:
            return []
        if layout.key not in self._key_values:
            groups = self.groups(layout)
            seen: dict[str, None] = {}
            mixed = []
            for group in range(len(groups.rows)):
                only = groups.only(group)
                if only is None:
                    mixed.append(group)
                else:
                    seen[only] = None
            for _, table in self.read(mixed, [layout.key], layout.key):
                names = table.column(layout.key).unique().to_pylist()
                seen |= {str(name): None for name in names if name is not None}
            self._key_values[layout.key] = list(seen)
        return self._key_values[layout.key]

    def nulls(self, group: int, column: str) -> int | None:
        """How many rows of a group have nothing in ``column``, where the footer says it."""
        column_index = _places(self.fragment.metadata).get(column)
        if column_index is None:
            return None
        statistics = self.fragment.metadata.row_group(group).column(column_index).statistics
        return (
            statistics.null_count if statistics is not None and statistics.has_null_count else None
        )


def _format(**reading: Any) -> Any:
    """How files are read: a page whose checksum is wrong is an error, where the file has checksums.
    Without them a flipped bit is another number."""
    import pyarrow.dataset as ds

    checked = ds.ParquetFragmentScanOptions(page_checksum_verification=True)
    return ds.ParquetFileFormat(default_fragment_scan_options=checked, **reading)


def _places(metadata: Any) -> dict[str, int]:
    schema = metadata.schema
    return {schema.column(index).path: index for index in range(len(schema))}


def _groups(metadata: Any, layout: ColumnLayout, keys: Mapping[str, str]) -> Groups:
    places = _places(metadata)
    time, key = places.get(layout.time), places.get(layout.key or "")
    unit_ns = None if time is None else _unit_ns(metadata.schema.column(time))
    first: list[int] = []
    last: list[int] = []
    rows: list[int] = []
    spans: list[tuple[str, str] | None] = []
    for number in range(metadata.num_row_groups):
        group = metadata.row_group(number)
        low, high = -_FURTHEST, _FURTHEST
        if time is not None and unit_ns is not None:
            low, high = _span(group.column(time).statistics, unit_ns)
        first.append(low)
        last.append(high)
        rows.append(group.num_rows)
        if layout.key in keys and layout.key is not None:
            spans.append((keys[layout.key], keys[layout.key]))
        else:
            spans.append(None if key is None else _text_span(group.column(key).statistics))
    return Groups(first, last, spans, rows)


def _unit_ns(column: Any) -> int | None:
    """Nanoseconds of one count of a timestamp, as the file itself stores it."""
    logical_type = json.loads(column.logical_type.to_json())
    if column.physical_type != "INT64" or logical_type.get("Type") != "Timestamp":
        return None
    return _UNIT_NS.get(logical_type.get("timeUnit"))


def _span(statistics: Any, unit_ns: int) -> tuple[int, int]:
    if statistics is None or not statistics.has_min_max:
        return -_FURTHEST, _FURTHEST
    low, high = int(statistics.min_raw) * unit_ns, int(statistics.max_raw) * unit_ns
    return max(low, -_FURTHEST), min(high, _FURTHEST)


def _text_span(statistics: Any) -> tuple[str, str] | None:
    if statistics is None or not statistics.has_min_max or statistics.null_count:
        return None
    low, high = statistics.min, statistics.max
    return (low, high) if isinstance(low, str) and isinstance(high, str) else None


def as_floats(array: Any) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """(n,) float64 of an Arrow column of numbers, NaN where it is null."""
    import pyarrow as pa
    import pyarrow.compute as pc
    import pyarrow.types as kinds

    if kinds.is_dictionary(array.type):
        array = pc.cast(array, array.type.value_type)
    if kinds.is_boolean(array.type):
        array = pc.cast(array, pa.uint8())
    out = pc.cast(array, pa.float64(), safe=False).to_numpy()
    return np.asarray(out, dtype=np.float64)


def one_line(error: Exception) -> str:
    """An error's message on one line."""
    return " ".join(str(error).split())
