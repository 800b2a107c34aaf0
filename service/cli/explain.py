"""``stemwatch explain``: where simulation and recording differ, and what physics was left out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stemwatch.service.cli import options as o
from stemwatch.service.cli.reading import given_by, requested, say_reading_remarks

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stemwatch.models.limits import Limits
    from stemwatch.service.explain.explain_recording import Explained
    from stemwatch.service.explain.requested_recordings import RecordingToExplain
    from stemwatch.service.run.plan import Request

MOST_REASONS = 5  # reasons that are listed when nothing could be read
TITLE = "Where simulation and recording differ"


@given_by(requested, name="request")
def explain(
    request: Request,
    narx: Annotated[
        bool,
        typer.Option(
            "--narx/--no-narx", help="Train the network that shows what could be explained."
        ),
    ] = True,
    out: Annotated[
        Path | None, typer.Option(help="Folder for a page with traces and maps.")
    ] = None,
    json_file: o.JsonFile = None,
    workers: o.Workers = None,
) -> None:
    """Say where S and J alone do not follow a recording, and which physics they leave out.

    It shows where the residual is, names the effect from a catalogue or gives the candidates, fits
    it, and restates S and J with it. It also lists what the recording could not have shown.
    """
    _report(_explained(request, narx, workers), request, out, json_file)


def _explained(request: Request, narx: bool, workers: int | None) -> list[Explained]:
    """The explanations of all requested recordings, in their order."""
    from stemwatch.models.limits import Limits
    from stemwatch.service.cli import views
    from stemwatch.service.explain.requested_recordings import recordings_to_explain

    plant = request.plant
    for problem in plant.problems if plant else ():
        views.say_error(str(problem))
    work = recordings_to_explain(request)
    for source, reason in work.left_out:
        views.say(f"left out: {source}: {reason}")
    limits = plant.limits if plant else Limits()
    return _worked(work.valves, narx, limits, workers)


def _worked(
    recordings: Sequence[RecordingToExplain], narx: bool, limits: Limits, workers: int | None
) -> list[Explained]:
    from stemwatch.service.cli import views
    from stemwatch.service.executors import choose_executor, results_in_order
    from stemwatch.service.explain.explain_recording import Job, explain_one

    jobs = [Job(to_explain=task, narx=narx, limits=limits) for task in recordings]
    with views.progress("explaining", len(jobs), transient=True) as advance:
        return results_in_order(choose_executor(workers), explain_one, jobs, advance)


def _report(
    valves: Sequence[Explained], request: Request, out: Path | None, json_file: Path | None
) -> None:
    from stemwatch.service.cli import views
    from stemwatch.service.cli.explanation_views import explanation, tally

    if json_file is not None:
        from stemwatch.service.explain.explain_json import to_json

        views.write_file(json_file, to_json(valves))
    say_reading_remarks(
        valve.recording.provenance for valve in valves if valve.recording is not None
    )
    if not any(explained.recording is not None for explained in valves):
        reasons = dict.fromkeys(explained.mismatch.sentence.rstrip(".") for explained in valves)
        reason_list = "; ".join([*reasons][:MOST_REASONS]) or "no source holds a recording"
        views.say_error(f"nothing could be explained: {reason_list}.")
        raise typer.Exit(2)
    for explained in valves:
        views.out.print(explanation(explained), highlight=False)
    if len(valves) > 1:
        views.out.print(tally(valves), highlight=False)
    if out is not None:
        written = str(_write(valves, request, out).resolve())
        views.out.print(f"Page: {views.escape(written)}", highlight=False, soft_wrap=True)
    first = "open the page" if out is not None else "see strokes, loops and maps, with --out FOLDER"
    views.say_next(
        f"{first}; what to check stands under each effect. `stemwatch plan-test` plans the test "
        "that tells what was left open."
    )


def _write(valves: Sequence[Explained], request: Request, out: Path) -> Path:
    """Write the page and return its files; times are in the plant's zone, else the given zone, else
    UTC."""
    from stemwatch.service.cli import views
    from stemwatch.service.explain.write_explanation import write_pages

    context = views.page_context(TITLE, request.plant, request.read_options.zone or "")
    return write_pages(valves, context, out).html
