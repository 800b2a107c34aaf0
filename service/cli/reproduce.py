"""``stemwatch reproduce paper``: a published study done again, and our own network beside it."""

from __future__ import annotations

from enum import StrEnum
from typing import TYPE_CHECKING, Annotated, Any

import typer

from stemwatch.service.cli import options as o

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.table import Table

    from stemwatch.models.studies.reproduction.study import CaseResult, Result, Target, Unseen


class Study(StrEnum):
    """Which study to reproduce."""

    PAPER = "paper"


def reproduce(
    study: Annotated[
        Study, typer.Argument(help="paper: Zabiri et al., neural networks of stiction.")
    ],
    seeds: Annotated[int, typer.Option(min=1, max=100, help="Networks of each kind.")] = 5,
    workers: o.Workers = None,
    json_file: o.JsonFile = None,
) -> None:
    """Train the networks of a paper on its four cases, and ours, and print all errors.

    The cases are free of noise: a sine through a stick-slip element with dead band, undershoot, no
    offset and overshoot. RMSE and CDC stand beside the paper's figures, with their spread over
    seeds; then every network is run on inputs it was not trained on. The same number of seeds gives
    the same result twice. About two minutes on two cores.
    """
    from stemwatch.models.studies.reproduction.cases import CASES
    from stemwatch.models.studies.reproduction.study import StudyTask
    from stemwatch.models.studies.reproduction.study import study as study_case
    from stemwatch.service.cli import views
    from stemwatch.service.executors import choose_executor, results_in_order

    tasks = [StudyTask(case=case, seeds=seeds) for case in CASES]
    with views.progress("cases", len(tasks)) as advance:
        results = results_in_order(choose_executor(workers), study_case, tasks, advance)
    show(results, seeds)
    if json_file is not None:
        views.write_json(json_file, as_json(results, seeds))
    views.say_read_on("paper.md")


def as_json(results: Sequence[CaseResult], seeds: int) -> dict[str, Any]:
    """The complete result as JSON."""
    from dataclasses import asdict

    from stemwatch.models.studies.reproduction.cases import AMPLITUDE, PERIODS, SAMPLES_PER_PERIOD
    from stemwatch.models.studies.reproduction.layers import SIZES
    from stemwatch.models.studies.reproduction.network_step import LIMIT
    from stemwatch.models.studies.reproduction.study import targets

    return {
        "study": "Zabiri, Samyudia and Zainudin: neural network modeling of valve stiction",
        "amplitude": AMPLITUDE,
        "samples_per_period": SAMPLES_PER_PERIOD,
        "periods": PERIODS,
        "layer_sizes": list(SIZES),
        "runs_held_within": LIMIT,
        "seeds": seeds,
        "cases": [asdict(result) for result in results],
        "targets": [
            {**asdict(target), "met": target.met} for case in results for target in targets(case)
        ],
    }


def show(results: Sequence[CaseResult], seeds: int) -> None:
    """The settings, the paper's table, new inputs case by case, and the targets."""
    from stemwatch.models.studies.reproduction.cases import AMPLITUDE, PERIODS, SAMPLES_PER_PERIOD
    from stemwatch.models.studies.reproduction.layers import SIZES
    from stemwatch.models.studies.reproduction.study import targets
    from stemwatch.service.cli import views

    views.out.print(
        f"Sine of amplitude {AMPLITUDE:g}, {SAMPLES_PER_PERIOD} samples a period, {PERIODS} "
        f"periods after the first; {seeds} seeds. The paper's networks: layers of "
        f"{', '.join(map(str, SIZES))}; feedforward from u(t), NARX from y(t-1), y(t-2), u(t-1), "
        "u(t-2). The paper states none of these, nor S and J.",
        highlight=False,
    )
    views.out.print(_sine_table(results))
    views.out.print(
        "RMSE: median of the seeds (lowest to highest), in amplitudes. CDC: correct directional "
        "change; no model can have more than the share of samples at which the stem moves. Ours "
        "with a fitted start is grey-box: it begins as the stick-slip element that the product's "
        "own fit found in the record that the network is then trained on.",
        highlight=False,
    )
    for case in results:
        views.out.print(_unseen_table(case, views.out.width >= views.WIDE))
    _print_targets([target for case in results for target in targets(case)])


def _sine_table(results: Sequence[CaseResult]) -> Table:
    from rich.table import Table

    table = Table(title="The paper's sine, free run", title_justify="left")
    for name in ("case", "network", "trained on"):
        table.add_column(name)
    for name in ("RMSE", "paper", "CDC, %", "paper"):
        table.add_column(name, justify="right")
    for case in results:
        S_J = f"S {case.case.S:g}, J {case.case.J:g}"
        case_cells = [case.case.shape.value, S_J, f"moves {case.moving_percent:.0f} %"]
        case_cells += [""] * (len(case.results) - len(case_cells))
        for case_cell, result in zip(case_cells, case.results, strict=True):
            table.add_row(case_cell, *_sine_row(result))
        table.add_section()
    return table


def _sine_row(result: Result) -> tuple[str, ...]:
    import numpy as np

    paper = result.published
    cdc = paper.cdc_percent if paper else None
    return (
        result.network,
        result.trained_on,
        _spread(result.rmse),
        f"{paper.rmse:.4f}" if paper else "",
        f"{np.median(result.cdc_percent):.0f}",
        f"{cdc:.0f}" if cdc is not None else "",
    )


def _unseen_table(case: CaseResult, wide: bool) -> Table:
    from rich.table import Table

    families = case.results[0].unseen
    columns_text = "median | four in five at most | largest" if wide else "median"
    title = (
        f"{case.case.shape.value}: RMSE on {families[0].inputs} inputs of each kind that no "
        f"network was trained on; {columns_text}"
    )
    table = Table(title=title, title_justify="left")
    for name in ("network", *(family.family for family in families)):
        table.add_column(name)
    for result in case.results:
        table.add_row(result.network, *(_unseen_cell(unseen, wide) for unseen in result.unseen))
    return table


def _unseen_cell(unseen: Unseen, wide: bool) -> str:
    if not wide:
        return _short(unseen.median)
    return f"{_short(unseen.median)} | {_short(unseen.eightieth)} | {_short(unseen.largest)}"


def _print_targets(targets: Sequence[Target]) -> None:
    from stemwatch.service.cli import views

    met = sum(target.met for target in targets)
    views.out.print(f"Targets of ours, fitted start: {met} of {len(targets)} met.", highlight=False)
    for target in targets:
        if not target.met:
            views.out.print(
                f"Missed: {target.shape.value}, {target.what}: {_short(target.found)}, at most "
                f"{target.limit:g} was wanted.",
                highlight=False,
            )


def _spread(values: Sequence[float]) -> str:
    import numpy as np

    middle = _short(float(np.median(values)))
    if len(values) == 1:
        return middle
    return f"{middle} ({_short(min(values))} to {_short(max(values))})"


def _short(value: float) -> str:
    """Four decimals, as the paper has them; smaller values by their power of ten."""
    return f"{value:.4f}" if value >= 1e-4 else f"{value:.0e}"
