"""What all tests share: how property tests draw, the real recordings, and which tests may not be
skipped."""

from __future__ import annotations

import gc
import os
import signal
import sys
from collections import deque
from collections.abc import Generator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

# The same fifty examples in every run: no commit is refused by a draw. ``make explore`` draws a
# hundred anew; what it finds is kept as an ``@example`` of the test.
settings.register_profile(
    "repeatable",
    max_examples=50,
    derandomize=True,
    deadline=None,
    database=None,
    print_blob=True,
)
settings.register_profile(
    "explore", derandomize=False, deadline=None, database=None, print_blob=True
)
settings.load_profile("repeatable")

STRICT = os.environ.get("STRICT", "") not in ("", "0")
MUST_RUN = ("browser", "postgres")
STUDIES = {"benchmarks", "studies"}
RECORDINGS = "STEMWATCH_RECORDINGS"
REPOSITORY = Path(__file__).parent.parent
BESIDE_THE_CHECKOUT = REPOSITORY.parent / "shared" / "recordings"

# Worker processes import the functions that a test hands them from here. Last, so that a normal
# installation of the package, and not the checkout, is what the tests run.
sys.path[:] = [index for index in sys.path if Path(index or ".").resolve() != REPOSITORY.resolve()]
sys.path.append(str(REPOSITORY))
# Nor do programs that tests start take it from the folder they are started in: of the checkout's
# copy they would compile every kernel once more.
os.environ["PYTHONSAFEPATH"] = "1"

# A shell that runs the tests in the background has them, and all they start, ignore Ctrl-C.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Python's garbage collector rests while thousands of tests are read, and later leaves what was
    read alone: going through it again and again was half of the time that reading them takes."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


@pytest.hookimpl(wrapper=True)
def pytest_collection_modifyitems(
    config: pytest.Config, items: list[pytest.Item]
) -> Generator[None, None, None]:
    """The long tests in folders of studies are themselves studies, and every study is long, so that
    each test is run by one of the three targets of the Makefile. Of those that were asked for,
    half of the processes begin with the ones marked ``early``, beside which the others go on: begun
    last, they would keep the machine waiting."""
    for item in items:
        long = item.get_closest_marker("long")
        if STUDIES & set(item.path.parts) and long:
            item.add_marker("study")
        elif item.get_closest_marker("study") and not long:
            raise pytest.UsageError(f"{item.nodeid} is marked study but not long")
    yield
    processes = int(getattr(config, "workerinput", {}).get("workercount", 1))
    items[:] = early_first(items, processes)


def early_first(items: list[pytest.Item], processes: int) -> list[pytest.Item]:
    """The tests in an order of which each process takes an equal stretch, as xdist deals them; the
    ``early`` ones, a module's together, begin the stretches of half of the processes."""
    modules: dict[Path, list[pytest.Item]] = {}
    others = deque[pytest.Item]()
    for item in items:
        early = item.get_closest_marker("early")
        (modules.setdefault(item.path, []) if early else others).append(item)
    heads: list[list[pytest.Item]] = [[] for _ in range(processes)]
    for module in modules.values():
        min(heads[: max(1, processes // 2)], key=len).extend(module)
    ordered: list[pytest.Item] = []
    for place, head in enumerate(heads):
        ordered += head
        end = len(items) * (place + 1) // processes
        ordered += [others.popleft() for _ in range(min(end - len(ordered), len(others)))]
    return ordered


@pytest.fixture(scope="session")
def recordings() -> Path:
    """The folder of real recordings: ``STEMWATCH_RECORDINGS``, or beside the checkout."""
    folder = Path(os.environ.get(RECORDINGS) or BESIDE_THE_CHECKOUT)
    if not folder.is_dir():
        pytest.skip(f"REAL RECORDINGS ARE NOT TESTED: no folder {folder}; set {RECORDINGS}")
    return folder


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item,
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """With ``STRICT=1`` a skipped test of a browser or a database server counts as failed."""
    report = yield
    marks = any(item.get_closest_marker(name) for name in MUST_RUN)
    if STRICT and marks and report.skipped and not hasattr(report, "wasxfail"):
        _fail(report)
    return report


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report() -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    """With ``STRICT=1`` a module that is skipped as a whole counts as failed."""
    report = yield
    if STRICT and report.skipped:
        _fail(report)
    return report


def _fail(report: Any) -> None:
    reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else report.longrepr
    report.outcome = "failed"
    report.longrepr = f"{reason}; with STRICT=1 this may not be skipped"
