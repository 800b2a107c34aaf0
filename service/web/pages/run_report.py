"""The report of a run as it was written: the page in a sandbox, the tables as files."""

from __future__ import annotations

from pathlib import Path

from fastapi import APIRouter, HTTPException, Request
from fastapi.responses import FileResponse, Response

from stemwatch.service.web.actions import number_in
from stemwatch.service.web.dependencies import Dependencies, Deps

PAGE, MAINTENANCE = "report.html", "maintenance.html"
PAGES = frozenset({PAGE, MAINTENANCE})
TYPES = {
    PAGE: "text/html; charset=utf-8",
    "valves.csv": "text/csv; charset=utf-8",
    "valves.xlsx": "application/vnd.openxmlformats-officedocument.spreadsheetml.sheet",
    "valves.json": "application/json",
    MAINTENANCE: "text/html; charset=utf-8",
    "maintenance.pdf": "application/pdf",
    "work-orders.xlsx": "application/vnd.openxmlformats-officedocument.spreadsheetml.sheet",
    "work-orders.csv": "text/csv; charset=utf-8",
}
# The report carries its own policy with the digests of its scripts. Here it runs in a sandbox
# without an origin, so that its content can neither send requests to this service nor read its
# cookies.
POLICY = (
    "sandbox allow-scripts allow-modals allow-popups allow-downloads; default-src 'none'; "
    "script-src 'unsafe-inline'; style-src 'unsafe-inline'; frame-ancestors 'none'"
)

router = APIRouter(include_in_schema=False)


@router.get("/run/report")
def report(request: Request, deps: Deps) -> Response:
    """One file of a run's report; ``id`` is the run, ``file`` one of ``TYPES``."""
    run_text = request.query_params.get("id", "")
    number = number_in(run_text)
    name = request.query_params.get("file", PAGE)
    if name not in TYPES:
        raise HTTPException(404, f"A report has no file {name!r}.")
    folder = report_folder(deps, number)
    if folder is None or not (folder / name).is_file():
        raise HTTPException(
            404, f"The report of run {run_text!r} is not kept, or was never written."
        )
    if name in PAGES:
        headers = {"content-security-policy": POLICY}
        page = _led_here((folder / name).read_bytes(), number)
        return Response(page, media_type=TYPES[name], headers=headers)
    return FileResponse(folder / name, media_type=TYPES[name], filename=f"run-{number}-{name}")


def _led_here(page: bytes, number: int) -> bytes:
    """The page with its relative links, which are right on a disk, replaced by links to this
    route."""
    for name in TYPES:
        href = f'href="report?id={number}&amp;file={name}"'
        page = page.replace(f'href="{name}"'.encode(), href.encode())
    return page


def report_folder(deps: Dependencies, number: int) -> Path | None:
    """Where the report of a run lies; ``None`` where it has none among the plant's reports."""
    plant = deps.site.plant
    if plant is None or not number:
        return None
    run = deps.store.queue.find(number)
    if run is None or not run.report:
        return None
    home = plant.beside(plant.service.reports).resolve()
    folder = Path(run.report).resolve()
    return folder if folder.is_relative_to(home) and folder != home else None
