"""``stemwatch inspect``: what is understood of an export."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from stemwatch.service.cli import options as o


def inspect(
    file: Annotated[Path, typer.Argument(help="A CSV or text export of a historian.")],
    zone: o.Zone = "",
    encoding: o.Encoding = "",
    separator: o.Separator = "",
    decimal: o.Decimal = "",
    day_first: o.DayFirst = None,
    time_column: o.TimeColumn = "",
    time_format: o.TimeFormat = "",
    interval_s: o.Interval = None,
    json_file: o.JsonFile = None,
) -> None:
    """Show what is understood of an export, and propose a mapping for plant.toml.

    Encoding, separator, decimal mark, layout, time zone, every tag with unit and role, sampling
    interval and jitter, bad values, gaps, and evidence of compression, quantisation and frozen
    signals. A tag named MV may be the controller output or the valve position: it is never guessed.
    """
    import json

    from rich.syntax import Syntax

    from stemwatch.connectors.historian import HistorianFile
    from stemwatch.service.cli import views
    from stemwatch.service.cli.reading import read_options

    o.need_file(file, "FILE")
    chosen = read_options(
        zone, encoding, separator, decimal, day_first, time_column, time_format, interval_s
    )
    seen = HistorianFile(file, chosen).inspect()
    for table in views.inspection_tables(seen):
        views.out.print(table)
    for line in views.inspection_remarks(seen):
        views.out.print(line, highlight=False)
    views.out.print("\n[bold]Proposed for plant.toml[/] (check the roles before you trust it):\n")
    mapping = Syntax("", "toml", background_color="default").highlight(
        views.as_toml_escapes(seen.plant_toml())
    )
    views.out.print(mapping, soft_wrap=True)  # a line cut at the terminal's edge is no TOML
    if json_file is not None:
        text = json.dumps(seen.to_dict(), indent=1, ensure_ascii=False)
        json_file.write_text(text + "\n", encoding="utf-8")
