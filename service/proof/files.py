"""One case as a CSV file, as an operator exports it from a historian."""

from __future__ import annotations

import csv
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from stemwatch.models.recording import Floats, Recording, Role

START = datetime(2026, 3, 2, 6, 0, tzinfo=UTC)
SUFFIX = {Role.OP: "OP", Role.MV: "ZT", Role.PV: "PV", Role.SP: "SP"}


def write_case(file: Path, recording: Recording) -> None:
    """Time, output, position, process variable and set point in percent, one row a sample.

    Tags are made of the file's name alone, so that nothing of the truth rides in them. A sample
    without a value is written as ``Bad``.
    """
    roles = [role for role in SUFFIX if role in recording.signals]
    columns = [_cells(recording.signals[role].values) for role in roles]
    with file.open("w", encoding="utf-8", newline="") as out:
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(["Time", *(f"{file.stem}.{SUFFIX[role]}" for role in roles)])
        writer.writerow(["", *("%" for _ in roles)])
        writer.writerows(zip(_times(recording.time_s), *columns, strict=True))


def _cells(values: Floats) -> list[str]:
    return [f"{value:.4f}" if np.isfinite(value) else "Bad" for value in values.tolist()]


def _times(stamps_s: Floats) -> list[str]:
    """UTC with its offset; milliseconds only where there are any."""
    fine = "seconds" if np.all(stamps_s == np.round(stamps_s)) else "milliseconds"
    return [
        (START + timedelta(seconds=second)).isoformat(sep=" ", timespec=fine)
        for second in stamps_s.tolist()
    ]
