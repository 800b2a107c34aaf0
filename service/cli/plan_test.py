"""``stemwatch plan-test``: the field test that decides between the explanations a recording left
open."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stemwatch.service.cli import options as o
from stemwatch.service.cli.reading import RecordingOptions, given_by, recording_options

if TYPE_CHECKING:
    from rich.console import RenderableType

    from stemwatch.models.field_test.plan import FieldTestPlan
    from stemwatch.models.field_test.programme import TestLimits
    from stemwatch.service.config import Plant
    from stemwatch.service.explain.explain_recording import Explained
    from stemwatch.service.field_test.sheet import TestSheet
    from stemwatch.service.run.plan import Request
    from stemwatch.service.store.store import Store

LIMITS = "Limits of the test"


@given_by(recording_options, name="recording")
def plan_test(
    id_or_file: Annotated[
        str,
        typer.Argument(
            metavar="VALVE", help="The valve's id in the store, or a file as explain takes it."
        ),
    ],
    db: Annotated[str, typer.Option(help="Database URL, instead of the plant's.")] = "",
    amplitude: Annotated[
        float,
        typer.Option(help="How far OP may go either way, percent.", rich_help_panel=LIMITS),
    ] = 5.0,
    minutes: Annotated[
        float, typer.Option(help="How long the test may take.", rich_help_panel=LIMITS)
    ] = 10.0,
    pv_upset: Annotated[
        float | None,
        typer.Option(
            help="How far PV may change, in its unit; else as far as it moved in the recording.",
            rich_help_panel=LIMITS,
        ),
    ] = None,
    op_low: Annotated[
        float, typer.Option(help="OP never below this, percent.", rich_help_panel=LIMITS)
    ] = 5.0,
    op_high: Annotated[
        float, typer.Option(help="OP never above this, percent.", rich_help_panel=LIMITS)
    ] = 95.0,
    op_now: Annotated[
        float | None,
        typer.Option(help="Where OP is, percent; else where the recording ended."),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for the sheet, HTML and PDF.")] = None,
    json_file: o.JsonFile = None,
    *,
    recording: RecordingOptions,
) -> None:
    """Plan the test that would tell what a recording left open, within limits.

    A person sets OP by hand as the sheet says; stemwatch never writes to a plant. It plans from the
    valve's last screening in the store, or explains the file it is given. It says when nothing is
    left to be told apart, and when no test within the limits can tell.
    """
    from stemwatch.models.field_test.programme import TestLimits
    from stemwatch.service.cli import views
    from stemwatch.service.field_test.sheet import sheet_of, to_object

    limits = TestLimits(
        amplitude=amplitude,
        duration_s=60.0 * minutes,
        pv_upset=pv_upset,
        op_low=op_low,
        op_high=op_high,
    )
    if Path(id_or_file).is_file():
        name, plan, loaded = _of_file(recording.request([id_or_file]), limits, op_now)
    else:
        if db or recording.plant is not None:
            _refuse_of_file(id_or_file, recording)
        name, plan, loaded = _of_store(id_or_file, recording.plant, db, limits, op_now)
    sheet = sheet_of(plan, name)
    views.out.print(_on_terminal(sheet), highlight=False)
    if json_file is not None:
        views.write_json(json_file, to_object(sheet))
    if out is not None:
        _write(sheet, loaded, recording.read_options.zone or "", out)
    elif sheet.test is not None:
        views.say_next("the sheet to print, with --out FOLDER.")


def _refuse_of_file(valve: str, options: RecordingOptions) -> None:
    """Wrong usage where options that say what is read of a file come with a valve of the store;
    the zone is that of the sheet's times, too."""
    from stemwatch.connectors.historian.options import given_options

    window = {"from": options.start, "to": options.stop, "valve": options.valve}
    option_names = [role.value for role in options.tags]
    option_names += [name for name, value in window.items() if value]
    option_names += [name for name in given_options(options.read_options) if name != "zone"]
    if option_names:
        option = "--" + option_names[0].replace("_", "-")
        raise typer.BadParameter(
            f"{option} says how a file is read, and {valve} is not a file; leave it out for a "
            "valve of the store, or give the path of its export",
            param_hint=option,
        )


def _of_store(
    valve: str, plant: Path | None, db: str, limits: TestLimits, op_now: float | None
) -> tuple[str, FieldTestPlan, Plant | None]:
    from stemwatch.service.config import load_plant
    from stemwatch.service.field_test.plan_from_screening import PlanCache

    loaded = load_plant(o.need_file(plant, "--plant")) if plant is not None else None
    with known_store(valve, loaded, db) as store:
        plan = PlanCache().plan(store, valve, limits, op_now)
        if plan is None:
            raise not_screened(valve, store)
    return valve, plan, loaded


def known_store(valve: str, plant: Plant | None, db: str) -> Store:
    """The store that should know ``valve``; wrong usage where none is named."""
    from stemwatch.service.store.store import open_existing_store

    if not db and plant is None:
        raise typer.BadParameter(
            f"there is no file {valve}; for a valve of the store give --plant FILE or --db URL",
            param_hint="VALVE",
        )
    return open_existing_store(db or (plant.storage if plant else db))


def not_screened(valve: str, store: Store) -> typer.BadParameter:
    """That the store has no screening of ``valve``, and which valves it has."""
    examples = ", ".join(valve.id for valve in store.valves()[:5]) or "none"
    return typer.BadParameter(
        f"{valve} was not screened into this store; it has {examples}. Run `stemwatch screen`, or "
        "give a file",
        param_hint="VALVE",
    )


def _of_file(
    request: Request, limits: TestLimits, op_now: float | None
) -> tuple[str, FieldTestPlan, Plant | None]:
    from stemwatch.service.field_test.plan_from_screening import plan_of

    explained = explained_file(request)
    plan = plan_of(explained.mismatch, limits, judged=False, op=op_now)
    return explained.valve, plan, request.plant


def explained_file(request: Request) -> Explained:
    """The one recording of a file, explained."""
    from stemwatch.service.explain.explain_recording import Job, explain_one
    from stemwatch.service.explain.requested_recordings import recordings_to_explain

    candidates = recordings_to_explain(request).valves
    if len(candidates) != 1:
        names = ", ".join(task.valve for task in candidates[:5]) or "none"
        raise ValueError(
            f"a test is planned for one valve; the file has {len(candidates)} ({names}): give "
            "its tags with --op and --mv, or screen the file and name the valve with --db"
        )
    from stemwatch.service.cli.reading import say_reading_remarks

    explained = explain_one(Job(to_explain=candidates[0], narx=False))
    if explained.recording is None:
        raise ValueError(explained.mismatch.sentence)
    say_reading_remarks([explained.recording.provenance])
    return explained


def _write(sheet: TestSheet, plant: Plant | None, zone: str, out: Path) -> None:
    from stemwatch.service.cli import views
    from stemwatch.service.field_test.sheet_files import write_sheet

    context = views.page_context(sheet.title, plant, zone)
    page, paper = write_sheet(sheet, context, out)
    for path in (page, paper):
        views.out.print(views.escape(f"Sheet: {path.resolve()}"), highlight=False, soft_wrap=True)


def _on_terminal(sheet: TestSheet) -> RenderableType:
    """The sheet as text: what is done when, what to watch, when to stop, what it means."""
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    from stemwatch.service.cli.views import escape

    def line(text: str) -> Text:
        return Text.from_markup(escape(text))

    parts: list[RenderableType] = [Text(sheet.title, style="bold"), line(sheet.headline)]
    parts += [line(f"- {remark}") for remark in sheet.remarks]
    if sheet.test is None:
        return Group(*parts)
    legs = Table(title="The test", title_justify="left", box=None, pad_edge=False)
    for name in ("at", "OP, %", "change", "how"):
        legs.add_column(name, justify="left" if name == "how" else "right")
    legs.add_row("0:00", f"{sheet.plan.op:.1f}", "0", "manual; leave OP where it is")
    for leg in sheet.moves:
        legs.add_row(leg.clock, f"{leg.to:.1f}", leg.shift, leg.words)
    looks = Table(title="Watch", title_justify="left", box=None, pad_edge=False)
    for name in ("at", "OP, %", *(f"MV, {name}" for name in sheet.rivals)):
        looks.add_column(name, justify="right")
    for reading in sheet.readings:
        looks.add_row(reading.clock, f"{reading.op:.1f}", *(f"{mv:.1f}" for mv in reading.mv))
    parts += [Text(""), *(line(step) for step in sheet.before), Text(""), legs, Text(""), looks]
    parts.append(line(sheet.passes))
    parts += [
        line(f"{outcome.name}: {outcome.means}. {outcome.then}".rstrip())
        for outcome in sheet.outcomes
    ]
    parts += [line("Stop when:"), *(line(f"- {reason}") for reason in sheet.stop)]
    return Group(*parts, line(sheet.after))
