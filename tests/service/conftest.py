"""What tests of the command line share: a way to run it, and a small plant's export."""

from __future__ import annotations

import contextlib
import io
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING
from unittest.mock import patch

import pytest
import typer.main
from argon2 import PasswordHasher

from stemwatch.models.studies.simulator import demo_plant, simulate_loop
from stemwatch.service.access import passwords
from stemwatch.service.cli import main, views
from stemwatch.service.store.migrations import migrate
from stemwatch.service.studies.simulated_export import write_export
from tests.service.browser_windows import Windows
from tests.service.copied_tables import TablesCopied
from tests.shared_setup import made_once

if TYPE_CHECKING:
    from tests.service.clusters import Cluster

START = datetime(2026, 3, 2, 6, 0, tzinfo=UTC)
WIDTH = 200  # columns, so that a sentence stands on one line
HEALTHY, STICKY, BLIND = "FIC-107", "FIC-104", "FIC-113"  # tags of the small plant
_PLACES = {HEALTHY: 6, STICKY: 3, BLIND: 12}
CHROMIUM = shutil.which("chromium")
BROWSER_ARGUMENTS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-background-networking",
    "--no-first-run",
]


# A hash of the product's kind with the least cost, so that tests are quick.
QUICK = PasswordHasher(time_cost=1, memory_cost=64, parallelism=1, hash_len=32, salt_len=16)
OURS, OUR_UNUSED_HASH = passwords._HASHER, passwords.UNUSED_HASH


@pytest.fixture(scope="session", autouse=True)
def _quick_passwords() -> Iterator[None]:
    """Passwords are hashed cheaply in this process; ``real_passwords`` has them hashed as they
    are."""
    unused_hash = QUICK.hash("a password that nobody has")
    with (
        patch.object(passwords, "_HASHER", QUICK),
        patch.object(passwords, "UNUSED_HASH", unused_hash),
    ):
        yield


@pytest.fixture
def real_passwords(_quick_passwords: None) -> Iterator[None]:
    """Passwords are hashed as the product does it, with all its memory and passes."""
    with (
        patch.object(passwords, "_HASHER", OURS),
        patch.object(passwords, "UNUSED_HASH", OUR_UNUSED_HASH),
    ):
        yield


@pytest.fixture(scope="session", autouse=True)
def _copied_tables(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """A new SQLite file begins as a copy of one with tables."""
    tables = TablesCopied(tmp_path_factory.mktemp("tables") / "new.db")
    with patch.object(migrate, "upgrade", tables):
        yield


@dataclass(frozen=True)
class Outcome:
    """How a command ended and what it printed."""

    status: int
    out: str
    err: str

    @property
    def said(self) -> str:
        """Both streams as running text, without frames and line breaks."""
        return " ".join(re.sub("[─-╿]", " ", self.out + self.err).split())


Stemwatch = Callable[..., Outcome]
# Building all commands takes as long as many of them run; they keep nothing from call to call.
BUILT_ONCE = cache(typer.main.get_command)


def run_main(*arguments: object) -> Outcome:
    """``stemwatch ARGUMENTS`` in this process, through the function that the script calls."""
    out, err = io.StringIO(), io.StringIO()
    status = 0
    with contextlib.ExitStack() as around:
        around.enter_context(patch.object(sys, "argv", ["stemwatch", *map(str, arguments)]))
        around.enter_context(patch.object(typer.main, "get_command", BUILT_ONCE))
        around.enter_context(patch.dict(os.environ, COLUMNS=str(WIDTH)))
        for console in (views.out, views.err):
            around.enter_context(patch.object(console, "_width", WIDTH))
        around.enter_context(contextlib.redirect_stdout(out))
        around.enter_context(contextlib.redirect_stderr(err))
        try:
            main()
        except SystemExit as end:
            status = end.code if isinstance(end.code, int) else int(end.code is not None)
    return Outcome(status=status, out=out.getvalue(), err=err.getvalue())


def run_process(
    *arguments: object, cwd: Path | None = None, env: dict[str, str] | None = None
) -> Outcome:
    """``stemwatch ARGUMENTS`` as a process of its own."""
    process = subprocess.run(
        [sys.executable, "-m", "stemwatch.service", *map(str, arguments)],
        cwd=cwd,
        env={**os.environ, "OMP_NUM_THREADS": "1", **(env or {})},
        capture_output=True,
        encoding="utf-8",
        timeout=120,
        check=False,
    )
    return Outcome(status=process.returncode, out=process.stdout, err=process.stderr)


@pytest.fixture(scope="session")
def stemwatch() -> Stemwatch:
    """Runs the command line in this process."""
    return run_main


@pytest.fixture(scope="session")
def stemwatch_process() -> Stemwatch:
    """Runs the command line as a process of its own."""
    return run_process


def write_small_plant(folder: Path, tags: Sequence[str], minutes: float) -> Path:
    """Export the small plant's valves ``tags`` into ``folder``; returns the plant file."""
    loops = demo_plant(1)
    simulated = [
        simulate_loop(replace(loops[_PLACES[tag]], duration_s=60.0 * minutes), seed=_PLACES[tag])
        for tag in tags
    ]
    return write_export(simulated, folder, start=START, zone="Europe/Berlin").plant_toml


@pytest.fixture(scope="session")
def small_plant(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """plant.toml of a healthy, a sticking and an unmeasured valve: a quarter of an hour at 1 s."""
    return _made_plant(tmp_path_factory, "small_plant", (HEALTHY, STICKY, BLIND), minutes=15)


@pytest.fixture(scope="session")
def export(small_plant: Path) -> Path:
    """The small plant's historian export."""
    return small_plant.parent / "export" / "historian.csv"


@pytest.fixture
def plant(small_plant: Path, tmp_path: Path) -> Path:
    """A plant file of its own, with a database of its own, that names the shared export."""
    return plant_with_database(small_plant, tmp_path)


def plant_with_database(small_plant: Path, folder: Path) -> Path:
    """The small plant's file in ``folder``, where its database will be; the export is shared."""
    text = small_plant.read_text(encoding="utf-8")
    path = folder / "plant.toml"
    export = (small_plant.parent / "export").as_posix()
    path.write_text(text.replace('"export/', f'"{export}/'), encoding="utf-8")
    return path


@pytest.fixture(scope="session")
def one_valve(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The export of the sticking valve alone, a quarter of an hour."""
    plant = _made_plant(tmp_path_factory, "one_valve", (STICKY,), minutes=15)
    return plant.parent / "export" / "historian.csv"


def _made_plant(
    tmp_path_factory: pytest.TempPathFactory, name: str, tags: Sequence[str], minutes: float
) -> Path:
    """The small plant's file, made once for all processes of the run, which leave it as it is."""

    def make(folder: Path) -> None:
        write_small_plant(folder, tags, minutes)

    return made_once(tmp_path_factory, name, make) / "plant.toml"


@pytest.fixture(scope="session")
def shared_cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    """A Dask cluster that the tests share: its workers take seconds to start."""
    from tests.service.clusters import dask_cluster

    with dask_cluster(tmp_path_factory.mktemp("dask"), workers=2) as started:
        yield started


@pytest.fixture
def cluster(shared_cluster: Cluster) -> Cluster:
    """The shared cluster with two workers, whatever an earlier test did to them."""
    shared_cluster.have(2)
    return shared_cluster


@pytest.fixture(scope="module")
def browser():
    """Chromium without a window."""
    if CHROMIUM is None and os.environ.get("CI"):
        pytest.fail("chromium is not on the PATH; continuous integration must have it")
    if CHROMIUM is None:
        pytest.skip("chromium is not on the PATH")
    playwright = pytest.importorskip("playwright.sync_api")
    with playwright.sync_playwright() as driver:
        chromium = driver.chromium.launch(executable_path=CHROMIUM, args=BROWSER_ARGUMENTS)
        yield chromium
        chromium.close()


@pytest.fixture(scope="module")
def _windows(browser) -> Windows:
    return Windows(browser)


@pytest.fixture
def windows(_windows: Windows) -> Iterator[Windows]:
    """The browser's windows; those that the test opened are taken back after it."""
    yield _windows
    _windows.close()
