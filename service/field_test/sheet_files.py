"""The sheet as one HTML page and as PDF, and the page of a test's result; none loads anything."""

from __future__ import annotations

import io
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from markupsafe import Markup

from stemwatch.models.words import capitalised
from stemwatch.service.field_test.picture import picture_of_result, picture_of_test
from stemwatch.service.field_test.result_in_words import TestResult
from stemwatch.service.field_test.sheet import RivalOutcome, TestSheet, clock
from stemwatch.service.maintenance.drawing import svg_of
from stemwatch.service.presenter.wording import instant
from stemwatch.service.report.html_page import environment
from stemwatch.service.report.report_context import ReportContext
from stemwatch.service.whole_files import put_all

HTML, PDF, RESULT = "test-plan.html", "test-plan.pdf", "test-result.html"
SIGNED = ("Done by", "Date, time", "MV followed", "Remarks")
SIZES = (8.6, 8.0, 7.4, 6.8, 6.2)  # points, the largest that fits one page


def write_sheet(sheet: TestSheet, context: ReportContext, folder: Path) -> tuple[Path, Path]:
    """Write ``test-plan.html`` and ``test-plan.pdf``; each replaced whole or left as it was.

    Raises ``ReportNotWritten`` with each file and what to do.
    """
    folder.mkdir(parents=True, exist_ok=True)
    page, paper = folder / HTML, folder / PDF
    put_all({page: html_of(sheet, context), paper: pdf_of(sheet, context)})
    return page, paper


def page_values(sheet: TestSheet) -> dict[str, Any]:
    """The values that the sheet's templates need beside the sheet."""
    picture, test = picture_of_test(sheet), sheet.test
    return {
        "sheet": sheet,
        "picture": Markup("") if picture is None else svg_of(picture),
        "ends": "" if test is None else clock(test.programme.duration_s),
    }


def outcome_sentence(outcome: RivalOutcome) -> str:
    """An outcome in one line."""
    first = f" First: {outcome.then}" if outcome.then else ""
    return f"{capitalised(outcome.name)}: {outcome.means}.{first}"


def html_of(sheet: TestSheet, context: ReportContext) -> bytes:
    """The page as UTF-8. There is no script in it, and its policy allows none."""
    env = environment(context, resource)
    page = env.get_template("test_plan.html")
    text = page.render(
        context=context,
        signed=SIGNED,
        styles=Markup(resource("test_plan.css")),
        **page_values(sheet),
    )
    return text.encode()


def write_result(result: TestResult, context: ReportContext, folder: Path) -> Path:
    """Write ``test-result.html``, replaced whole or left as it was. Raises ``ReportNotWritten``."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / RESULT
    put_all({path: html_of_result(result, context)})
    return path


def html_of_result(result: TestResult, context: ReportContext) -> bytes:
    """The page of a judged test as UTF-8, without a script."""
    judgement = result.judgement
    picture = Markup("")
    if judgement.op is not None and judgement.mv is not None:
        followed = {
            model.slug: fit.followed
            for model, fit in zip(judgement.models, judgement.fits, strict=True)
        }
        picture = svg_of(
            picture_of_result(
                judgement.op,
                judgement.mv,
                judgement.interval_s,
                [rival.name for rival in result.rivals],
                [followed[rival.slug] for rival in result.rivals],
            )
        )
    page = environment(context, resource).get_template("test_result.html")
    styles = Markup(resource("test_plan.css"))
    return page.render(context=context, result=result, picture=picture, styles=styles).encode()


@cache
def resource(name: str) -> str:
    """The text of a file of this folder."""
    return files("stemwatch.service.field_test").joinpath(name).read_text("utf-8")


def pdf_of(sheet: TestSheet, context: ReportContext, *, compress: bool = True) -> bytes:
    """The sheet on A4, in the largest type in which it fits one page."""
    from stemwatch.service.maintenance.paper import PlainDocument, TypeSize, height_of

    memory = io.BytesIO()
    document = PlainDocument(memory, sheet.title, context, SIGNED, compress=compress)
    flowables: list[Any] = []
    for size in SIZES:
        flowables = _flowables(TypeSize(size), sheet, context)
        if height_of(flowables) <= document.room:
            break
    document.build(flowables)
    return memory.getvalue()


# Type sizes are ``TypeSize`` of ``maintenance.paper``, which is imported only where a PDF is made:
# reportlab takes long to import.
def _flowables(t: Any, sheet: TestSheet, context: ReportContext) -> list[Any]:
    from reportlab.platypus import Spacer

    from stemwatch.service.maintenance.paper import PaperPicture

    plant = f"{context.plant} · " if context.plant else ""
    planned = f"{plant}planned {instant(context.started, context.tz)} ({context.zone})"
    flowables: list[Any] = [
        t.text(sheet.title, 1.7, bold=True, spaceAfter=3.0),
        t.text(f"{planned} · {context.software}", 0.86),
        t.text(sheet.headline, bold=True, spaceBefore=3.0, spaceAfter=2.0),
        *(t.text(f"• {remark_text}", 0.95) for remark_text in sheet.remarks),
    ]
    picture = picture_of_test(sheet)
    if sheet.test is None or picture is None:
        return flowables
    return [
        *flowables,
        Spacer(1, 3.0),
        PaperPicture(picture),
        t.columns(_left_column(t, sheet), _right(t, sheet)),
    ]


def _left_column(t: Any, sheet: TestSheet) -> list[Any]:
    from stemwatch.service.maintenance.paper import GAP, WIDTH

    assert sheet.test is not None
    op = f"{sheet.plan.op:.1f}"
    rows = [("At", "OP, %", "How"), ("0:00", op, "manual; leave OP where it is")]
    rows += [(leg.clock, f"{leg.to:.1f} ({leg.shift})", leg.words) for leg in sheet.moves]
    rows.append((clock(sheet.test.programme.duration_s), op, "end; controller to automatic"))
    width = (WIDTH - GAP) / 2
    return [
        t.heading("Before"),
        *(t.text(f"{k}. {step}") for k, step in enumerate(sheet.before, start=1)),
        t.heading("The test"),
        t.grid(rows, [0.12 * width, 0.27 * width, 0.61 * width]),
    ]


def _right(t: Any, sheet: TestSheet) -> list[Any]:
    from stemwatch.service.maintenance.paper import GAP, WIDTH

    width = (WIDTH - GAP) / 2
    count = len(sheet.rivals)
    rows = [("", "At", "OP, %", *(f"MV: {name}" for name in sheet.rivals), "seen")]
    rows += [
        (str(k), reading.clock, f"{reading.op:.1f}", *(f"{mv:.1f}" for mv in reading.mv), "____")
        for k, reading in enumerate(sheet.readings, start=1)
    ]
    shares = [0.06, 0.12, 0.14, *[0.54 / count] * count, 0.14]
    outcomes = [t.text(outcome_sentence(outcome)) for outcome in sheet.outcomes]
    return [
        t.heading("Watch"),
        t.grid(rows, [share * width for share in shares]),
        t.text(sheet.passes, spaceBefore=2.0),
        t.heading("What each outcome means"),
        *outcomes,
        t.heading("Stop when"),
        *(t.text(f"• {reason}") for reason in sheet.stop),
        t.heading("Afterwards"),
        t.text(sheet.after),
    ]
