"""Text cells of one tag to values with a quality each."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from stemwatch.connectors.historian.raw_table import RawColumn
from stemwatch.connectors.historian.reading_notes import ReadingNotes
from stemwatch.connectors.historian.times.instants import Instants
from stemwatch.connectors.historian.times.time_fields import Ints
from stemwatch.connectors.historian.times.timeline import Timeline
from stemwatch.connectors.historian.values import implausible_values
from stemwatch.connectors.historian.values.numbers import parse_number, parse_numbers
from stemwatch.connectors.historian.values.quality_codes import quality_of
from stemwatch.connectors.historian.values.value_texts import (
    mode_value,
    says_truncated,
    text_quality,
)
from stemwatch.models.recording import Bools, Floats, Quality, QualityCodes, Role
from stemwatch.models.words import counted

_SHOWN = 30
_TOLD = 5  # doubtful cells of one tag that are listed with their lines


@dataclass(frozen=True, kw_only=True)
class Column:
    """One tag's samples in order of time, rows with an empty cell left out.

    ``times``, ``values``, ``quality`` (n,). ``reasons`` counts what was written where no good value
    is: the raw words and codes, for the planner who asks why.
    """

    tag: str
    unit: str
    description: str
    times: Timeline
    values: Floats
    quality: QualityCodes
    file_ns: Ints  # the same rows' times in file order, empty cells included
    reasons: dict[str, int] = field(default_factory=dict)
    decisions: tuple[str, ...] = ()
    own_ticks: dict[bool, float | None] = field(default_factory=dict, repr=False, compare=False)

    @property
    def ns(self) -> Ints:
        """(n,) nanoseconds of ``times``."""
        return self.times.ns


def sharing_times(columns: Mapping[Role, Column]) -> dict[Role, Column]:
    """The columns, those of equal times with one timeline between them."""
    shared: dict[Role, Column] = {}
    for role, column in columns.items():
        known = (at_times(column, other.times) for other in shared.values())
        shared[role] = next((same for same in known if same is not column), column)
    return shared


def at_times(column: Column, times: Timeline | None) -> Column:
    """The column with the shared timeline ``times`` where it equals the column's own, so that
    quantities derived from it are computed once for all tags."""
    if times is None or not np.array_equal(times.ns, column.ns):
        return column
    file_ns = times.ns if column.file_ns is column.ns else column.file_ns
    return replace(column, times=times, file_ns=file_ns)


def own_interval_s(column: Column, *, command: bool) -> float | None:
    """Seconds between the tag's own samples where slower than its rows."""
    step = column.times.usual_step
    if step is None:
        return None
    if command not in column.own_ticks:
        column.own_ticks[command] = implausible_values.own_interval(
            column.times.ticks, column.values, command=command
        )
    ticks = column.own_ticks[command]
    return None if ticks is None else ticks * step / 1e9


def convert(
    raw: RawColumn,
    instants: Instants,
    *,
    decimal: str,
    good: tuple[str, ...],
    name: str,
    lines: Sequence[int] = (),
    as_mode: bool = False,
) -> Column:
    """Values and quality of ``raw``; with ``as_mode`` words such as AUTO and MAN count as 1 and 0.

    ``lines`` are the numbers of the file's lines on which the table's rows stand, for messages.
    Raises ``UnreadableSource`` where a quality column's codes cannot be understood.
    """
    notes = ReadingNotes()
    values = parse_numbers(raw.cells, decimal)
    quality, reasons = _words(raw, values, notes)
    if lines:
        _tell_doubtful(raw, values, decimal, lines, notes)
    if as_mode:
        values, quality = _modes(raw, values, quality)
        # AUTO is what such a tag measures: it is not left out.
        reasons = Counter({text: n for text, n in reasons.items() if mode_value(text) is None})
    quality = _coded(raw, quality, good, name, notes, reasons)
    quality = _repeated_by_archive(raw, quality)
    rows = slice(None) if raw.rows is None else raw.rows
    return finished(
        raw.tag,
        raw.unit,
        raw.description,
        instants.ns[rows],
        instants.ok[rows],
        values,
        quality,
        notes=notes,
        reasons=reasons,
    )


def finished(
    tag: str,
    unit: str,
    description: str,
    ns: Ints,
    ok: Bools,
    values: Floats,
    quality: NDArray[np.uint8],
    *,
    notes: ReadingNotes,
    reasons: Counter[str],
) -> Column:
    """The column of one tag from its rows in the source's order, all (n,).

    ``ok`` is false for rows without a time, which are left out; so are rows that are MISSING.
    ``notes`` and ``reasons`` hold what was said of the cells before.
    """
    ns, values, quality, file_ns = _in_order(ns, ok, values, quality)
    quality = _faulty(tag, values, quality, notes, reasons)
    return Column(
        tag=tag,
        unit=unit,
        description=description,
        times=Timeline(ns),
        values=np.where(quality <= Quality.HELD, values, np.nan),
        quality=quality,
        file_ns=file_ns,
        reasons=dict(reasons),
        decisions=tuple(notes.decisions),
    )


def _words(
    raw: RawColumn, values: Floats, notes: ReadingNotes
) -> tuple[NDArray[np.uint8], Counter[str]]:
    quality = np.zeros(values.size, dtype=np.uint8)
    reasons: Counter[str] = Counter()
    for row in np.flatnonzero(~np.isfinite(values)).tolist():
        text = raw.cells[row]
        quality[row] = text_quality(text)
        if text.strip():
            reasons[text.strip()[:_SHOWN]] += 1
        if says_truncated(text):
            notes.decide(
                f"{raw.tag}: a cell says {text.strip()!r}: the sheet was too small, so the record "
                "is truncated and later samples are missing; export it again with a larger array."
            )
    return quality, reasons


def _tell_doubtful(
    raw: RawColumn, values: Floats, decimal: str, lines: Sequence[int], notes: ReadingNotes
) -> None:
    """Cells that could be a number and are not taken for one, with their lines."""
    message_count = 0
    for row in np.flatnonzero(np.isnan(values)).tolist():
        text = raw.cells[row].strip()
        if parse_number(text, decimal) is None:
            continue
        message_count += 1
        if message_count > _TOLD:
            notes.decide(f"{raw.tag}: and more cells such as these on later lines.")
            return
        file_row = row if raw.rows is None else int(raw.rows[row])
        notes.decide(
            f"{raw.tag}: line {lines[file_row]}: {text[:_SHOWN]!r} is left out: the tag's other "
            "numbers are written without marks for thousands, so it may be two numbers or a "
            "damaged one."
        )


def _modes(
    raw: RawColumn, values: Floats, quality: NDArray[np.uint8]
) -> tuple[Floats, NDArray[np.uint8]]:
    modes_by_text = {text: mode_value(text) for text in set(raw.cells)}
    words = np.array([modes_by_text[text] for text in raw.cells], dtype=np.float64)
    values = np.where(np.isfinite(words), words, values)
    odd_values = np.isfinite(values) & (values != 0.0) & (values != 1.0)
    quality = np.where(np.isfinite(words), Quality.GOOD, quality).astype(np.uint8)
    return values, np.where(odd_values, Quality.CODE, quality).astype(np.uint8)


def _coded(
    raw: RawColumn,
    quality: NDArray[np.uint8],
    good: tuple[str, ...],
    name: str,
    notes: ReadingNotes,
    reasons: Counter[str],
) -> NDArray[np.uint8]:
    if raw.quality_codes is None:
        return quality
    verdict = quality_of(
        raw.quality_codes,
        quality == Quality.GOOD,
        column=raw.quality_name,
        good=good,
        family=raw.quality_family,
        name=name,
        notes=notes,
    )
    bad = (verdict == Quality.BAD) & (quality == Quality.GOOD)
    for row in np.flatnonzero(bad).tolist():
        reasons[f"{raw.quality_name} {raw.quality_codes[row].strip()}"[:_SHOWN]] += 1
    return np.where(bad, Quality.BAD, quality).astype(np.uint8)


def _repeated_by_archive(raw: RawColumn, quality: NDArray[np.uint8]) -> NDArray[np.uint8]:
    if raw.held is None:
        return quality
    flagged = parse_numbers(raw.held, ".") == 1.0
    return np.where(flagged & (quality == Quality.GOOD), Quality.HELD, quality).astype(np.uint8)


def _in_order(
    ns: Ints, ok: Bools, values: Floats, quality: NDArray[np.uint8]
) -> tuple[Ints, Floats, NDArray[np.uint8], Ints]:
    """By time, without untimed rows and empty cells; equal times keep their order."""
    if not ok.all():
        ns, values, quality = ns[ok], values[ok], quality[ok]
    backward = np.count_nonzero(ns[1:] < ns[:-1])
    if backward and backward > np.count_nonzero(ns[1:] > ns[:-1]):
        # Newest first: turned round, so that of equal times the later row stays the later.
        ns, values, quality = ns[::-1], values[::-1], quality[::-1]
    file_ns = ns
    has_value = quality != Quality.MISSING
    if not has_value.all():
        ns, values, quality = ns[has_value], values[has_value], quality[has_value]
    if backward and (ns[1:] < ns[:-1]).any():
        order = np.argsort(ns, kind="stable")
        ns, values, quality = ns[order], values[order], quality[order]
    return ns, values, quality, file_ns


def _faulty(
    tag: str,
    values: Floats,
    quality: NDArray[np.uint8],
    notes: ReadingNotes,
    reasons: Counter[str],
) -> NDArray[np.uint8]:
    """Mark numbers that are not measurements, with a sentence for each kind."""
    kinds = (
        (
            implausible_values.denormal_values,
            Quality.CODE,
            "non-zero but below 1e-37, as a state code in a value slot is",
        ),
        (
            implausible_values.out_of_float_range,
            Quality.RANGE,
            "1e30 or more, which no signal can be",
        ),
        (
            implausible_values.pi_states,
            Quality.CODE,
            "as PI system states are numbered, and far outside the tag's own range",
        ),
        (
            implausible_values.zero_dropouts,
            Quality.RANGE,
            "exactly 0 for a moment between values far from 0, as in dropouts without a flag",
        ),
    )
    usable = quality <= Quality.HELD
    believed = np.where(usable, values, np.nan)
    for find, verdict, description in kinds:
        coded = find(believed) & usable
        if coded.any():
            examples = ", ".join(f"{v:g}" for v in np.unique(values[coded])[:4])
            n = int(coded.sum())
            notes.decide(f"{tag}: {counted(n, 'sample')} left out ({examples}): {description}.")
            reasons[f"{verdict.name.lower()} {examples}"[:_SHOWN]] += n
            quality = np.where(coded, verdict, quality).astype(np.uint8)
            usable = quality <= Quality.HELD
            believed = np.where(usable, values, np.nan)
    return quality
