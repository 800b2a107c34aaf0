"""``make bench``: every benchmark one after the other, with the machine named.

    python tests/benchmarks/suite.py [--full] [--only NAME ...] [--out bench]

Writes ``bench.md``, what each benchmark printed under the command that printed it, and
``bench.json``, the same numbers for machines. The quick setting takes well under half an hour on
two cores; ``--full`` takes the settings of docs/performance.md. A benchmark that needs something
which is not installed says so in its place, and the rest goes on; the status is 1 when one failed.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
import time
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

HERE = Path(__file__).parent
NAMED = ("numpy", "numba", "pandas", "torch", "pyarrow", "duckdb", "sqlalchemy")
# One thread, because the figures are those of one core.
ENVIRONMENT = {name: "1" for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")}


@dataclass(frozen=True)
class Benchmark:
    """A script beside this file, and its options in the quick and in the full setting."""

    name: str
    about: str
    quick: tuple[str, ...] = ()
    full: tuple[str, ...] = ()
    needs: tuple[str, ...] = ()  # modules without which it is left out

    def command(self, *, full: bool) -> list[str]:
        """What a person types for it, from the root of the repository."""
        options = self.full if full else self.quick
        return ["python", f"tests/benchmarks/bench_{self.name}.py", *options]


SUITE = (
    Benchmark("kernel", "The stick-slip kernel beside a C loop"),
    Benchmark(
        "fit",
        "The S, J fit beside a grid and differential evolution",
        quick=("--valves", "8"),
        full=("--valves", "32"),
    ),
    Benchmark(
        "sysidentpy",
        "NARX beside SysIdentPy",
        quick=("--valves", "2"),
        full=("--valves", "8"),
        needs=("sysidentpy",),
    ),
    Benchmark("narx", "NARX, one by one and batched", quick=("--valves", "8", "--batches", "1,8")),
    Benchmark("explain", "explain per valve", quick=("--valves", "4"), full=("--valves", "20")),
    Benchmark(
        "whole_job",
        "Valve-days from an archive to results and report",
        quick=("--valves", "24", "--hours", "24", "--distinct", "12", "--stages", "6"),
        full=("--valves", "1000", "--distinct", "100", "--format", "parquet", "csv", "--growth"),
    ),
    Benchmark("storage", "Samples into and out of the database"),
    Benchmark("csv", "CSV beside pandas and DuckDB", quick=("--hours", "6")),
)


@dataclass(frozen=True)
class Outcome:
    """What a benchmark printed, and its numbers or why there are none."""

    benchmark: Benchmark
    command: str
    seconds: float
    printed: str
    numbers: object
    fault: str = ""


def machine() -> dict[str, object]:
    """The machine on which the figures were measured."""
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    return {
        "processor": _processor(),
        "cores": os.cpu_count(),
        "memory_GiB": round(memory, 1),
        "system": platform.platform(),
        "python": platform.python_version(),
        "stemwatch": version("stemwatch"),
        **{name: version(name) for name in NAMED},
        "load_at_start": round(os.getloadavg()[0], 2),
        "at": datetime.now(UTC).isoformat(timespec="seconds"),
    }


def _processor() -> str:
    """The processor's own name where the system tells it."""
    listing = Path("/proc/cpuinfo")
    lines = listing.read_text("utf-8").splitlines() if listing.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or "unknown"


def run(item: Benchmark, folder: Path, *, full: bool) -> Outcome:
    """One benchmark in a process of its own."""
    command = item.command(full=full)
    text = " ".join(command)
    missing = [name for name in item.needs if not _installed(name)]
    if missing:
        why = f"left out: {missing[0]} is not installed here; run the script to hear how"
        return Outcome(item, text, 0.0, "", None, why)
    numbers = folder / f"{item.name}.json"
    numbers.unlink(missing_ok=True)
    started = time.perf_counter()
    process = subprocess.run(
        [sys.executable, *command[1:], "--json", str(numbers)],
        cwd=HERE.parent.parent,
        env={**os.environ, **ENVIRONMENT},
        capture_output=True,
        text=True,
        check=False,
    )
    seconds = time.perf_counter() - started
    fault = (
        ""
        if process.returncode == 0
        else f"failed with status {process.returncode}: {process.stderr}"
    )
    results = json.loads(numbers.read_text("utf-8")) if numbers.exists() else None
    return Outcome(item, text, seconds, process.stdout, results, fault)


def _installed(name: str) -> bool:
    code = f"import importlib.util, sys; sys.exit(importlib.util.find_spec({name!r}) is None)"
    return subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def as_markdown(about: dict[str, object], outcomes: list[Outcome]) -> str:
    """The machine, then what each benchmark printed under its command."""
    lines = ["# Benchmarks", "", "| | |", "|---|---|"]
    lines += [f"| {name.replace('_', ' ')} | {value} |" for name, value in about.items()]
    for outcome in outcomes:
        lines += ["", f"## {outcome.benchmark.about}", "", f"    {outcome.command}", ""]
        if outcome.printed:
            lines += ["```text", outcome.printed.rstrip("\n"), "```"]
        if outcome.fault:
            lines += ["", outcome.fault.strip()]
        elif outcome.seconds:
            lines += ["", f"Took {outcome.seconds:.0f} s."]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Run the chosen benchmarks, print their progress, and write both files."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--full", action="store_true", help="the settings of docs/performance.md")
    names = [item.name for item in SUITE]
    parser.add_argument("--only", nargs="+", choices=names, default=names)
    parser.add_argument("--out", type=Path, default=Path("bench"))
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    about, outcomes = machine(), []
    for item in SUITE:
        if item.name not in arguments.only:
            continue
        print(f"{item.about} ... ", end="", flush=True)
        outcomes.append(run(item, arguments.out, full=arguments.full))
        print(outcomes[-1].fault or f"{outcomes[-1].seconds:.0f} s")
        _write(arguments.out, about, outcomes)  # what is done is kept, whatever comes after it
    print(f"Report: {arguments.out / 'bench.md'}")
    sys.exit(any(outcome.fault.startswith("failed") for outcome in outcomes))


def _write(folder: Path, about: dict[str, object], outcomes: list[Outcome]) -> None:
    (folder / "bench.md").write_text(as_markdown(about, outcomes), encoding="utf-8")
    matching = [
        {
            "name": outcome.benchmark.name,
            "command": outcome.command,
            "seconds": round(outcome.seconds, 1),
            "numbers": outcome.numbers,
            "fault": outcome.fault,
        }
        for outcome in outcomes
    ]
    text = json.dumps({"machine": about, "benchmarks": matching}, indent=1)
    (folder / "bench.json").write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
