"""Each contract test runs on SQLite and, where it is installed, on a private PostgreSQL server.

``STEMWATCH_TEST_POSTGRES`` names a server to use instead; each test makes a database of its own
there and drops it.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from sqlalchemy import create_engine, make_url, text

from stemwatch.models.estimate import Estimate
from stemwatch.models.record_checks.data_quality import DataQuality
from stemwatch.models.recording import Provenance, Recording, Role, Signal
from stemwatch.models.screening_result import Indicator, Residual, Screening
from stemwatch.models.verdict import Shape, Verdict
from stemwatch.service.store.migrations import migrate
from stemwatch.service.store.store import Store, open_store
from tests.service.copied_tables import UPGRADE
from tests.shared_setup import made_once

START = datetime(2026, 3, 1, 6, 0, tzinfo=UTC)
MakeScreening = Callable[..., Screening]


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", "postgres: needs PostgreSQL's server; skipped loudly if not")


@pytest.fixture(autouse=True)
def _tables_of_its_own() -> Iterator[None]:
    """A new file gets its tables from the program, not from a copy."""
    with patch.object(migrate, "upgrade", UPGRADE):
        yield


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    if "store_url" in metafunc.fixturenames:
        engines = ["sqlite", pytest.param("postgresql", marks=pytest.mark.postgres)]
        metafunc.parametrize("store_url", engines, indirect=True)


@pytest.fixture
def store_url(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[str]:
    """The URL of an empty database; with its tables where the test also asks for ``store``."""
    with_tables = "store" in request.fixturenames
    if request.param == "sqlite":
        path = tmp_path / "store.db"
        if with_tables:
            shutil.copy(request.getfixturevalue("sqlite_template"), path)
        yield f"sqlite:///{path}"
        return
    server = request.getfixturevalue("postgres_server")
    template = request.getfixturevalue("postgres_template") if with_tables else "template1"
    with database_like(template, server) as url:
        yield url


@pytest.fixture(scope="session")
def sqlite_template(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store without content, to be copied: making its tables takes longer than most tests."""

    def make(folder: Path) -> None:
        with open_store(f"sqlite:///{folder / 'store.db'}"):
            pass

    return made_once(tmp_path_factory, "empty_store", make) / "store.db"


@pytest.fixture(scope="session")
def postgres_template(postgres_server: str) -> Iterator[str]:
    """The same on PostgreSQL: the name of a database that others are made like."""
    with database_like("template1", postgres_server) as url:
        with open_store(url):
            pass
        yield str(make_url(url).database)


@contextmanager
def database_like(template: str, server: str) -> Iterator[str]:
    """The URL of a database of its own on ``server``, made like ``template`` and dropped at the
    end."""
    name = f"stemwatch_test_{uuid.uuid4().hex[:12]}"
    _administer(server, f'CREATE DATABASE "{name}" TEMPLATE "{template}"')
    yield make_url(server).set(database=name).render_as_string(hide_password=False)
    _administer(server, f'DROP DATABASE "{name}" WITH (FORCE)')


@pytest.fixture
def new_database(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Callable[[str], str]]:
    """Gives URLs of empty databases: ``new_database("sqlite")``, ``new_database("postgresql")``."""
    created: list[str] = []

    def make(engine: str) -> str:
        if engine == "sqlite":
            return f"sqlite:///{tmp_path / uuid.uuid4().hex}.db"
        server = request.getfixturevalue("postgres_server")
        created.append(f"stemwatch_test_{uuid.uuid4().hex[:12]}")
        _administer(server, f'CREATE DATABASE "{created[-1]}"')
        return make_url(server).set(database=created[-1]).render_as_string(hide_password=False)

    yield make
    for name in created:
        server = request.getfixturevalue("postgres_server")
        _administer(server, f'DROP DATABASE "{name}" WITH (FORCE)')


@pytest.fixture
def store(store_url: str) -> Iterator[Store]:
    """An empty store."""
    with open_store(store_url) as opened:
        yield opened


@pytest.fixture
def make_screening() -> MakeScreening:
    """A sticky valve's screening of ten minutes; keywords replace its fields."""
    return _screening


@pytest.fixture(scope="session")
def postgres_server() -> Iterator[str]:
    """The URL of a PostgreSQL server: the environment's, or a private one on a socket."""
    if url := os.environ.get("STEMWATCH_TEST_POSTGRES"):
        yield url.replace("postgresql://", "postgresql+psycopg://", 1)
        return
    programs = _postgres_programs()
    pytest.importorskip("psycopg", reason="psycopg is missing: PostgreSQL IS NOT TESTED")
    user = "postgres" if os.geteuid() == 0 else None  # the server refuses to run as root
    folder = Path(tempfile.mkdtemp(prefix="stemwatch-pg-"))
    folder.chmod(0o755)
    if user:
        shutil.chown(folder, user)
    data = folder / "data"
    _run(user, programs / "initdb", "-D", data, "-U", "postgres", "-A", "trust", "--no-sync")
    options = f"-F -k {folder} -c listen_addresses= -c max_connections=40"
    control = programs / "pg_ctl"
    _run(user, control, "-D", data, "-w", "-l", folder / "log", "-o", options, "start")
    try:
        yield f"postgresql+psycopg://postgres:geheim@/postgres?host={folder}"
    finally:
        _run(user, control, "-D", data, "-m", "immediate", "stop")
        shutil.rmtree(folder, ignore_errors=True)


def _postgres_programs() -> Path:
    in_order = sorted(Path("/usr/lib/postgresql").glob("*/bin/initdb"))
    if on_path := shutil.which("initdb"):
        in_order.append(Path(on_path))
    if not in_order:
        pytest.skip("no PostgreSQL server programs (initdb): PostgreSQL IS NOT TESTED")
    return in_order[-1].parent


def _run(user: str | None, *command: str | Path) -> None:
    # Not captured through pipes: the server would inherit them and keep them open.
    subprocess.run(
        [str(word) for word in command],
        user=user,
        cwd="/",
        check=True,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


def _administer(server: str, statement: str) -> None:
    engine = create_engine(server, isolation_level="AUTOCOMMIT")
    with engine.connect() as connection:
        connection.execute(text(statement))
    engine.dispose()


def _screening(**changes: Any) -> Screening:
    start = changes.pop("start", START)
    valve = changes.get("valve", "FIC-101")
    op = Signal.good(np.zeros(600), "FIC-101.OP")
    fields: dict[str, Any] = {
        "valve": valve,
        "verdict": Verdict.STICKY,
        "reason": "The valve sticks.",
        "advice": "Check the packing.",
        "shape": Shape.UNDERSHOOT,
        "severity": 61.5,
        "confidence": 0.9,
        "S": Estimate(value=3.1, low=2.8, high=3.4, unit="%"),
        "J": Estimate.unknown("too few slips"),
        "residuals": {"stiction": Residual(rmse=0.4, normalised=0.2), "baseline": None},
        "quality": DataQuality(grade="B", reasons=("3 gaps",)),
        "indicators": {
            "reversals": Indicator(name="reversals", value=42.0, unit="", meaning="Reversals of OP")
        },
        "still_seen": ("The OP oscillates.",),
        "baseline_note": "No baseline yet.",
        "recording": Recording(valve=valve, signals={Role.OP: op}, interval_s=1.0, start=start),
        "provenance": Provenance(
            source="exports/a.csv", digest="ab" * 32, layout="wide", decisions=("comma",)
        ),
        "seconds": 0.25,
    }
    return Screening(**fields | changes)
