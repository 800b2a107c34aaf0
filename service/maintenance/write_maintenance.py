"""``write_maintenance``: the four files of the maintenance report beside those of the report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from stemwatch.models.screening_result import Screening
from stemwatch.service.maintenance.maintenance_html import work_list_html
from stemwatch.service.maintenance.valve_history import NOTHING_KNOWN, ValveHistory
from stemwatch.service.maintenance.work_list import WorkList, work_list_of
from stemwatch.service.maintenance.work_orders import orders_csv, orders_xlsx
from stemwatch.service.report.report_context import ReportContext
from stemwatch.service.whole_files import make_folder, put_all

HTML, PDF = "maintenance.html", "maintenance.pdf"
ORDERS_XLSX, ORDERS_CSV = "work-orders.xlsx", "work-orders.csv"
# What each file is, in the words of the report and the terminal.
WORK_FILES = {
    PDF: "Pages for maintenance, to print (PDF)",
    HTML: "the same on screen",
    ORDERS_XLSX: "Work orders (XLSX)",
    ORDERS_CSV: "work orders for import (CSV)",
}


@dataclass(frozen=True, kw_only=True)
class MaintenanceFiles:
    """Where the maintenance report was written, what is in it, and which valves were left out
    because the plant file does not name them any more."""

    html: Path
    pdf: Path
    xlsx: Path
    csv: Path
    work_list: WorkList
    left_out: tuple[str, ...] = ()


def write_maintenance(
    screenings: Sequence[Screening],
    context: ReportContext,
    out_dir: Path | str,
    background: ValveHistory = NOTHING_KNOWN,
    *,
    everything: bool = False,
) -> MaintenanceFiles:
    """Write ``maintenance.html``, ``maintenance.pdf``, ``work-orders.xlsx`` and ``work-orders.csv``
    into ``out_dir``.

    The folder is made where it is absent; each file is replaced whole or left as it was. With
    ``everything`` each valve gets a page. Raises ``ReportNotWritten``, after writing what can be
    written, with each file and what to do.
    """
    from stemwatch.service.maintenance.pdf import work_list_pdf  # reportlab takes long to import

    folder = Path(out_dir)
    make_folder(folder)
    work_list = work_list_of(screenings, context, background, everything=everything)
    files = MaintenanceFiles(
        html=folder / HTML,
        pdf=folder / PDF,
        xlsx=folder / ORDERS_XLSX,
        csv=folder / ORDERS_CSV,
        work_list=work_list,
    )
    put_all(
        {
            files.html: work_list_html(work_list),
            files.pdf: work_list_pdf(work_list),
            files.xlsx: orders_xlsx(work_list),
            files.csv: orders_csv(work_list),
        }
    )
    return files
