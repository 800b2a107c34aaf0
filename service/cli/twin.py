"""``stemwatch twin``: the loop around a valve, fitted and run again as it might be."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stemwatch.service.cli import options as o
from stemwatch.service.cli.reading import RecordingOptions, given_by, recording_options

if TYPE_CHECKING:
    from rich.console import RenderableType

    from stemwatch.models.closed_loop.fitted_loop import FittedLoop, Knocker
    from stemwatch.models.estimate import Estimate
    from stemwatch.models.recording import Recording
    from stemwatch.models.screening_result import Screening
    from stemwatch.service.run.plan import Request
    from stemwatch.service.twin.loop_twin import WhatIf

_what_if = partial(typer.Option, rich_help_panel="What if (instead of the usual five)")
_write = partial(typer.Option, rich_help_panel="For other simulators")


@given_by(recording_options, name="recording")
def twin(
    id_or_file: Annotated[
        str,
        typer.Argument(
            metavar="VALVE", help="A valve of --plant, or a file with the recording of one loop."
        ),
    ],
    S: Annotated[float | None, _what_if("--s", min=0.0, help="Another S, % of OP.")] = None,
    J: Annotated[float | None, _what_if("--j", min=0.0, help="Another J, % of OP.")] = None,
    gain_times: Annotated[
        float, _what_if(min=0.01, max=100.0, help="Controller gain, times the present one.")
    ] = 1.0,
    reset_times: Annotated[
        float, _what_if(min=0.01, max=100.0, help="Reset time, times the present one.")
    ] = 1.0,
    knock: Annotated[str, _what_if(help="A knocker, HEIGHT,EVERY,FOR: % of OP, s, s.")] = "",
    fmu: Annotated[
        Path | None, _write(metavar="FILE.fmu", help="Write the valve as an FMI 3.0 unit.")
    ] = None,
    modelica: Annotated[
        Path | None, _write(metavar="FILE.mo", help="Write the valve as a Modelica block.")
    ] = None,
    json_file: o.JsonFile = None,
    *,
    recording: RecordingOptions,
) -> None:
    """Run the loop of a recording again: repaired, tuned otherwise, or with a knocker.

    The controller's law and the process are fitted to OP, position, PV and SP; the valve has its
    fitted S and J. What else moved the loop is kept and played again, so that each change shows
    what it would have done on the same day, with a 90 % interval. --fmu and --modelica write the
    valve alone, which needs no PV, and run nothing unless a change or --json is asked for.
    """
    from stemwatch.models.closed_loop.what_if import LoopChange
    from stemwatch.service.cli import views
    from stemwatch.service.twin.loop_twin import to_object, usual_changes, what_ifs

    asked = LoopChange(
        S=S, J=J, gain_times=gain_times, reset_times=reset_times, knocker=_knocker(knock)
    )
    _check_ending(fmu, ".fmu", "--fmu")
    _check_ending(modelica, ".mo", "--modelica")
    read, screening = _screened(_request(id_or_file, recording))
    if fmu is not None or modelica is not None:
        _write_models(screening, fmu, modelica)
        if asked == LoopChange() and json_file is None:
            views.say_next(
                "open the model in a simulator; docs/twin.md says what it takes and gives."
            )
            return
    loop = _twin_of(read, screening)
    changes = [("as asked", asked)] if asked != LoopChange() else usual_changes(loop)
    rows = what_ifs(loop, changes)
    views.out.print(_on_terminal(read.valve, loop, rows), highlight=False)
    if json_file is not None:
        views.write_json(json_file, to_object(loop, rows))
    views.say_next(
        "ask for a change of your own with --s, --j, --gain-times, --reset-times or --knock; "
        "repair where the valve is what costs, tune where it is the controller."
    )


def _check_ending(file: Path | None, ending: str, option: str) -> None:
    if file is not None and file.suffix.lower() != ending:
        raise typer.BadParameter(
            f"a file that ends in {ending} is expected, by which other programs know it; received "
            f"{file.name}",
            param_hint=option,
        )


def _write_models(screening: Screening, fmu: Path | None, modelica: Path | None) -> None:
    from stemwatch.models.valve_chain import valve_chain
    from stemwatch.service.cli import views
    from stemwatch.service.twin.simulation_model.write_model import (
        contents_in_words,
        functional_mockup_unit,
        modelica_text,
    )

    chain = valve_chain(screening)
    if isinstance(chain, str):
        raise ValueError(f"{screening.valve}: there is no model to write: {chain}")
    said = [contents_in_words(chain)]
    if fmu is not None:
        unit = functional_mockup_unit(chain)
        views.write_file(fmu, unit.content)
        lacks = f", without a binary: {unit.no_binary}" if unit.no_binary else ""
        said.append(f"Written: {fmu}{lacks}")
    if modelica is not None:
        views.write_file(modelica, modelica_text(chain))
        said.append(f"Written: {modelica}")
    for sentence in said:
        views.out.print(sentence, highlight=False, markup=False, soft_wrap=True)


def _request(id_or_file: str, given: RecordingOptions) -> Request:
    if Path(id_or_file).exists() or given.plant is None:
        return given.request([id_or_file])
    request = given.request([])
    if request.plant is None or id_or_file not in request.plant.valves:
        raise typer.BadParameter(
            f"there is no file {id_or_file}, and {given.plant} has no such valve",
            param_hint="VALVE",
        )
    return replace(request, valves=(id_or_file,))


def _screened(request: Request) -> tuple[Recording, Screening]:
    from stemwatch.models.screening.screen import Case, Options, screen
    from stemwatch.service.cli.reading import say_reading_remarks
    from stemwatch.service.explain.requested_recordings import recordings_to_explain
    from stemwatch.service.run.task import recording_of

    wanted = recordings_to_explain(request).valves
    if len(wanted) != 1 or wanted[0].task is None:
        names = ", ".join(recording.valve for recording in wanted[:5]) or "none"
        why = wanted[0].reason if len(wanted) == 1 else ""
        raise ValueError(
            why
            or f"a twin is of one loop; the file has {len(wanted)} ({names}): give its tags "
            "with --op, --mv, --pv and --sp"
        )
    task = wanted[0].task
    recording = recording_of(task)
    say_reading_remarks([recording.provenance])
    case = Case(recording=recording, known_curve=task.given_curve)
    return recording, screen([case], Options(narx=False))[0]


def _twin_of(recording: Recording, screening: Screening) -> FittedLoop:
    from stemwatch.models.screening.repair import loop_of

    loop = loop_of(recording, screening)
    if isinstance(loop, str):
        raise ValueError(f"{recording.valve}: the loop cannot be run again: {loop}")
    return loop


def _knocker(text: str) -> Knocker | None:
    from stemwatch.models.closed_loop.fitted_loop import Knocker

    if not text:
        return None
    try:
        height, every_s, for_s = (float(part) for part in text.split(","))
    except ValueError:
        height, every_s, for_s = -1.0, 0.0, 0.0
    if not (height > 0.0 and every_s > for_s > 0.0):
        raise typer.BadParameter(
            f"HEIGHT,EVERY,FOR in % of OP and seconds is expected, such as 2,10,2; received {text}",
            param_hint="--knock",
        )
    return Knocker(height=height, every_s=every_s, for_s=for_s)


def _on_terminal(valve: str, loop: FittedLoop, rows: list[WhatIf]) -> RenderableType:
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    from stemwatch.service.cli.views import escape
    from stemwatch.service.presenter.wording import figure
    from stemwatch.service.twin.loop_twin import settings_in_words

    table = Table(box=None, pad_edge=False)
    heads = (f"std of SP - PV, {loop.unit}", "variance saved, %", "amplitude", "period, s")
    for name in ("", *heads):
        table.add_column(name, justify="right" if name else "left")
    first = rows[0].prediction
    for name, seen in (("recorded", first.recorded), ("run as it is", first.as_it_is)):
        numbers = (seen.error_std, None, seen.amplitude, seen.period_s)
        table.add_row(name, *("" if number is None else figure(number) for number in numbers))
    for row in rows:
        told = row.prediction.predicted
        saved = row.prediction.fall("error_std", squared=True)
        plain = (figure(told[name].value) for name in ("amplitude", "period_s"))
        table.add_row(row.name, _with_interval(told["error_std"]), _with_interval(saved), *plain)
    words = Text.from_markup(escape(settings_in_words(loop)))
    return Group(Text(f"Twin of {valve}", style="bold"), words, Text(""), table)


def _with_interval(estimate: Estimate) -> str:
    from stemwatch.service.presenter.wording import figure

    if estimate.value is None:
        return "–"
    return f"{figure(estimate.value)} ({figure(estimate.low)} to {figure(estimate.high)})"
