"""The ranking as a workbook: Ranking, Indicators, Read me. No text is ever taken for a formula."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any, BinaryIO

from xlsxwriter import Workbook

from stemwatch.models.verdict import Verdict
from stemwatch.service.presenter.wording import VERDICT_MEANING, finite, printable
from stemwatch.service.report.ranking import RankedValve, Ranking
from stemwatch.service.report.report_context import ReportContext
from stemwatch.service.report.spreadsheet_columns import Cell, SpreadsheetColumn, header_and_rows

LONGEST_TEXT = 32_767  # Excel's limit for one cell

VERDICT_COLOURS = {
    Verdict.STICKY: ("#9b1c1c", "#fde8e8"),
    Verdict.DEFECTIVE: ("#6d2457", "#f8e6f2"),
    Verdict.WATCH: ("#7a4b00", "#fdf0d5"),
    Verdict.UNDETERMINED: ("#414b5a", "#eceff3"),
    Verdict.HEALTHY: ("#14603a", "#e4f4ea"),
}

_INDICATOR_HEADERS = ("valve", "indicator", "value", "low", "high", "unit", "worse when", "meaning")
_INDICATOR_WIDTHS = (18, 30, 12, 12, 12, 14, 12, 70)
_WORSE = {"up": "it rises", "down": "it falls"}


def write_xlsx(ranked: Ranking, context: ReportContext, file: BinaryIO) -> None:
    """The workbook, the same for the same screenings and context.

    Rows go to the disk as they are written, so that memory does not grow with the valves.
    """
    with Workbook(file, {"constant_memory": True, "remove_timezone": True}) as workbook:
        workbook.set_properties(
            {"title": printable(context.title), "created": _naive_utc(context.started)}
        )
        columns = _ranking(workbook, ranked, context)
        _indicators(workbook, ranked)
        _read_me(workbook, columns, context, ranked)


def _naive_utc(moment: datetime) -> datetime:
    return moment.astimezone(UTC).replace(tzinfo=None)


def _header(
    workbook: Any, sheet: Any, titles: Sequence[str], widths: Sequence[int], rows: int
) -> None:
    style = workbook.add_format(
        {"bold": True, "bottom": 1, "bg_color": "#eef1f5", "text_wrap": True, "valign": "top"}
    )
    for index, (title, width) in enumerate(zip(titles, widths, strict=True)):
        sheet.set_column(index, index, width)
        sheet.write_string(0, index, title, style)
    sheet.autofilter(0, 0, rows, len(titles) - 1)
    sheet.repeat_rows(0)
    sheet.set_landscape()
    sheet.set_paper(9)  # A4
    sheet.fit_to_pages(1, 0)


def _ranking(
    workbook: Any, ranked: Sequence[RankedValve], context: ReportContext
) -> Sequence[SpreadsheetColumn]:
    sheet = workbook.add_worksheet("Ranking")
    columns, rows = header_and_rows(ranked, context)
    titles = [column.header for column in columns]
    _header(workbook, sheet, titles, [column.width for column in columns], len(ranked))
    sheet.freeze_panes(1, titles.index("valve") + 1)
    styles = [_style(workbook, column) for column in columns]
    for line, row in enumerate(rows, start=1):
        for index, cell in enumerate(row):
            write_cell(sheet, line, index, cell, styles[index])
    _colours(workbook, sheet, titles, len(ranked))
    return columns


def _style(workbook: Any, column: SpreadsheetColumn) -> dict[type, Any]:
    wrap = {"valign": "top", "text_wrap": column.width >= 30}
    return {
        str: workbook.add_format(wrap),
        int: workbook.add_format({"valign": "top", "num_format": "0"}),
        float: workbook.add_format(
            {"valign": "top", "num_format": "0." + "0" * column.digits if column.digits else "0"}
        ),
        datetime: workbook.add_format({"valign": "top", "num_format": "yyyy-mm-dd hh:mm"}),
    }


def write_cell(sheet: Any, line: int, index: int, cell: Cell, styles: dict[type, Any]) -> None:
    """Write a cell as what it is, text never as a formula; ``None`` leaves it empty."""
    if cell is None:
        return
    style = styles.get(type(cell))
    if isinstance(cell, datetime):
        sheet.write_datetime(line, index, cell.replace(tzinfo=None), style)
    elif isinstance(cell, str):
        sheet.write_string(line, index, _fitting(cell), style)
    else:
        sheet.write_number(line, index, cell, style)


def _fitting(text: str) -> str:
    return text if len(text) <= LONGEST_TEXT else text[: LONGEST_TEXT - 1] + "…"


def _colours(workbook: Any, sheet: Any, titles: list[str], rows: int) -> None:
    if not rows:
        return
    verdict, severity = titles.index("verdict"), titles.index("severity (0 to 100)")
    for word, (ink, paper) in VERDICT_COLOURS.items():
        style = workbook.add_format({"font_color": ink, "bg_color": paper, "bold": True})
        rule = {"type": "cell", "criteria": "==", "value": f'"{word.value}"', "format": style}
        sheet.conditional_format(1, verdict, rows, verdict, rule)
    bar: dict[str, Any] = {"type": "data_bar", "bar_color": "#b9c6d8", "min_type": "num"}
    bar |= {"max_type": "num", "min_value": 0, "max_value": 100}
    sheet.conditional_format(1, severity, rows, severity, bar)


def _indicators(workbook: Any, ranked: Sequence[RankedValve]) -> None:
    sheet = workbook.add_worksheet("Indicators")
    indicators = (
        (screening.valve, indicator)
        for screening in (valve.screening for valve in ranked)
        for indicator in screening.indicators.values()
    )
    rows = sum(len(valve.screening.indicators) for valve in ranked)
    _header(workbook, sheet, _INDICATOR_HEADERS, _INDICATOR_WIDTHS, rows)
    sheet.freeze_panes(1, 2)
    styles: dict[type, Any] = {str: workbook.add_format({"text_wrap": True, "valign": "top"})}
    styles[float] = workbook.add_format({"num_format": "0.000", "valign": "top"})
    for line, (valve, measured) in enumerate(indicators, start=1):
        numbers = [finite(measured.value), finite(measured.low), finite(measured.high)]
        texts = [measured.unit, _WORSE.get(measured.worse, "neither"), measured.meaning]
        for index, cell in enumerate([valve, measured.name, *numbers, *texts]):
            cell = printable(cell) if isinstance(cell, str) else cell
            write_cell(sheet, line, index, cell, styles)


def _read_me(
    workbook: Any,
    columns: Sequence[SpreadsheetColumn],
    context: ReportContext,
    ranked: Ranking,
) -> None:
    sheet = workbook.add_worksheet("Read me")
    sheet.set_column(0, 0, 34)
    sheet.set_column(1, 1, 90)
    heading = workbook.add_format({"bold": True, "font_size": 12})
    wrap = workbook.add_format({"text_wrap": True, "valign": "top"})
    first = 0
    for title, pairs in _read_me_parts(columns, context, ranked):
        sheet.write_string(first, 0, title, heading)
        for line, (name, text) in enumerate(pairs, start=first + 1):
            sheet.write_string(line, 0, _fitting(printable(name)), wrap)
            sheet.write_string(line, 1, _fitting(printable(text)), wrap)
        first += len(pairs) + 2


def _read_me_parts(
    columns: Sequence[SpreadsheetColumn], context: ReportContext, ranked: Ranking
) -> list[tuple[str, list[tuple[str, str]]]]:
    started = context.started.astimezone(context.tz).isoformat(timespec="minutes")
    run = [
        ("Plant", context.plant),
        ("Run started", f"{started} ({context.zone})"),
        ("Software", context.software),
        ("Command", context.command),
        ("Settings digest", context.settings_digest),
    ]
    physics = ranked.discovered.sentence
    not_read = [(unread.source, unread.reason) for unread in context.sources_not_read]
    return [
        (printable(context.title), run),
        ("Work", [("all valves", ranked.counts.sentence)]),
        ("Verdicts", [(word.value, text) for word, text in VERDICT_MEANING.items()]),
        ("Hidden physics", [("all valves", physics or "no valve was tested for it")]),
        ("Columns of Ranking", [(column.header, column.meaning) for column in columns]),
        ("Sources not read", not_read or [("none", "every source was read")]),
    ]
