"""Columns of one valve to a ``Recording``: window, percent, provenance."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from datetime import timedelta
from typing import Protocol

import numpy as np

from stemwatch.connectors.connector import (
    ConnectorError,
    MappingNeeded,
    NothingInWindow,
    TagMapping,
    UnknownTag,
    ValveTags,
    Window,
    nearest_names,
)
from stemwatch.connectors.historian.columns import Column, own_interval_s, sharing_times
from stemwatch.connectors.historian.source_clock import (
    ColumnOnGrid,
    Grid,
    clock_facts,
    lay_column,
    lay_lines,
    make_grid,
    times_stored,
)
from stemwatch.connectors.historian.times.door_corners import (
    door_deviation,
    find_corners,
    lines_interval_ns,
)
from stemwatch.connectors.historian.times.epoch import EPOCH, ns_of
from stemwatch.connectors.historian.times.time_fields import Ints
from stemwatch.connectors.historian.times.timeline import Timeline
from stemwatch.connectors.historian.values.units import SHARE_OF_SPAN, canonical
from stemwatch.models.recording import (
    PERCENT,
    Floats,
    Provenance,
    Quality,
    QualityCodes,
    Recording,
    Role,
    Signal,
)
from stemwatch.models.words import counted, times


class SampleSource(Protocol):
    """Tags with their samples, from a file or from an archive.

    ``source_name`` names the source in messages. ``in_utc`` says whether times are instants in UTC;
    else durations are right and dates are not.
    """

    @property
    def source_name(self) -> str: ...

    @property
    def names(self) -> Sequence[str]: ...

    @property
    def in_utc(self) -> bool: ...

    @property
    def zone(self) -> str: ...

    @property
    def digest(self) -> str: ...

    @property
    def layout(self) -> str: ...

    @property
    def decisions(self) -> Sequence[str]: ...

    @property
    def unused_options(self) -> Mapping[str, str]: ...

    @property
    def problems(self) -> Sequence[str]: ...

    def read_ahead(self, tags: Iterable[str]) -> None:
        """These tags are wanted next: read them together where that is less work."""
        ...

    def column(self, tag: str, *, as_mode: bool = False) -> Column: ...


# Percent of span that a transmitter or an output can still deliver (NAMUR NE 43 goes to 112.5).
_OUTSIDE = (-25.0, 125.0)
_MOST_OUTSIDE = 0.05  # more than this means that the range is wrong, not the samples
_PLAIN_PERCENT = (-15.0, 115.0)


def assemble(opened: SampleSource, valve: ValveTags, window: Window) -> Recording:
    """The recording of ``valve`` in ``window``. Raises ``UnknownTag`` or ``ConnectorError``."""
    need_op(opened.source_name, valve)
    tags = find_tags(opened, [mapping.tag for mapping in valve.tags.values()])
    _check_mapping(opened, valve)
    opened.read_ahead(tags)
    columns = sharing_times(
        {
            role: opened.column(find_tag(opened, mapping.tag), as_mode=role is Role.MODE)
            for role, mapping in valve.tags.items()
        }
    )
    _check_samples(opened, columns[Role.OP])
    op = columns[Role.OP]
    corners = find_corners(columns)
    grid = make_grid(
        op.times if corners else _clock(op),
        op.tag,
        opened.source_name,
        _window_ns(opened, window),
        step_ns=lines_interval_ns(op.times) if corners else None,
    )
    if grid.size == 0:
        raise NothingInWindow(_outside_window(opened, op, window))
    notes: list[str] = []
    stored = times_stored(columns.values())
    mappings = {role: _ranged(role, columns[role], valve.tags[role]) for role in columns}
    signals = {
        role: _drawn_signal(role, column, mappings[role], grid, stored, notes)
        if role in corners
        else _signal(role, column, mappings[role], grid, stored, notes)
        for role, column in columns.items()
    }
    notes += _deviations_not_used(columns, valve, corners)
    _remark_same_values(signals, notes)
    return Recording(
        valve=valve.valve,
        signals=signals,
        interval_s=grid.interval_s,
        start=EPOCH + timedelta(microseconds=round(grid.start_ns / 1000))
        if opened.in_utc
        else None,
        clock=clock_facts(op.file_ns, opened.zone),
        provenance=_provenance(opened, columns, notes),
    )


def need_op(source_name: str, valve: ValveTags) -> None:
    """Raise ``MappingNeeded`` where no tag is given for OP."""
    if Role.OP not in valve.tags:
        raise MappingNeeded(
            f"{source_name}: {valve.valve}: no tag is given for OP, the controller output; a "
            "recording needs one"
        )


def _check_mapping(opened: SampleSource, valve: ValveTags) -> None:
    """Raise ``ConnectorError`` where OP is its own position, or low and high give no range."""
    for mapping in valve.tags.values():
        low, high = mapping.low, mapping.high
        if low is None or high is None:
            continue
        if low == high or not np.isfinite((low, high)).all():
            raise ConnectorError(
                f"{opened.source_name}: {valve.valve}: {mapping.tag}: low {low:g} and high "
                f"{high:g} give no range; give the engineering values at 0 % and 100 %"
            )
    mv = valve.tags.get(Role.MV)
    if mv is not None and find_tag(opened, mv.tag) == find_tag(opened, valve.tags[Role.OP].tag):
        raise ConnectorError(
            f"{opened.source_name}: {valve.valve}: {mv.tag!r} is given for both OP and MV; a valve "
            "that is compared with its own command looks perfect. Give the tag of the measured "
            "position, or none"
        )


def find_tags(opened: SampleSource, tag_texts: Sequence[str]) -> list[str]:
    """The source's tags for what a user wrote. Raises ``UnknownTag`` with all that are not there,
    so that two typing errors are not two tries."""
    tags: list[str] = []
    unknown: list[str] = []
    for tag_text in tag_texts:
        try:
            tags.append(find_tag(opened, tag_text))
        except UnknownTag as error:
            unknown.append(str(error).removeprefix(f"{opened.source_name}: "))
    if unknown:
        raise UnknownTag(f"{opened.source_name}: {'; '.join(unknown)}")
    return tags


def find_tag(opened: SampleSource, tag_text: str) -> str:
    """The source's tag for what a user wrote. Raises ``UnknownTag`` with the nearest ones."""
    tags = list(opened.names)
    if tag_text in tags:
        return tag_text
    folded_tag = tag_text.strip().lower()
    folded = [tag for tag in tags if tag.lower() == folded_tag]
    if len(folded) == 1:
        return folded[0]
    with_unit = [
        tag for tag in tags if folded_tag.startswith((tag.lower() + " ", tag.lower() + "["))
    ]
    if len(with_unit) == 1:
        return with_unit[0]
    raise UnknownTag(
        f"{opened.source_name}: there is no tag {tag_text!r} among {len(tags)}; the nearest are "
        f"{nearest_names(tag_text, tags)}"
    )


def _check_samples(opened: SampleSource, op: Column) -> None:
    if not np.isfinite(op.values).any():
        reason_list = ", ".join(f"{text!r} {times(n)}" for text, n in list(op.reasons.items())[:4])
        raise ConnectorError(
            f"{opened.source_name}: {op.tag}: no sample of the controller output can be used"
            f"{f' ({reason_list})' if reason_list else ''}; check the tag"
        )


def _clock(op: Column) -> Timeline:
    """Times that make the clock: all rows, or OP's own where most rows leave it empty."""
    on_own_clock = op.ns is op.file_ns or op.ns.size < 0.5 * op.file_ns.size
    return op.times if on_own_clock else Timeline(op.file_ns)


def _window_ns(opened: SampleSource, window: Window) -> tuple[int | None, int | None]:
    if window.start is None and window.stop is None:
        return None, None
    if not opened.in_utc:
        raise ConnectorError(
            f"{opened.source_name}: a window was asked for, but the file's times have no zone; "
            "give the zone, such as 'Europe/Berlin', or read the whole file"
        )
    return ns_of(window.start), ns_of(window.stop)


def _outside_window(opened: SampleSource, op: Column, window: Window) -> str:
    first, last = (EPOCH + timedelta(seconds=int(ns) // 10**9) for ns in (op.ns[0], op.ns[-1]))
    return (
        f"{opened.source_name}: {op.tag}: no samples between {window.start} and {window.stop}; the "
        f"file covers {first:%Y-%m-%d %H:%M:%S} to {last:%Y-%m-%d %H:%M:%S} UTC"
    )


def _ranged(role: Role, column: Column, mapping: TagMapping) -> TagMapping:
    """``mapping``, with the range of an OP or position whose unit alone says it."""
    unit = canonical(mapping.unit) if mapping.unit else column.unit
    if role not in (Role.OP, Role.MV) or unit != SHARE_OF_SPAN or mapping.low is not None:
        return mapping
    return replace(mapping, low=0.0, high=1.0)


def _signal(
    role: Role, column: Column, mapping: TagMapping, grid: Grid, stored: Ints, notes: list[str]
) -> Signal:
    on_grid = lay_column(column, grid, is_clock=role is Role.OP, stored=stored)
    if on_grid.decision:
        notes.append(on_grid.decision)
    own_spacing_s = own_interval_s(column, command=role not in (Role.PV, Role.MV))
    if own_spacing_s is not None and own_spacing_s <= 1.2 * grid.interval_s:
        own_spacing_s = None
    if own_spacing_s is not None:
        notes.append(f"{column.tag} itself changes only each {own_spacing_s:g} s.")
    values, quality, unit = _scaled(role, column, mapping, on_grid, notes)
    return Signal(
        values=values,
        quality=quality,
        tag=column.tag,
        unit=unit,
        interval_s=own_spacing_s,
        range=mapping.process_range(column.unit),
        scaled=mapping.scales,
    )


def _deviations_not_used(
    columns: Mapping[Role, Column], valve: ValveTags, corners: frozenset[Role]
) -> list[str]:
    return [
        f"{column.tag}: the plant file states a deviation of {valve.tags[role].deviation:g}, but "
        "these samples are not the corners of a swinging door; it is not used."
        for role, column in columns.items()
        if role not in corners and valve.tags[role].deviation is not None
    ]


def _drawn_signal(
    role: Role, column: Column, mapping: TagMapping, grid: Grid, stored: Ints, notes: list[str]
) -> Signal:
    """The lines between the corners of ``column``, with the deviation that they leave open."""
    on_grid = lay_lines(column, grid, stored)
    notes.append(on_grid.decision)
    values, quality, unit = _scaled(role, column, mapping, on_grid, notes)
    deviation = door_deviation(column) if mapping.deviation is None else mapping.deviation
    if mapping.low is not None and mapping.high is not None:
        deviation *= 100.0 / abs(mapping.high - mapping.low)
    return Signal(
        values=values,
        quality=quality,
        tag=column.tag,
        unit=unit,
        range=mapping.process_range(column.unit),
        scaled=mapping.scales,
        deviation=deviation,
    )


def _scaled(
    role: Role, column: Column, mapping: TagMapping, on_grid: ColumnOnGrid, notes: list[str]
) -> tuple[Floats, QualityCodes, str]:
    """Percent of the given range, or the values as they are with their unit."""
    given_unit = canonical(mapping.unit) if mapping.unit else ""
    if given_unit and column.unit and given_unit != column.unit:
        notes.append(
            f"{column.tag}: the unit is {given_unit} as said; the file says {column.unit}."
        )
    if mapping.low is None or mapping.high is None:
        if role is Role.MODE:
            return on_grid.values, on_grid.quality, ""
        return on_grid.values, on_grid.quality, _unit(role, column, given_unit, on_grid, notes)
    percent = 100.0 * (on_grid.values - mapping.low) / (mapping.high - mapping.low)
    return percent, _in_range(column.tag, percent, on_grid.quality, notes), PERCENT


def _unit(
    role: Role, column: Column, given_unit: str, on_grid: ColumnOnGrid, notes: list[str]
) -> str:
    known_unit = given_unit or column.unit
    if known_unit or role in (Role.PV, Role.SP):
        return known_unit
    finite = on_grid.values[np.isfinite(on_grid.values)]
    low, high = _PLAIN_PERCENT
    is_percent = not finite.size or (
        (low <= finite.min() or low <= np.percentile(finite, 1))
        and (finite.max() <= high or np.percentile(finite, 99) <= high)
    )
    if not is_percent:
        notes.append(
            f"{column.tag}: no unit is known and values from {finite.min():g} to "
            f"{finite.max():g} are no percent; they stay as they are. Give low and high."
        )
        return ""
    notes.append(f"{column.tag}: no unit is known; the values were taken as percent.")
    return PERCENT


def _in_range(tag: str, percent: Floats, quality: QualityCodes, notes: list[str]) -> QualityCodes:
    """RANGE for the few samples that a range of 0 to 100 % cannot hold."""
    outside = (percent < _OUTSIDE[0]) | (percent > _OUTSIDE[1])
    if not outside.any():
        return quality
    n = int(outside.sum())
    if n > _MOST_OUTSIDE * np.isfinite(percent).sum():
        lie = counted(n, "sample lies", "samples lie")
        notes.append(f"{tag}: {lie} outside the given range; check low and high.")
        return quality
    far = "far outside the given range"
    left_out = counted(n, f"sample {far} was", f"samples {far} were")
    notes.append(f"{tag}: {left_out} left out.")
    return np.where(outside, Quality.RANGE, quality).astype(np.uint8)


def _remark_same_values(signals: dict[Role, Signal], notes: list[str]) -> None:
    mv, op = signals.get(Role.MV), signals[Role.OP]
    if mv is None:
        return
    both_usable = mv.usable & op.usable
    a, b = mv.values[both_usable], op.values[both_usable]
    if both_usable.sum() >= 20 and np.ptp(b) > 0 and np.mean(a == b) > 0.995:
        notes.append(
            f"{mv.tag} equals {op.tag} sample for sample: it is the command under another name, "
            "not a measured position."
        )


def _provenance(opened: SampleSource, columns: dict[Role, Column], notes: list[str]) -> Provenance:
    sentences = list(opened.decisions)
    for column in columns.values():
        sentences += column.decisions
        words = {text: n for text, n in column.reasons.items() if n}
        if words:
            word_counts = ", ".join(f"{text!r} {n}" for text, n in sorted(words.items())[:6])
            sentences.append(f"{column.tag}: left out as no measurement: {word_counts}.")
    sentences += notes
    sentences += [f"Problem: {problem}." for problem in opened.problems]
    return Provenance(
        source=opened.source_name,
        digest=opened.digest,
        layout=opened.layout,
        decisions=tuple(dict.fromkeys(sentences)),
        unused_options=tuple(opened.unused_options.values()),
    )
