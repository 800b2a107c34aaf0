"""``stemwatch benchmark``: recordings with a sealed truth, answers to them, and their score."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stemwatch.models.words import counted
from stemwatch.service.cli import options as o

if TYPE_CHECKING:
    from rich.table import Table

    from stemwatch.service.studies.benchmark.score import BenchmarkScore

benchmark_app = typer.Typer(
    name="benchmark",
    no_args_is_help=True,
    rich_markup_mode="rich",
    help="Valve recordings with a sealed truth, for any program; and the score of its answers.",
)

Folder = Annotated[Path, typer.Argument(help="The benchmark's folder.")]
TruthFile = Annotated[
    Path | None,
    typer.Option("--truth", help="The sealed truth; by default FOLDER-truth.json beside FOLDER."),
]


@benchmark_app.callback()
def _benchmark() -> None:
    """Valve recordings with a sealed truth, for any program; and the score of its answers."""


@benchmark_app.command()
def write(
    folder: Annotated[Path, typer.Argument(help="A new folder, to be given away.")],
    seed: Annotated[
        int | None,
        typer.Option(
            min=0,
            help="The same seed gives the same set. Without it one is drawn that nobody can guess.",
        ),
    ] = None,
    cases: Annotated[int, typer.Option(min=8, max=4000, help="Recordings, by eights.")] = 80,
    truth: TruthFile = None,
    workers: o.Workers = None,
) -> None:
    """Write recordings as plain CSV, a page that says what is asked, and the truth beside them.

    Simulated by force balance, half of the valves stick, half of the recordings have no position.
    The page prints the SHA-256 of the truth, which is not in the folder.
    """
    import secrets

    from stemwatch.service.cli import views
    from stemwatch.service.executors import choose_executor
    from stemwatch.service.studies.benchmark.seal_and_score import truth_file_of, write_benchmark

    truth = truth or truth_file_of(folder)
    with views.progress("simulating", cases) as advance:
        digest = write_benchmark(
            folder,
            truth,
            seed=secrets.randbits(63) if seed is None else seed,
            cases=cases,
            executor=choose_executor(workers),
            on_progress=advance,
        )
    views.say_result(f"{folder}: {cases} recordings, README.md says what is asked")
    views.say_result(f"{truth}: the truth, SHA-256 {digest}")
    views.say_next(
        f"give {folder} away and keep the truth; `stemwatch benchmark answer {folder}` answers it, "
        f"`stemwatch benchmark judge {folder} ANSWERS` scores."
    )


@benchmark_app.command()
def answer(
    folder: Folder,
    out: Annotated[Path, typer.Option(help="The answers file to write.")],
    method: Annotated[
        str, typer.Option(help="stemwatch; horch or he (published formulas); haw (installed).")
    ] = "stemwatch",
    python: Annotated[
        str, typer.Option(help="For haw: the Python that has its package installed.")
    ] = "",
    workers: o.Workers = None,
) -> None:
    """Let a method answer a benchmark. It sees the folder, never the truth."""
    from stemwatch.service.cli import views
    from stemwatch.service.executors import choose_executor
    from stemwatch.service.studies.benchmark.answers import write_answers
    from stemwatch.service.studies.benchmark.methods import method_named, public_cases

    cases, answering = public_cases(folder), method_named(method, python)
    with views.progress("answering", len(cases)) as advance:
        answers = answering(cases, choose_executor(workers), advance)
    write_answers(out, answers)
    views.say_result(f"{out}: what {method} says of {counted(len(cases), 'recording')}")
    views.say_next(f"`stemwatch benchmark judge {folder} {out}`")


@benchmark_app.command()
def judge(
    folder: Folder,
    answers: Annotated[
        list[Path], typer.Argument(help="Answers files; several stand beside each other.")
    ],
    truth: TruthFile = None,
    json_file: o.JsonFile = None,
) -> None:
    """Score answers against the sealed truth, abstentions included.

    First the truth must have the digest that the folder's page prints. No answer is worth 0, the
    truth 1; whoever answers without knowing has no expected score above 0.
    """
    from stemwatch.service.cli import views
    from stemwatch.service.studies.benchmark.seal_and_score import judge as judged
    from stemwatch.service.studies.benchmark.seal_and_score import truth_file_of

    truth = o.need_file(truth or truth_file_of(folder), "--truth")
    scores = {str(file): judged(folder, o.need_file(file, "ANSWERS"), truth) for file in answers}
    scores = dict(sorted(scores.items(), key=lambda item: -item[1].total))
    views.out.print(_table({Path(file).stem: score for file, score in scores.items()}))
    for file, score in scores.items():
        for part in score.parts:
            error = "" if part.error is None else f", median error {part.error:.2f} %"
            views.say_result(
                f"{Path(file).stem}, {part.part}: {part.answered} of {part.asked} answered, "
                f"{part.right} right{error}"
            )
    if json_file is not None:
        objects = {file: asdict(score) for file, score in scores.items()}
        views.write_json(json_file, objects, allow_nan=True)
    views.say_next("the folder's README.md says what each part counts.")


def _table(scores: dict[str, BenchmarkScore]) -> Table:
    from stemwatch.service.cli.views import plain_table
    from stemwatch.service.studies.benchmark.score import PARTS

    table = plain_table("Order of merit: 1 the truth, 0 no answer", ("answers",), ())
    for name in ("total", "95 %", *PARTS):
        table.add_column(name, justify="right")
    for name, score in scores.items():
        table.add_row(
            name,
            f"{score.total:.2f}",
            f"{score.low:.2f} to {score.high:.2f}",
            *(f"{part.score:.2f}" for part in score.parts),
        )
    return table
