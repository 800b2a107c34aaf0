"""The ranking as CSV: UTF-8 with a byte order mark, so that a spreadsheet reads every tag."""

from __future__ import annotations

import csv
import io
from datetime import datetime
from typing import BinaryIO

from stemwatch.service.report.ranking import Ranking
from stemwatch.service.report.report_context import ReportContext
from stemwatch.service.report.spreadsheet_columns import Cell, header_and_rows

# A spreadsheet takes a cell that begins so for a formula (OWASP, "CSV injection").
FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\r", "\n", "＝", "＋", "－", "＠")


def write_csv(ranked: Ranking, context: ReportContext, file: BinaryIO) -> None:
    """One header row, one row per valve; numbers unrounded, times ISO 8601 with their offset."""
    columns, rows = header_and_rows(ranked, context)
    sheet = io.TextIOWrapper(file, encoding="utf-8-sig", newline="")
    writer = csv.writer(sheet)
    writer.writerow([column.header for column in columns])
    writer.writerows([harmless(cell) for cell in row] for row in rows)
    sheet.flush()
    sheet.detach()  # the file is the caller's to close


def harmless(cell: Cell) -> Cell:
    """``cell`` as a spreadsheet may open it: text that would be a formula gets an apostrophe."""
    if isinstance(cell, datetime):
        return cell.isoformat()
    if isinstance(cell, str) and cell.startswith(FORMULA_STARTS):
        return f"'{cell}"
    return cell
