"""The whole job: valve-days from an archive to stored results and a report.

    python tests/benchmarks/bench_whole_job.py [--valves 1000] [--hours 24] [--format parquet csv]
        [--workers 2] [--distinct 0] [--stages 24] [--json FILE] [--keep FOLDER]
        [--growth] [--growth-valves 25 50 100 200] [--growth-hours 1 6 24] [--only-growth]

Prints for each format: valves per second; the highest memory of the program and its workers
together, of the program alone and of one worker; the seconds of one core for each stage. With
``--growth`` the job is repeated over valves, length of the recordings and workers, and the
exponents of power laws are fitted. Over valves also ``core time = start + each * valves``, which is
computed (not measured) for 1,000. The archive is made with ``stemwatch simulate-archive`` unless
``--keep`` has it already. What is going on is told on the standard error.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

LOOK_S = 0.5
HEAD = f"{'seconds':>9}{'core s':>9}{'memory MB':>11}{'program':>9}{'a worker':>10}{'page MB':>9}"
# Where each stage begins and ends: a function of the program, by module and name.
PLACES = {
    "read": ("stemwatch.service.run.task", "recording_of"),
    "quality": ("stemwatch.models.screening.fitted_recording", "assess"),
    "choose": ("stemwatch.models.screening.fitted_recording", "choose_fit_window"),
    "fit S, J": ("stemwatch.models.screening.fitted_recording", "fit_stickslip"),
    "intervals": ("stemwatch.models.screening.fitted_recording", "bootstrap"),
    "NARX": ("stemwatch.models.screening.screen", "_train"),
    "explain": ("stemwatch.models.screening.left_out", "explain"),
    "verdict": ("stemwatch.models.screening.screen", "_with_verdict"),
    "plots": ("stemwatch.service.report.charts.valve_plots", "plots_instead_of_samples"),
    "store": ("stemwatch.service.store.store", "Store.save_many"),
    "networks": ("stemwatch.service.run.saving", "keep_network"),
    "report": ("stemwatch.service.run.finish", "write_report"),
    "work list": ("stemwatch.service.run.finish", "write_maintenance"),
}


class Stages:
    """Times the stages while the block lasts: ``seconds`` of this process by name.

    The whole is the processor time of the block; what is in no stage is ``other``.
    """

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)
        self._put_back: list[Callable[[], None]] = []

    def __enter__(self) -> Self:
        for name, (module, path) in PLACES.items():
            holder: Any = importlib.import_module(module)
            *outer, last = path.split(".")
            for item in outer:
                holder = getattr(holder, item)
            plain = getattr(holder, last)
            setattr(holder, last, self._timed(name, plain))
            self._put_back.append(partial(setattr, holder, last, plain))
        self._began = time.process_time()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        complete = time.process_time() - self._began
        for put_back in self._put_back:
            put_back()
        self.seconds["other"] = max(complete - sum(self.seconds.values()), 0.0)

    def _timed(self, name: str, plain: Callable[..., Any]) -> Callable[..., Any]:
        def timed(*arguments: Any, **named: Any) -> Any:
            started = time.process_time()
            try:
                return plain(*arguments, **named)
            finally:
                self.seconds[name] += time.process_time() - started

        return timed


class Memory(threading.Thread):
    """The highest memory of a process and its descendants, bytes.

    ``together``, of the process ``alone``, and of its largest ``worker`` (0 where it has none);
    each highest at its own instant. Proportional shares as the kernel tells them, so that what
    processes share counts once. ``spent`` is their processor time by process, seconds, when each
    was last seen: workers that a fork server started are nobody's children when they end.
    """

    def __init__(self, pid: int) -> None:
        super().__init__(daemon=True)
        self.pid, self.over = pid, threading.Event()
        self.together = self.alone = self.worker = 0
        self.spent: dict[int, float] = {}

    def run(self) -> None:
        """Look twice a second until it is over."""
        while not self.over.wait(LOOK_S):
            family = _family(self.pid)
            alone, *workers = [_memory(pid) for pid in family]
            self.together = max(self.together, alone + sum(workers))
            self.alone = max(self.alone, alone)
            self.worker = max(self.worker, *workers, 0)
            self.spent |= {pid: seconds for pid in family if (seconds := _processor_time(pid))}


def _family(pid: int) -> list[int]:
    """The process and all that descend from it."""
    result, waiting = [], [pid]
    while waiting:
        item = waiting.pop()
        result.append(item)
        for task in Path(f"/proc/{item}/task").glob("*/children"):
            try:
                waiting += [int(child) for child in task.read_text().split()]
            except OSError:
                continue
    return result


def _memory(pid: int) -> int:
    try:
        for line in Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines():
            if line.startswith("Pss:"):
                return int(line.split()[1]) * 1024
        return 0
    except OSError:
        return 0


def _processor_time(pid: int) -> float:
    """Seconds of processor time of one process so far; 0 where it has ended."""
    try:
        # The name, in brackets, may hold blanks; user and system time are the 12th and 13th after.
        after = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return (int(after[11]) + int(after[12])) / os.sysconf("SC_CLK_TCK")


def make_archive(folder: Path, form: str, valves: int, hours: float, distinct: int) -> float:
    """Write an archive with the program's own command, unless it is there; seconds it took."""
    if (folder / "plant.toml").is_file():
        return 0.0
    tell(f"making {folder.name}: {valves} valves of {hours:g} h from {distinct or valves} loops")
    started = time.perf_counter()
    _stemwatch(
        "simulate-archive", folder, "--format", form, "--valves", valves,
        "--hours", hours, "--distinct", distinct,
    )  # fmt: skip
    return time.perf_counter() - started


def tell(text: str) -> None:
    """Say what is going on, with the time and the load of the machine."""
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
    print(f"{time.strftime('%H:%M:%S')} (load {load:.1f}) {text}", file=sys.stderr, flush=True)


def _stemwatch(*arguments: object) -> None:
    command = [sys.executable, "-m", "stemwatch.service", *map(str, arguments)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def screen_job(plant: Path, workers: int) -> dict[str, float]:
    """One run of ``stemwatch screen`` on the plant: seconds, and the highest memory in MB.

    ``core_s`` is the processor time of all its processes to within half a second of each, which
    other work on the machine disturbs less.
    """
    tell(f"screening {plant.parent.name}/{plant.name} with {workers} workers")
    with tempfile.TemporaryDirectory() as out:
        database = f"sqlite:///{Path(out) / 'results.db'}"
        command = [
            sys.executable, "-m", "stemwatch.service", "screen", "--plant", plant,
            "--out", out, "--db", database, "--workers", workers,
        ]  # fmt: skip
        started = time.perf_counter()
        process = subprocess.Popen(
            list(map(str, command)),
            env={**os.environ, "OMP_NUM_THREADS": "1"},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        memory = Memory(process.pid)
        memory.start()
        status = process.wait()
        seconds = time.perf_counter() - started
        memory.over.set()
        memory.join()
        if status != 0:
            raise RuntimeError(f"the job ended with status {status}")
        size = (Path(out) / "report.html").stat().st_size
    results = {
        "seconds": seconds,
        "core_s": sum(memory.spent.values()),
        "memory_mb": memory.together / 1e6,
        "program_mb": memory.alone / 1e6,
        "worker_mb": memory.worker / 1e6,
        "page_mb": size / 1e6,
    }
    tell(", ".join(f"{name} {value:.1f}" for name, value in results.items()))
    return results


def stages_of(archive: Path, valves: int) -> dict[str, float]:
    """Seconds of one core for each valve in each stage, for the first ``valves``."""
    from stemwatch.service.config import load_plant
    from stemwatch.service.executors import InProcess
    from stemwatch.service.run.engine import RunNow, screen_now
    from stemwatch.service.run.plan import Request
    from stemwatch.service.store.store import open_store

    def screen(out: Path, count: int) -> None:
        out.mkdir()
        with open_store(f"sqlite:///{out / 'results.db'}") as store:
            plant = load_plant(_cut(archive / "plant.toml", count))
            screen_now(Request(plant=plant), RunNow(store=store, executor=InProcess(), out=out))

    stages = Stages()
    with tempfile.TemporaryDirectory() as out:
        tell("compiling and loading, not counted")
        screen(Path(out) / "first", 2)
        tell(f"timing the stages of {valves} valves")
        with stages:
            screen(Path(out) / "timed", valves)
    return {name: seconds / valves for name, seconds in stages.seconds.items()}


def _cut(plant: Path, valves: int) -> Path:
    """A plant file beside ``plant`` with its first valves."""
    parts = plant.read_text(encoding="utf-8").split("\n[[valves]]\n")
    cut = plant.with_name(f"plant-{valves}.toml")
    cut.write_text("\n[[valves]]\n".join(parts[: valves + 1]), encoding="utf-8")
    return cut


def exponent(sizes: Sequence[float], seconds: Sequence[float]) -> float:
    """The exponent ``b`` of ``seconds = a sizes**b`` by least squares of the logarithms."""
    return float(np.polyfit(np.log(sizes), np.log(seconds), 1)[0])


def straight(sizes: Sequence[float], seconds: Sequence[float]) -> tuple[float, float]:
    """``start`` and ``each`` of ``seconds = start + each * sizes``, by least squares."""
    each, start = np.polyfit(sizes, seconds, 1)
    return float(start), float(each)


def growth(folder: Path, args: argparse.Namespace) -> dict[str, Any]:
    """The time and the memory over valves, over samples for each valve, and over workers."""
    most = max(args.growth_valves)
    seen: dict[tuple[int, float, int], dict[str, float]] = {}
    result: dict[str, Any] = {}
    for name, cases in _cases(args).items():
        rows = []
        for size, case in cases.items():
            if case not in seen:
                valves, hours, workers = case
                count = most if hours == args.hours else valves  # fewer valves are cut out of it
                archive = folder / f"growth-{count}-{hours:g}"
                make_archive(archive, "parquet", count, hours, min(count, args.distinct or 20))
                seen[case] = screen_job(_cut(archive / "plant.toml", valves), workers)
            rows.append({**seen[case], name: size})
        result[name] = {"rows": rows, **_fitted(name, rows)}
    return result


def _fitted(name: str, rows: list[dict[str, float]]) -> dict[str, float]:
    """The laws that the rows follow; none where they are too few."""
    if len(rows) < 2:
        return {}
    sizes = [row[name] for row in rows]
    seconds = [row["seconds"] for row in rows]
    memory = [row["memory_mb"] for row in rows]
    core = [row["core_s"] for row in rows]
    laws = {
        "exponent": exponent(sizes, seconds),
        "core_exponent": exponent(sizes, core),
        "memory_exponent": exponent(sizes, memory),
    }
    if name == "valves":
        laws["start_core_s"], laws["each_core_s"] = straight(sizes, core)
        laws["computed_1000_core_s"] = laws["start_core_s"] + 1000.0 * laws["each_core_s"]
    return laws


def _cases(args: argparse.Namespace) -> dict[str, dict[float, tuple[int, float, int]]]:
    """Sizes with (valves, hours, workers) of each."""
    valves, hours, workers = args.growth_valves, args.hours, args.workers
    few = valves[(len(valves) - 1) // 2]
    return {
        "valves": {float(n): (n, hours, workers) for n in valves},
        "samples": {3600.0 * length: (few, length, workers) for length in args.growth_hours},
        "workers": {float(n): (few, hours, n) for n in range(1, workers + 1)},
    }


def machine() -> dict[str, object]:
    """What the figures were measured on."""
    model = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.is_file():
        names = [line.split(":")[1].strip() for line in info.read_text().splitlines()
                 if line.startswith("model name")]  # fmt: skip
        model = names[0] if names else model
    return {
        "processor": model,
        "cores": os.cpu_count(),
        "python": platform.python_version(),
        "load_at_start": round(os.getloadavg()[0], 2),
    }


def measured(folder: Path, form: str, args: argparse.Namespace) -> dict[str, Any]:
    """The job from one format, whole and by stage."""
    archive = folder / form
    result = make_archive(archive, form, args.valves, args.hours, args.distinct)
    job = screen_job(archive / "plant.toml", args.workers)
    stages = stages_of(archive, min(args.stages, args.valves)) if args.stages else {}
    return {
        "format": form,
        "valves": args.valves,
        "hours": args.hours,
        "workers": args.workers,
        "making_s": result,
        "valves_per_s": args.valves / job["seconds"],
        **job,
        "stages_s_per_valve": stages,
    }


def show(result: dict[str, Any]) -> None:
    """The tables."""
    about = result["machine"]
    print(f"{about['processor']}, {about['cores']} cores, load {about['load_at_start']} before")
    if result["jobs"]:
        print(f"\n{'format':9}{'valves':>7}{'hours':>7}{'workers':>9}{'valves/s':>10}{HEAD}")
    for job in result["jobs"]:
        print(f"{job['format']:9}{job['valves']:7d}{job['hours']:7g}{job['workers']:9d}"
              f"{job['valves_per_s']:10.2f}{_row(job)}")  # fmt: skip
    for job in result["jobs"]:
        total = sum(job["stages_s_per_valve"].values())
        if total:
            print(f"\n{job['format']}: {total:.3f} s of one core for each valve")
        for name, seconds in job["stages_s_per_valve"].items():
            print(f"  {name:10}{seconds:9.4f} s{100 * seconds / total:7.1f} %")
    for name, grown in result.get("growth", {}).items():
        print(f"\n{'over ' + name:>14}{HEAD}")
        for row in grown["rows"]:
            print(f"{row[name]:14g}{_row(row)}")
        _show_laws(name, grown)


def _row(job: dict[str, float]) -> str:
    return (f"{job['seconds']:9.1f}{job['core_s']:9.1f}{job['memory_mb']:11.0f}"
            f"{job['program_mb']:9.0f}{job['worker_mb']:10.0f}{job['page_mb']:9.1f}")  # fmt: skip


def _show_laws(name: str, grown: dict[str, Any]) -> None:
    if "exponent" in grown:
        print(f"time ~ {name}^{grown['exponent']:.2f}, "
              f"core time ~ {name}^{grown['core_exponent']:.2f}, "
              f"memory ~ {name}^{grown['memory_exponent']:.2f}")  # fmt: skip
    if "start_core_s" in grown:
        print(f"core time = {grown['start_core_s']:.1f} s + {grown['each_core_s']:.3f} s a valve; "
              "computed, not measured, for 1,000 valves: "
              f"{grown['computed_1000_core_s'] / 60.0:.1f} min of one core")  # fmt: skip


def main() -> None:
    """Read the command line, measure, print, write JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--valves", type=int, default=1000)
    parser.add_argument("--hours", type=float, default=24.0)
    parser.add_argument("--format", nargs="+", choices=("parquet", "csv"), default=["parquet"])
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--distinct", type=int, default=0, help="loops; 0: one for each valve")
    parser.add_argument("--stages", type=int, default=24, help="valves to time stage by stage")
    parser.add_argument("--growth", action="store_true")
    parser.add_argument("--only-growth", action="store_true", help="leave out the job itself")
    parser.add_argument("--growth-valves", type=int, nargs="+", default=[100, 300, 1000, 2000])
    parser.add_argument("--growth-hours", type=float, nargs="+", default=[1.0, 3.0, 6.0, 24.0])
    parser.add_argument("--json", type=Path)
    parser.add_argument("--keep", type=Path, help="folder of archives that is kept")
    args = parser.parse_args()
    folder = args.keep or Path(tempfile.mkdtemp(prefix="whole-job-"))
    folder.mkdir(parents=True, exist_ok=True)
    results: dict[str, Any] = {"machine": machine(), "jobs": []}
    try:
        for form in () if args.only_growth else args.format:
            results["jobs"].append(measured(folder, form, args))
        if args.growth or args.only_growth:
            results["growth"] = growth(folder, args)
    finally:  # what was measured is told, whatever came after it
        if args.keep is None:
            shutil.rmtree(folder, ignore_errors=True)
        show(results)
        if args.json:
            args.json.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
