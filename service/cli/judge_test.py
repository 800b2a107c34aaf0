"""``stemwatch judge-test``: which explanation the recording of the planned test supports."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stemwatch.service.cli import options as o

if TYPE_CHECKING:
    from rich.console import RenderableType

    from stemwatch.models.mismatch.open_question import OpenQuestion
    from stemwatch.models.recording import Recording
    from stemwatch.service.field_test.result_in_words import TestResult
    from stemwatch.service.run.plan import Request


def judge_test(
    valve: Annotated[
        str,
        typer.Argument(help="The valve's id in the store, or the file the test was planned from."),
    ],
    result: Annotated[
        Path | None,
        typer.Argument(help="Export of the test; else the plant's own source is read."),
    ] = None,
    plant: o.PlantFile = None,
    db: Annotated[str, typer.Option(help="Database URL, instead of the plant's.")] = "",
    out: Annotated[Path | None, typer.Option(help="Folder for the page of the result.")] = None,
    json_file: o.JsonFile = None,
    op: o.OpTag = "",
    mv: o.MvTag = "",
    pv: o.PvTag = "",
    from_: Annotated[str, typer.Option("--from", help="Start of the test, ISO time.")] = "",
    to: Annotated[str, typer.Option("--to", help="End of the test, ISO time.")] = "",
    zone: o.Zone = "",
    interval_s: o.Interval = None,
) -> None:
    """Say which explanation the recording of a planned test supports, or that it cannot tell.

    The explanations are those that `stemwatch plan-test` planned for: of the last screening before
    the test, or of the file given first. Each is fitted to the test, and ruled out where a valve
    that has it would hardly ever answer so much like the one that MV follows best.
    """
    from stemwatch.models.field_test.judgement import judge_test
    from stemwatch.service.cli import views
    from stemwatch.service.cli.reading import read_options, request_of, tags_of
    from stemwatch.service.field_test.result_in_words import result_of, to_object

    if result is None and (plant is None or not (from_ and to)):
        raise typer.BadParameter(
            "give the export of the test, or --plant with --from and --to to read it there",
            param_hint="RESULT",
        )
    sources = [] if result is None else [str(o.need_file(result, "RESULT"))]
    options = read_options(zone, "", "", "", None, "", "", interval_s)
    tags = tags_of(op=op, mv=mv, pv=pv)
    request = request_of(sources, plant, tags, "", from_, to, options)
    of_file = Path(valve).is_file()
    recording = _recorded(request, "" if of_file else valve)
    if of_file:
        before = request_of([valve], plant, tags, "", "", "", options)
        name, question = _of_file(before)
    else:
        name, question = valve, _of_store(valve, request, db, recording.start)
    if len(question.models) < 2:
        raise ValueError(
            f"{name}: no effects were left to be told apart before the test; `stemwatch screen` "
            "(the verdict, after a bump test) and `stemwatch explain` say what its recording shows"
        )
    test_result = result_of(judge_test(question, recording), name, (recording.start, recording.end))
    views.out.print(_on_terminal(test_result), highlight=False)
    if json_file is not None:
        views.write_json(json_file, to_object(test_result))
    if out is not None:
        _write(test_result, request, out)
    elif test_result.rivals:
        views.say_next("the page with the picture, with --out FOLDER.")


def _recorded(request: Request, valve: str) -> Recording:
    """The recording of the test, of ``valve`` where the source holds several."""
    from stemwatch.service.cli.reading import say_reading_remarks
    from stemwatch.service.explain.requested_recordings import recordings_to_explain
    from stemwatch.service.run.task import recording_of

    candidates = recordings_to_explain(request).valves
    named = [candidate for candidate in candidates if candidate.valve == valve] or list(candidates)
    if len(named) != 1:
        names = ", ".join(candidate.valve for candidate in named[:5]) or "none"
        raise ValueError(
            f"one valve is judged; the recording of the test has {len(named)} ({names}): give its "
            "tags with --op and --mv"
        )
    if named[0].task is None or named[0].reason:
        raise ValueError(named[0].reason or f"{named[0].source}: there is nothing to read")
    recording = recording_of(named[0].task)
    say_reading_remarks([recording.provenance])
    return recording


def _of_store(valve: str, request: Request, db: str, begin: datetime | None) -> OpenQuestion:
    from stemwatch.service.cli import views
    from stemwatch.service.cli.plan_test import known_store, not_screened
    from stemwatch.service.field_test.plan_from_screening import question_before

    with known_store(valve, request.plant, db) as store:
        stored_question = question_before(store, valve, begin)
        if stored_question is None:
            raise not_screened(valve, store)
    question, ended = stored_question
    views.say(f"rivals of the screening that ended {ended:%Y-%m-%d %H:%M} UTC")
    return question


def _of_file(request: Request) -> tuple[str, OpenQuestion]:
    from stemwatch.models.mismatch.open_question import OpenQuestion
    from stemwatch.service.cli.plan_test import explained_file

    explained = explained_file(request)
    return explained.valve, explained.mismatch.open_question or OpenQuestion()


def _write(result: TestResult, request: Request, out: Path) -> None:
    from stemwatch.service.cli import views
    from stemwatch.service.field_test.sheet_files import write_result

    context = views.page_context(result.title, request.plant, request.read_options.zone or "")
    path = write_result(result, context, out).resolve()
    views.out.print(views.escape(f"Page: {path}"), highlight=False, soft_wrap=True)


def _on_terminal(result: TestResult) -> RenderableType:
    """The result as text: what MV followed, what that means, and each rival."""
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    parts: list[RenderableType] = [Text(result.title, style="bold"), Text(result.headline)]
    parts += [Text(f"- {remark}") for remark in result.remarks]
    if not result.rivals:
        return Group(*parts)
    table = Table(box=None, pad_edge=False)
    for name in ("rival", "MV off by, % rms", "its own answers as far", ""):
        table.add_column(name, justify="right" if "%" in name or "as far" in name else "left")
    for rival in result.rivals:
        table.add_row(Text(rival.name), f"{rival.rms:.2f}", rival.as_far, rival.said)
    return Group(*parts, Text(""), table)
