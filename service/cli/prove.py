"""``stemwatch prove``: hidden physics, drawn blind, sealed, judged and counted."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stemwatch.service.cli import options as o

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stemwatch.models.studies.simulator.hidden import HiddenCase
    from stemwatch.service.executors import Executor
    from stemwatch.service.studies.proof.marks import CaseMark
    from stemwatch.service.studies.proof.truth import Seal

TRUTH_FILE = "truth.json"


def prove(
    seed: o.Seed = 2142,
    cases: Annotated[int, typer.Option(min=1, max=20_000, help="Recordings to draw.")] = 400,
    json_file: o.JsonFile = None,
    effect: Annotated[
        str, typer.Option(help="Only this effect, by its slug, such as actuator_lag.")
    ] = "",
    concealment: Annotated[
        str, typer.Option(help="Only records made this hard to see in, such as quantised.")
    ] = "",
    keep: Annotated[
        Path | None, typer.Option(help="Leave the CSV files and the opened truth here.")
    ] = None,
    narx: Annotated[
        bool, typer.Option("--narx/--no-narx", help="Let explain train the network as well.")
    ] = False,
    workers: o.Workers = None,
) -> None:
    """Run a blind trial of `stemwatch explain` on simulated valves with hidden physics.

    Effects are drawn at random, written into valves of a force-balance plant, and concealed:
    smaller than S, noisy, quantised, compressed, in a quiet loop, in a short record. Among them are
    valves with nothing hidden, with two effects, and with effects outside the catalogue. The truth
    is sealed and its digest printed before anything is judged; the judge is another process and
    gets CSV files only; the opened truth is checked against the digest. Every rate has its 95 %
    interval and stands beside what it has to reach.
    """
    from stemwatch.service.cli import views
    from stemwatch.service.executors import choose_executor
    from stemwatch.service.studies.proof.draw import draw_cases
    from stemwatch.service.studies.seeds import LIMITS_CALIBRATED_WITH

    if seed in LIMITS_CALIBRATED_WITH:
        views.say(f"Seed {seed} is one that thresholds were calibrated with: this is not blind.")
    hidden_cases = draw_cases(cases, seed, effect, concealment)
    with _folder(keep) as folder:
        options = () if narx else ("--no-narx",)
        sealed, marks = _trial(hidden_cases, seed, folder, choose_executor(workers), options)
        if keep is not None:
            (keep / TRUTH_FILE).write_text(sealed.text, encoding="utf-8", newline="\n")
    _report(marks, sealed, seed, json_file)
    views.say_read_on("proof.md")


@contextmanager
def _folder(keep: Path | None) -> Iterator[Path]:
    """Where the CSV files lie. A kept folder must be empty: the judge is to see nothing else."""
    if keep is None:
        with tempfile.TemporaryDirectory(prefix="stemwatch-") as home:
            yield Path(home)
        return
    keep.mkdir(parents=True, exist_ok=True)
    if any(keep.iterdir()):
        raise typer.BadParameter(
            f"{keep} is not empty; give a new folder, so that the judge sees nothing else",
            param_hint="--keep",
        )
    yield keep


def _trial(
    cases: Sequence[HiddenCase],
    seed: int,
    folder: Path,
    executor: Executor,
    options: Sequence[str],
) -> tuple[Seal, list[CaseMark]]:
    """Draw and seal, say the digest, judge, open, count."""
    from stemwatch.service.cli import views
    from stemwatch.service.studies.proof.answers import judge
    from stemwatch.service.studies.proof.draw import write_cases
    from stemwatch.service.studies.proof.rates import score

    with views.progress("simulating", len(cases)) as advance:
        sealed = write_cases(cases, seed, folder, executor, advance)
    views.out.print(
        f"Truth of {len(cases)} cases sealed, SHA-256 {sealed.digest}",
        highlight=False,
        soft_wrap=True,
    )
    files = sorted(path.name for path in folder.iterdir())
    with views.progress("judging", len(files)) as advance:
        answers = judge(folder, files, executor, advance, options)
    return sealed, score(sealed.open(), answers)


def _report(marks: Sequence[CaseMark], sealed: Seal, seed: int, json_file: Path | None) -> None:
    from stemwatch.service.cli import views
    from stemwatch.service.cli.prove_tables import figures_lines, tables
    from stemwatch.service.studies.proof.rates import as_json

    for table in tables(marks):
        views.out.print(table, "")
    for line in figures_lines(marks):
        views.out.print(line, highlight=False)
    views.out.print(
        f"The opened truth has the digest that was printed first, {sealed.digest[:12]}...",
        highlight=False,
    )
    if json_file is not None:
        views.write_json(json_file, as_json(marks, sealed, seed))
