"""Options that made no difference to a source: each is reported in a sentence."""

from __future__ import annotations

from collections.abc import Mapping

from stemwatch.connectors.historian.options import ReadOptions, given_options
from stemwatch.connectors.historian.raw_table import RawTable
from stemwatch.connectors.historian.reading_notes import ReadingNotes
from stemwatch.connectors.historian.times.instants import Instants


def say_unused(options: ReadOptions, notes: ReadingNotes, reasons: Mapping[str, str]) -> None:
    """A sentence for each option that the user gave and that nobody marked as used.

    ``reasons`` has the reason by option; an option without a reason is reported too, so that an
    option added later is never ignored silently.
    """
    for name, value in given_options(options).items():
        if name not in notes.used:
            value_text = f"{value:g}" if isinstance(value, float) else f"{value!r}"
            reason = reasons.get(name, "nothing asks for it")
            notes.not_used(name, f"{name} = {value_text} is not used: {reason}.")


def why_not_in_text(table: RawTable, instants: Instants) -> dict[str, str]:
    """Why an option may have no effect on a text export that was read."""
    column = f"column {table.times.name!r}"
    untimed = "there is no time column"
    layout = f"the file was read as {table.layout}"
    if table.times.texts is None:
        times = dates = untimed
    else:
        dated = instants.in_utc or bool(instants.zone)
        times = f"{column} dates each row" if dated else f"{column} says when each row was"
        dates = instants.zone.rstrip(".") if dated else f"{column} has numbers, no dates"
    return {
        "zone": dates,
        "interval_s": times,
        "day_first": "no date of the file can be read both ways" if dates != untimed else untimed,
        "time_format": untimed,
        "separator": layout,
        "decimal": layout,
        "time_column": layout,
        "tag_column": layout,
        "value_column": layout,
        "quality_column": layout,
        "good_quality": "the file has no quality codes",
        "ambiguous_hour": "no row without an offset is in the hour that autumn repeats",
        "missing_hour": "no row without an offset is in the hour that spring skips",
    }
