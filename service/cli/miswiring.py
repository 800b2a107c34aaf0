"""``stemwatch miswiring``: tags and ranges that are mixed up, and what is answered."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from stemwatch.service.cli import options as o

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stemwatch.service.studies.miswiring import WiringRow


def miswiring(
    loops: Annotated[
        int, typer.Option(min=1, max=1000, help="Valves, sticking and healthy in turn.")
    ] = 10,
    seed: o.Seed = 2034,
    kind: Annotated[
        list[str] | None,
        typer.Option(help="Only kinds whose name contains this; may be given several times."),
    ] = None,
    workers: o.Workers = None,
    json_file: o.JsonFile = None,
) -> None:
    """Count confident wrong answers on valves whose tags or ranges are mixed up.

    Sticking and healthy valves are simulated once, and each recording is then wired up wrongly in
    one way at a time: milliamperes for percent, swapped tags, another valve's position, copies of
    OP, clocks minutes apart. Wrong is sticky or watch for a healthy valve, healthy for a sticking
    one; confidently wrong with a confidence of 0.8 or more.
    """
    from stemwatch.service.cli import views
    from stemwatch.service.executors import choose_executor
    from stemwatch.service.studies.miswiring import KINDS, rows, run_miswiring

    kinds = o.names_that_hold(kind, KINDS, "--kind", "kind")
    views.say_if_not_blind(seed)
    with views.progress("recordings", loops * len(kinds)) as advance:
        answers = run_miswiring(loops, seed, kinds, choose_executor(workers), advance)
    _print(list(rows(answers)))
    views.write_answers(answers, json_file)
    views.say_read_on("miswiring.md")


def _print(rows: Sequence[WiringRow]) -> None:
    from rich.table import Table

    from stemwatch.service.cli import views

    table = Table(title="Tags and ranges mixed up", title_justify="left")
    table.add_column("the recording has ...")
    for name in ("wrong", "undetermined", "right", "said"):
        table.add_column(name, justify="right")
    table.add_column("why the undetermined have no verdict")
    for row in rows:
        table.add_row(
            row.kind,
            f"{row.confidently_wrong}, {row.wrong} of {row.valves}",
            str(row.undetermined),
            str(row.right),
            str(row.converted),
            row.reason,
        )
    views.out.print(table)
    wrong, valves = sum(row.confidently_wrong for row in rows), sum(row.valves for row in rows)
    views.out.print(
        f"{wrong} of {valves} wrong with a confidence of 0.8 or more. Columns: wrong, with that "
        "confidence and with any; right, neither wrong nor undetermined; said, those of the right "
        "ones with a sentence on what was read otherwise.",
        highlight=False,
    )
