"""Write and seal a benchmark's folder, and score answers to it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from stemwatch.service.executors import Executor
from stemwatch.service.studies.benchmark.answers import read_answers
from stemwatch.service.studies.benchmark.draw import recordings_of, write_cases
from stemwatch.service.studies.benchmark.page import PAGE_FILE, digest_in, page_of
from stemwatch.service.studies.benchmark.score import BenchmarkScore, benchmark_score
from stemwatch.service.studies.benchmark.truth import (
    BenchmarkTruth,
    opened,
    recordings_digest,
)
from stemwatch.service.studies.proof.truth import BrokenSeal, digest_of


def truth_file_of(folder: Path) -> Path:
    """Where the truth of a folder is written, unless another file is named: beside it."""
    return folder.resolve().with_name(f"{folder.resolve().name}-truth.json")


def write_benchmark(
    folder: Path,
    truth_file: Path,
    *,
    seed: int,
    cases: int,
    executor: Executor,
    on_progress: Callable[[int], None],
) -> str:
    """Write recordings and page into ``folder``, the truth into ``truth_file``; the digest.

    Raises ``ValueError`` where the folder is not empty, the truth exists already or would lie in
    the folder, or ``cases`` cannot be halved three times.
    """
    if folder.exists() and any(folder.iterdir()):
        raise ValueError(f"{folder} is not empty; give a new folder")
    if truth_file.exists():
        raise ValueError(f"{truth_file} exists and is not overwritten; name another file")
    if truth_file.resolve().is_relative_to(folder.resolve()):
        raise ValueError(
            f"{truth_file} would lie in the folder that is given away; name a file outside {folder}"
        )
    folder.mkdir(parents=True, exist_ok=True)
    truths = write_cases(cases, seed, folder, executor, on_progress)
    recordings = recordings_digest(recordings_of(folder))
    text = BenchmarkTruth(seed=seed, recordings=recordings, cases=truths).sealed()
    digest = digest_of(text)
    truth_file.write_text(text, encoding="utf-8", newline="\n")
    page = page_of(cases, digest)
    (folder / PAGE_FILE).write_text(page, encoding="utf-8", newline="\n")
    return digest


def judge(folder: Path, answers_file: Path, truth_file: Path) -> BenchmarkScore:
    """The score of an answers file, after the digests of truth and recordings were held
    against the page. Raises ``ValueError`` for what cannot be read or was changed."""
    truth = opened(truth_file.read_text(encoding="utf-8"), digest_in(folder))
    if recordings_digest(recordings_of(folder)) != truth.recordings:
        raise BrokenSeal(
            f"the recordings in {folder} are not those that the truth was sealed with; nothing was "
            "scored. Take the folder as it was given"
        )
    answers = read_answers(answers_file, {case.case for case in truth.cases})
    return benchmark_score(truth.cases, answers)
