"""Exports in every layout, encoding and kind of damage, small, for tests of how they are read."""

from __future__ import annotations

import gzip
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from stemwatch.connectors.connector import ConnectorError
from stemwatch.connectors.historian import HistorianFile, ReadOptions
from stemwatch.connectors.historian.connector import propose_valves

TAGS = ("FIC-1.OP", "FIC-1.ZT", "FIC-1.PV", "TIC-2.OP", "TIC-2.ZT")
START = datetime(2026, 10, 25, 0, 30, tzinfo=UTC)  # half an hour before clocks are put back


@dataclass(frozen=True, kw_only=True)
class Kind:
    """How an export is written. ``damage``: what stands instead of the cell or line that a share
    of the file from 0 to 1 points at."""

    layout: str = "wide"
    separator: str = ","
    decimal: str = "."
    quoted: str = "no"  # no, words or all
    encoding: str = "utf-8"
    end: str = "\n"
    packed: bool = False
    by_tag: bool = False  # narrow: one tag after the other, not all tags of each time
    cells: Sequence[tuple[float, str]] = ()
    lines: Sequence[tuple[float, str]] = ()
    last_end: bool = True
    rows: int = field(default=240)


def times(count: int, form: str) -> list[str]:
    stamps = (START + timedelta(seconds=30 * i) for i in range(count))
    return [stamp.strftime(form) for stamp in stamps]


def values(kind: Kind) -> list[list[str]]:
    """(rows, tags) texts of slow walks around 50."""
    rng = np.random.default_rng(7)
    walk = 50.0 + np.cumsum(rng.standard_normal((kind.rows, len(TAGS))) * 0.4, axis=0)
    texts = [[f"{value:.3f}".replace(".", kind.decimal) for value in row] for row in walk]
    for share, text in kind.cells:
        at = min(int(share * kind.rows * len(TAGS)), kind.rows * len(TAGS) - 1)
        texts[at // len(TAGS)][at % len(TAGS)] = text
    return texts


def wide(kind: Kind, form: str, header: Sequence[Sequence[str]]) -> list[list[str]]:
    rows = [list(row) for row in header]
    body = zip(times(kind.rows, form), values(kind), strict=True)
    return rows + [[stamp, *texts] for stamp, texts in body]


def samples(kind: Kind, form: str) -> list[tuple[str, str, str, str]]:
    """Tag, time, value and whether it is good."""
    stamps, texts = times(kind.rows, form), values(kind)
    matching = [
        (tag, stamps[i], texts[i][n], "bad" if (i + n) % 41 == 0 else "good")
        for i in range(kind.rows)
        for n, tag in enumerate(TAGS)
    ]
    return sorted(matching, key=lambda item: TAGS.index(item[0])) if kind.by_tag else matching


ISO, PLAIN = "%Y-%m-%dT%H:%M:%SZ", "%Y-%m-%d %H:%M:%S"
Rows = list[list[str]]


def _processdata(kind: Kind) -> Rows:
    rows = wide(kind, PLAIN, ())
    flags = ["1" if i % 17 == 0 else "0" for i in range(kind.rows)]
    head = [
        ["PROCESSDATA", "a loop", "yyyy-mm-dd"],
        ["columns", "30", "2026-10-25", str(kind.rows)],
        ["tagname", "F1.PV", "F1.SV", "F1.MV", "F2.PV", "F2.MV", "bOpOFL"],
        ["description", "flow", "flow", "flow_OP", "level", "level_OP", ""],
        ["settings"],
    ]
    return head + [[*row, flag] for row, flag in zip(rows, flags, strict=True)]


def _narrow(header: Sequence[str], form: str, make: Callable[..., list[str]]):
    def rows(kind: Kind) -> Rows:
        return [list(header)] * bool(header) + [make(*sample) for sample in samples(kind, form)]

    return rows


def _epoch(stamp: str) -> str:
    return f"{int(datetime.fromisoformat(stamp).timestamp())}:000000000"


UNITS = ["", "%", "%", "m3/h", "%", "%"]
LAYOUTS: dict[str, Callable[[Kind], Rows]] = {
    "wide": lambda kind: wide(kind, ISO, [["Time", *TAGS]]),
    "units": lambda kind: wide(kind, PLAIN, [["Time", *TAGS], UNITS]),
    "date and clock": lambda kind: [
        [*row[0].split(" "), *row[1:]] if i else ["Date", "Clock", *row[1:]]
        for i, row in enumerate(wide(kind, PLAIN, [["Time", *TAGS]]))
    ],
    "unix": lambda kind: wide(kind, "%s", [["Time", *TAGS]]),
    "German Excel": lambda kind: wide(kind, "%d.%m.%Y %H:%M:%S", [["Zeitstempel", *TAGS]]),
    "DataLink": lambda kind: wide(kind, PLAIN, [["", *TAGS], ["", "I/O Timeout", "", "", "", ""]]),
    "DeltaV": lambda kind: wide(
        kind, PLAIN, [["Time", *(f"{tag[:5]}/AO1/{tag[6:]}.CV %" for tag in TAGS)]]
    ),
    "Citect": lambda kind: [
        [row[0], "0" if i else "Milliseconds", *row[1:]]
        for i, row in enumerate(wide(kind, PLAIN, [["Time", *TAGS]]))
    ],
    "Ignition": lambda kind: [
        ["#NAMES"], ["t_stamp", *TAGS], ["#TYPES"], ["Date", *["F"] * 5],
        ["#ROWS", str(kind.rows)], *wide(kind, PLAIN, ()),
    ],
    "PROCESSDATA": _processdata,
    "narrow": _narrow(("Tag", "Time", "Value"), PLAIN, lambda t, s, v, q: [t, s, v]),
    "narrow with all": _narrow(
        ("Time", "Tag", "Value", "Status", "Unit", "Description"),
        ISO,
        lambda t, s, v, q: [s, t, v, q, "%", f" about {t}"],
    ),
    "narrow date and clock": _narrow(
        ("Tag", "Date", "Clock", "Value"), PLAIN, lambda t, s, v, q: [t, *s.split(" "), v]
    ),
    "AVEVA Insight": _narrow(
        ("TagName", "DateTime", "Value", "OpcQuality"),
        ISO,
        lambda t, s, v, q: [t, s, v, "192" if q == "good" else "0"],
    ),
    "AVEVA history": _narrow(
        ("DateTime", "TagName", "Value", "vValue", "Quality", "QualityDetail"),
        "%Y-%m-%d %H:%M:%S.0000000",
        lambda t, s, v, q: [s, t, v if q == "good" else " ", v, "0", "192"],
    ),
    "IP.21": _narrow(
        ("NAME", "IP_TREND_TIME", "IP_TREND_VALUE", "IP_TREND_QSTATUS"),
        "%d-%b-%y %H:%M:%S.0",
        lambda t, s, v, q: [t, s, v, q.title()],
    ),
    "Proficy extract": _narrow(
        (), ISO, lambda t, s, v, q: [_epoch(s), t, v, "DoubleFloat", q.upper()]
    ),
    "Proficy": lambda kind: [
        ["* written by hand"], ["[Data]"],
        *_narrow(
            ("Tagname", "Timestamp", "Value", "DataQuality"),
            "%m/%d/%Y %H:%M:%S",
            lambda t, s, v, q: [t, s, v, q.title()],
        )(kind),
    ],
    "InfluxDB": lambda kind: [
        ["#group", "false", "false", "true", "false", "true", "true"],
        ["#datatype", "string", "long", "dateTime:RFC3339", "double", "string", "string"],
        ["#default", "_result", "", "", "", "", ""],
        *_narrow(
            ("", "result", "table", "_time", "_value", "_field", "_measurement"),
            ISO,
            lambda t, s, v, q: ["", "", "0", s, v, t[-2:], t[:5]],
        )(kind),
    ],
}  # fmt: skip


def _cell(text: str, kind: Kind) -> str:
    needs = kind.separator in text or '"' in text or "\n" in text
    words = kind.quoted == "words" and not text.replace(".", "").isdigit()
    if kind.quoted == "all" or words or needs:
        return '"' + text.replace('"', '""') + '"'
    return text


def written(kind: Kind) -> bytes:
    """The export's bytes."""
    rows = LAYOUTS[kind.layout](kind)
    separator = "\t" if kind.layout == "PROCESSDATA" else kind.separator
    if kind.layout in ("AVEVA Insight", "Proficy extract", "Proficy", "InfluxDB", "Ignition"):
        separator = ","
    plain = kind.layout in ("Proficy extract", "PROCESSDATA")
    lines = [separator.join(row if plain else [_cell(cell, kind) for cell in row]) for row in rows]
    for share, text in kind.lines:
        lines[min(int(share * len(lines)), len(lines) - 1)] = text
    text = kind.end.join(lines) + (kind.end if kind.last_end else "")
    stored = text.encode(kind.encoding, "replace")
    return gzip.compress(stored) if kind.packed else stored


def everything(
    path: Path, options: ReadOptions, refused: type[ConnectorError]
) -> tuple[object, ...]:
    """All that a user can ask of an export, as plain values; or what is said where it is
    ``refused``."""
    try:
        source = HistorianFile(path, options)
        recordings = [source.read(valve) for valve in propose_valves(source)]
        inspected = source.inspect().to_dict()
    except refused as error:
        return (str(error),)
    return (
        [
            (
                *(r.valve, r.interval_s, r.start, r.clock, r.provenance, role, s.tag, s.unit),
                *(s.interval_s, s.values.tobytes(), s.quality.tobytes()),
            )
            for r in recordings
            for role, s in r.signals.items()
        ],
        {**inspected, "tags": [repr(tag) for tag in inspected["tags"]]},
    )
