"""The tags of an archive and the time they cover, from the files' footers where possible."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from stemwatch.connectors.connector import ConnectorError, TagInfo
from stemwatch.connectors.historian.options import ReadOptions
from stemwatch.connectors.historian.tags.roles import Candidate, propose_roles
from stemwatch.connectors.historian.times.epoch import instant_of
from stemwatch.connectors.parquet.archive_file import ArchiveFile
from stemwatch.connectors.parquet.column_layout import ColumnLayout
from stemwatch.connectors.parquet.reading import place_of, tags_of
from stemwatch.models.recording import Role

_YEARS_NS = 2**62
_ROLES = {role.value: role for role in Role}


def list_tags(files: Sequence[ArchiveFile], options: ReadOptions, stem: str) -> list[TagInfo]:
    """Every tag, in the files' order. Raises ``ConnectorError`` where no file can be read."""
    samples: dict[str, int] = {}
    units: dict[str, str] = {}
    roles: dict[str, tuple[Role, str]] = {}
    broken: list[ConnectorError] = []
    for file in files:
        try:
            layout = file.layout(options)
            keys = file.key_values(layout)
        except ConnectorError as error:
            broken.append(error)
            continue
        counts = _counts(file, layout)
        for tag in tags_of(layout, keys):
            samples[tag] = samples.get(tag, 0) + counts.get(tag, 0)
            if column_place := place_of(tag, layout):
                units[tag] = units.get(tag) or layout.units.get(column_place.column, "")
                if layout.kind == "valves" and column_place.column.lower() in _ROLES:
                    roles[tag] = _ROLES[column_place.column.lower()], str(column_place.key)
    if broken and not samples:
        raise broken[0]
    named = [(tag, units.get(tag, ""), "", None) for tag in samples]
    return [
        _info(candidate, samples[candidate.tag], roles.get(candidate.tag))
        for candidate in propose_roles(named, stem=stem, mv_is_output=False)
    ]


def _info(candidate: Candidate, samples: int, declared: tuple[Role, str] | None) -> TagInfo:
    if declared is None:
        return candidate.info(samples)
    role, valve = declared
    remark = f"the archive has it in the column {role.value} of valve {valve}"
    return replace(candidate, role=role, valve=valve, remark=remark).info(samples)


def _counts(file: ArchiveFile, layout: ColumnLayout) -> dict[str, int]:
    """Values of each tag, where the footer alone can tell."""
    groups = file.groups(layout)
    counts: dict[str, int] = {}
    for group, rows in enumerate(groups.rows):
        only = groups.only(group)
        if layout.key is not None and only is None:
            return {}
        for tag in tags_of(layout, [only] if only is not None else []):
            tag_place = place_of(tag, layout)
            nulls = None if tag_place is None else file.nulls(group, tag_place.column)
            if nulls is None:
                return {}
            counts[tag] = counts.get(tag, 0) + rows - nulls
    return counts


def covered(files: Sequence[ArchiveFile], tag: str, options: ReadOptions) -> str:
    """What time the files that hold ``tag`` cover, as the end of a sentence."""
    first, last = _YEARS_NS, -_YEARS_NS
    for file in files:
        try:
            layout = file.layout(options)
        except ConnectorError:
            continue
        tag_place = place_of(tag, layout)
        if tag_place is None:
            continue
        groups = file.groups(layout)
        for group in groups.wanted(
            None if tag_place.key is None else [tag_place.key], (None, None)
        ):
            if abs(groups.first_ns[group]) < _YEARS_NS:
                first = min(first, groups.first_ns[group])
                last = max(last, groups.last_ns[group])
    if first > last:
        return "the files do not say what time they cover"
    dates = (f"{instant_of(ns):%Y-%m-%d %H:%M:%S}" for ns in (first, last))
    return f"the archive covers {' to '.join(dates)} by its own clock"
