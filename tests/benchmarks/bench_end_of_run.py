"""The end of a run: what comes when all valves are screened, and its page, for many valves.

    python tests/benchmarks/bench_end_of_run.py [--valves 1000] [--distinct 60] [--keep FOLDER]

Screens ``--distinct`` valve-days of a simulated archive once, and hands their results out under
other names to a run over ``--valves``. Prints seconds of processor time of each step, the highest
memory of the program, and the sizes of the files. Copies of one loop oscillate together, so that
more groups are found than in a plant.
"""

from __future__ import annotations

import argparse
import importlib
import pickle
import resource
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from itertools import cycle
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from stemwatch.service.config import load_plant
from stemwatch.service.executors import InProcess
from stemwatch.service.run.engine import RunNow, screen_now
from stemwatch.service.run.plan import Request
from stemwatch.service.store.store import open_store

# Beside this file, where no package is.
bench_whole_job: Any = importlib.import_module("bench_whole_job")
# The results are taken and handed out where the run looks this function up.
EXECUTE: Any = importlib.import_module("stemwatch.service.run.execute")
STEPS = {
    "groups of loops": ("stemwatch.service.run.finish", "plant_groups"),
    "work list": ("stemwatch.service.run.finish", "write_maintenance"),
    "report": ("stemwatch.service.run.finish", "write_report"),
    "of it JSON": ("stemwatch.service.report.write_report", "write_json"),
    "of it the page": ("stemwatch.service.report.write_report", "write_html"),
    "all of the end": ("stemwatch.service.run.engine", "finish"),
}


def renamed(plant: Path, valves: int, out: Path) -> Path:
    """A plant of as many valves, each with the tags of one of ``plant``."""
    head, *entries = plant.read_text("utf-8").split("[[valves]]\n")
    head = head.replace('path = "', f'path = "{plant.parent}/')
    text = head
    for number, entry in zip(range(valves), cycle(entries)):
        _, after = entry.split("\n", 1)
        text += f'[[valves]]\nid = "V-{number:05d}"\n{after}'
    path = out / "plant.toml"
    path.write_text(text, "utf-8")
    return path


def run(plant: Path, out: Path) -> None:
    out.mkdir()
    with open_store(f"sqlite:///{out / 'results.db'}") as store:
        request = Request(plant=load_plant(plant))
        screen_now(request, RunNow(store=store, executor=InProcess(), out=out))


def screened_once(plant: Path, out: Path) -> list[bytes]:
    """The packed results of the valves of ``plant``."""
    plain = EXECUTE.screen_packed
    kept: list[bytes] = []

    def keeping(*arguments: Any, **named: Any) -> Any:
        results = plain(*arguments, **named)
        kept.extend(pickle.dumps(result) for result in results)
        return results

    EXECUTE.screen_packed = keeping
    run(plant, out)
    EXECUTE.screen_packed = plain
    return kept


def hand_out(kept: Sequence[bytes]) -> Callable[..., list[Any]]:
    """A ``screen_packed`` that gives each task the next of the results."""
    turn = cycle(kept)

    def given(_limits: Any, _folder: str, tasks: Sequence[Any], **_: Any) -> list[Any]:
        results = []
        for task, blob in zip(tasks, turn, strict=False):
            screening, plots = pickle.loads(blob)
            valve, loop = task.tags.valve, plots.thinned_loop
            loop = None if loop is None else replace(loop, loop=valve)
            results.append((replace(screening, valve=valve), replace(plots, thinned_loop=loop)))
        return results

    return given


def timed(name: str, module: str, function: str) -> None:
    """Print the processor time of ``function`` at each call."""
    holder = importlib.import_module(module)
    plain = getattr(holder, function)

    def told(*arguments: Any, **named: Any) -> Any:
        began = time.process_time()
        answer = plain(*arguments, **named)
        print(f"{name:<18}{time.process_time() - began:8.1f} s", flush=True)
        return answer

    setattr(holder, function, told)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--valves", type=int, default=1000)
    parser.add_argument("--distinct", type=int, default=60)
    parser.add_argument("--keep", type=Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        archive = options.keep or folder / "archive"
        archive.mkdir(exist_ok=True)
        bench_whole_job.make_archive(archive, "parquet", options.distinct, 24, options.distinct)
        plant = archive / "plant.toml"
        # In a process of its own, so that its memory is not counted.
        with ProcessPoolExecutor(1, get_context("spawn")) as other:
            kept = other.submit(screened_once, plant, folder / "once").result()
        EXECUTE.screen_packed = hand_out(kept)
        for name, (module, function) in STEPS.items():
            timed(name, module, function)
        run(renamed(plant, options.valves, folder), folder / "all")
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        print(f"{'highest memory':<18}{memory:8.0f} MB")
        for file in sorted((folder / "all").iterdir()):
            print(f"{file.name:<18}{file.stat().st_size / 1e6:8.1f} MB")


if __name__ == "__main__":
    main()
