"""``stemwatch compare``: how well each stiction model of the literature fits one valve."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stemwatch.service.cli import options as o
from stemwatch.service.cli.reading import (
    given_by,
    read_options,
    request_of,
    say_reading_remarks,
    tags_of,
)

if TYPE_CHECKING:
    from rich.table import Table

    from stemwatch.connectors.historian import ReadOptions
    from stemwatch.models.recording import Recording
    from stemwatch.models.studies.literature.scores import FitScore
    from stemwatch.service.run.plan import Request
    from stemwatch.service.studies.comparison.compare_models import Comparison, ModelRow

PAGE = "compare.html"


@given_by(read_options, name="options")
def compare(
    file: Annotated[Path, typer.Argument(help="A CSV or text export of a historian.")],
    op: o.OpTag = "",
    mv: o.MvTag = "",
    valve: o.ValveName = "",
    from_: o.From = "",
    to: o.To = "",
    train_share: Annotated[
        float, typer.Option(min=0.1, max=1.0, help="First part of the record that is fitted.")
    ] = 0.6,
    narx: Annotated[
        bool, typer.Option("--narx/--no-narx", help="Train the networks as well.")
    ] = True,
    out: Annotated[
        Path | None, typer.Option(help="Folder for a page with the models' traces.")
    ] = None,
    json_file: o.JsonFile = None,
    *,
    options: ReadOptions,
) -> None:
    """Fit every stiction model of the literature to one valve and score them alike.

    Data-driven models, force balances, two published networks and our own, all fitted to the first
    part of the record and judged by their free run over the rest. It says which model follows, not
    whether the valve is faulty: `stemwatch screen` says that.
    """
    o.need_file(file, "FILE")
    request = request_of([str(file)], None, tags_of(op=op, mv=mv), valve, from_, to, options)
    recording = _the_recording(request, file)
    say_reading_remarks([recording.provenance])
    _report(_compared(recording, train_share, narx), out, json_file)


def _the_recording(request: Request, file: Path) -> Recording:
    """The recording of the file's only valve. Raises ``typer.BadParameter`` for none or several."""
    from stemwatch.service.run.plan import make_plan
    from stemwatch.service.run.task import open_file

    tasks = make_plan(request).tasks
    if len(tasks) != 1:
        names = ", ".join(task.tags.valve for task in tasks)
        raise typer.BadParameter(
            f"one valve at a time: {file} has {len(tasks)} ({names}); choose with --op and --mv"
        )
    (task,) = tasks
    if task.reason:
        raise typer.BadParameter(task.reason)
    return open_file(task.path, task.read_options).read(task.tags, task.window)


def _compared(recording: Recording, train_share: float, network: bool) -> Comparison:
    from rich.progress import Progress

    from stemwatch.service.cli import views
    from stemwatch.service.studies.comparison.compare_models import compare as compare_models

    train_until = max(round(train_share * len(recording)), 1)
    with Progress(console=views.err, transient=True) as progress:
        bar = progress.add_task("models")

        def show_progress(model: str, finished: int, total: int) -> None:
            progress.update(bar, completed=finished, total=total, description=model)

        return compare_models(recording, train_until, network=network, on_progress=show_progress)


def _report(comparison: Comparison, out: Path | None, json_file: Path | None) -> None:
    from stemwatch.service.cli import views

    views.out.print(_table(comparison))
    for row in comparison.ranked():
        if row.outcome:
            views.say(f"{row.model}: {row.outcome}")
    if json_file is not None:
        objects = [row.as_json() for row in comparison.ranked()]
        views.write_json(json_file, objects)
    if out is not None:
        from stemwatch.service.studies.comparison.comparison_html import html_bytes

        out.mkdir(parents=True, exist_ok=True)
        (out / PAGE).write_bytes(html_bytes(comparison))
        page = (out / PAGE).resolve()
        views.out.print(f"Page: {page}", highlight=False, soft_wrap=True)
    views.say_next("`stemwatch explain FILE` says what S and J leave out of this recording.")


def _table(comparison: Comparison) -> Table:
    """The models, best first; a narrow terminal shows the held-out scores only."""
    from rich.markup import escape
    from rich.table import Table

    from stemwatch.service.cli import views

    wide = views.out.width >= views.WIDE
    share = comparison.train_until / max(len(comparison.recording), 1)
    title = f"{comparison.recording.valve}: fitted to the first {share:.0%}, judged on the rest"
    table = Table(title=escape(title), title_justify="left")
    table.add_column("model", no_wrap=True)
    for mark in ("RMSE, %", "fit, %", "direction, %"):
        table.add_column(f"held out\n{mark}", justify="right", no_wrap=True)
    table.add_column("training\nRMSE, %", justify="right", no_wrap=True)
    if wide:
        table.add_column("training\nfit, %", justify="right", no_wrap=True)
        table.add_column("training\ndirection, %", justify="right", no_wrap=True)
        table.add_column("parameters")
    table.add_column("s", justify="right", no_wrap=True)
    for row in comparison.ranked():
        marks = [*_marks(row.heldout), *_marks(row.training)]
        table.add_row(
            row.model,
            *(marks if wide else marks[:4]),
            *([escape(_parameters(row))] if wide else []),
            f"{row.seconds:.1f}",
        )
    return table


def _parameters(row: ModelRow) -> str:
    named = row.parameters.items()
    return ", ".join(f"{name} {estimate}" for name, estimate in named if estimate.value is not None)


def _marks(score: FitScore | None) -> tuple[str, str, str]:
    if score is None:
        return "-", "-", "-"
    return f"{score.rmse:.3g}", f"{score.fit_percent:.1f}", f"{score.direction_percent:.1f}"
