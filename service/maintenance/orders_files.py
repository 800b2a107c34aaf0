"""The work orders as CSV and as XLSX; no cell is ever taken for a formula."""

from __future__ import annotations

import csv
import io
from datetime import UTC, datetime
from typing import Any

from xlsxwriter import Workbook

from stemwatch.service.maintenance.advice import HINT
from stemwatch.service.maintenance.book import Book
from stemwatch.service.maintenance.orders import FIELDS, rows_of
from stemwatch.service.report.csv_file import harmless
from stemwatch.service.report.words import printable
from stemwatch.service.report.xlsx_file import write_cell


def orders_csv(book: Book) -> bytes:
    """UTF-8 with a byte order mark, commas; one header row, one row per work order, numbers
    unrounded, times ISO 8601 with their offset."""
    sheet = io.StringIO(newline="")
    writer = csv.writer(sheet)
    writer.writerow([field.name for field in FIELDS])
    writer.writerows([[harmless(cell) for cell in row] for row in rows_of(book)])
    return sheet.getvalue().encode("utf-8-sig")


def orders_xlsx(book: Book) -> bytes:
    """The same in a workbook, with a second sheet that says what each column means."""
    memory = io.BytesIO()
    with Workbook(memory, {"in_memory": True, "remove_timezone": True}) as workbook:
        started = book.context.started.astimezone(UTC).replace(tzinfo=None)
        title = printable(f"Work orders {book.context.plant}".strip())
        workbook.set_properties({"title": title, "created": started})
        _orders(workbook, book)
        _meanings(workbook, book)
    return memory.getvalue()


def _orders(workbook: Any, book: Book) -> None:
    sheet = workbook.add_worksheet("Work orders")
    bold = workbook.add_format({"bold": True, "bottom": 1, "text_wrap": True, "valign": "top"})
    styles = {
        str: workbook.add_format({"valign": "top", "text_wrap": True}),
        int: workbook.add_format({"valign": "top", "num_format": "0"}),
        float: workbook.add_format({"valign": "top", "num_format": "0.00"}),
        datetime: workbook.add_format({"valign": "top", "num_format": "yyyy-mm-dd hh:mm"}),
    }
    rows = rows_of(book)
    for index, field in enumerate(FIELDS):
        sheet.set_column(index, index, field.width)
        sheet.write_string(0, index, field.name, bold)
    for line, row in enumerate(rows, start=1):
        sheet.set_row(line, 60)
        for index, cell in enumerate(row):
            write_cell(sheet, line, index, cell, styles)
    sheet.freeze_panes(1, 2)
    sheet.autofilter(0, 0, len(rows), len(FIELDS) - 1)
    sheet.set_landscape()
    sheet.set_paper(9)  # A4
    sheet.repeat_rows(0)


def _meanings(workbook: Any, book: Book) -> None:
    sheet = workbook.add_worksheet("Columns")
    sheet.set_column(0, 0, 24)
    sheet.set_column(1, 1, 90)
    wrap = workbook.add_format({"text_wrap": True, "valign": "top"})
    told = [(field.name, field.meaning) for field in FIELDS]
    told.append(("times", f"in {book.context.zone}"))
    for line, (name, meaning) in enumerate([*told, ("", HINT), ("", book.counts)]):
        sheet.write_string(line, 0, name, wrap)
        sheet.write_string(line, 1, meaning, wrap)
