"""``stemwatch inspect``: what is understood of an export."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stemwatch.service.cli import options as o
from stemwatch.service.cli.reading import given_by, read_options

if TYPE_CHECKING:
    from stemwatch.connectors.historian import HistorianFile, ReadOptions


@given_by(read_options, name="options")
def inspect(
    file: Annotated[Path, typer.Argument(help="A CSV or text export of a historian.")],
    json_file: o.JsonFile = None,
    write: Annotated[
        Path | None,
        typer.Option(help="Write the proposed plant file here, unless it is there already."),
    ] = None,
    *,
    options: ReadOptions,
) -> None:
    """Show what is understood of an export, and propose a mapping for plant.toml.

    Where OP strokes a valve by a curve, as in a split range, the curve is proposed as well.

    Encoding, separator, decimal mark, layout, time zone, every tag with unit and role, sampling
    interval and jitter, bad values, gaps, and evidence of compression, quantisation and frozen
    signals. A tag named MV may be the controller output or the valve position: it is never guessed.
    """
    import json
    from dataclasses import replace

    from rich.markup import escape
    from rich.syntax import Syntax

    from stemwatch.connectors.historian import HistorianFile
    from stemwatch.service.cli import views

    o.need_file(file, "FILE")
    if write is not None and write.exists():
        raise typer.BadParameter(
            f"{write} exists and is not overwritten; name another file", param_hint="--write"
        )
    source = HistorianFile(file, options)
    inspection = source.inspect()
    for table in views.inspection_tables(inspection):
        views.out.print(table)
    for line in views.inspection_remarks(inspection):
        views.out.print(line, highlight=False)
    if json_file is not None:
        text = json.dumps(inspection.to_dict(), indent=1, ensure_ascii=False)
        json_file.write_text(text + "\n", encoding="utf-8")
    if write is not None:
        proposed = replace(inspection, source=_seen_from(write, file)).plant_toml(
            curves=_curves(source)
        )
        write.write_text(proposed, encoding="utf-8")
        views.out.print(f"\n{escape(str(write))} is written. Check the roles in it; then")
        views.out.print(f"  stemwatch screen --plant {escape(str(write))}", soft_wrap=True)
        return
    views.out.print("\n[bold]Proposed for plant.toml[/] (check the roles before you trust it):\n")
    mapping = Syntax("", "toml", background_color="default").highlight(
        views.as_toml_escapes(inspection.plant_toml(curves=_curves(source)))
    )
    views.out.print(mapping, soft_wrap=True)  # a line cut at the terminal's edge is no TOML
    views.say_next(
        "keep it with --write plant.toml, or screen the file itself: stemwatch screen FILE"
    )


def _seen_from(plant_file: Path, export: Path) -> str:
    """The path of ``export`` as ``plant_file`` must give it, where relative paths count from it."""
    folder, export = plant_file.resolve().parent, export.resolve()
    return (export.relative_to(folder) if export.is_relative_to(folder) else export).as_posix()


def _curves(source: HistorianFile) -> dict[str, str]:
    """The lines that give the curves from OP to stroke, for valves whose position is certain."""
    from stemwatch.connectors.connector import ConnectorError
    from stemwatch.connectors.historian import propose_valves
    from stemwatch.models.recording import Role

    measured = [valve for valve in propose_valves(source) if Role.MV in valve.tags]
    if not measured:
        return {}
    from stemwatch.models.limits import Limits
    from stemwatch.models.own_clock import on_own_clock  # with what is compiled
    from stemwatch.models.quality import assess
    from stemwatch.models.stickslip.find_stroke_curve import find_stroke_curve

    curves = {}
    for valve in measured:
        try:
            assessment = assess(on_own_clock(source.read(valve)), Limits())
        except ConnectorError:
            continue  # screening the valve says why
        curve = None if assessment.obstacles else find_stroke_curve(assessment.recording)
        if curve is not None and curve.proposal():
            curves[valve.valve] = curve.proposal()
    return curves
