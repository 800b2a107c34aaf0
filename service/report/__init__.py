"""The report of one run: a self-contained page, and the same findings as CSV, XLSX and JSON."""

from stemwatch.service.report.json_contract import to_contract
from stemwatch.service.report.report_context import ReportContext, SourceNotRead, ValveFacts
from stemwatch.service.report.write_report import ReportFiles, write_report
from stemwatch.service.whole_files import ReportNotWritten

__all__ = [
    "ReportContext",
    "ReportFiles",
    "ReportNotWritten",
    "SourceNotRead",
    "ValveFacts",
    "to_contract",
    "write_report",
]
