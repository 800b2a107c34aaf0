"""A store with a small plant, a real server on loopback, a client, and Chromium."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import httpx
import pytest

from stemwatch.service.store.accounts.records import UserRole
from stemwatch.service.store.store import Store, open_store
from stemwatch.service.web.site import Site
from tests.service.store.conftest import database_like
from tests.service.store.conftest import postgres_server as postgres_server
from tests.service.store.conftest import sqlite_template as sqlite_template
from tests.service.web import example_plant
from tests.service.web.signed_in import cookie_of

PATIENCE_S = 30.0  # with a machine that has other tests to run


@pytest.fixture
def store(sqlite_template: Path, tmp_path: Path) -> Iterator[Store]:
    """An empty store."""
    path = shutil.copy(sqlite_template, tmp_path / "store.db")
    with open_store(f"sqlite:///{path}") as opened:
        yield opened


@pytest.fixture(scope="session")
def _made_once(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("made") / "store.db"
    with open_store(f"sqlite:///{path}") as created:
        example_plant.fill(created)
        example_plant.write_samples(created)
    return path


@pytest.fixture
def filled(_made_once: Path, tmp_path: Path) -> Iterator[Store]:
    """A store with the small plant and two hours of samples in it, a copy for each test."""
    path = shutil.copy(_made_once, tmp_path / "filled.db")
    with open_store(f"sqlite:///{path}") as opened:
        yield opened


@pytest.fixture
def live(filled: Store, tmp_path: Path) -> Site:
    """The small plant with its plant file and a way to its samples."""
    return Site(
        store=filled,
        plant=example_plant.plant_of(tmp_path, filled),
        read=example_plant.reader_of(filled),
        clock=lambda: example_plant.NOW,
    )


@pytest.fixture
def client_of() -> Iterator[Callable[[Site], httpx.Client]]:
    """Serves a site and gives a client of it, signed in as admin unless told otherwise."""
    open_ones = []

    def start(
        site: Site, role: UserRole | None = UserRole.ADMIN, **options: object
    ) -> httpx.Client:
        around = example_plant.serving(site)
        if role is not None:
            options = {"cookies": cookie_of(site, role), **options}
        base = around.__enter__()
        client = httpx.Client(  # no https here: certificates would take 20 ms a client to read
            base_url=base, trust_env=False, verify=False, timeout=PATIENCE_S, **options
        )
        open_ones.append((around, client))
        return client

    yield start
    for around, client in open_ones:
        client.close()
        around.__exit__(None, None, None)


@pytest.fixture
def client(live: Site, client_of: Callable[[Site], httpx.Client]) -> httpx.Client:
    """A client of the small plant's pages."""
    return client_of(live)


@pytest.fixture
def send(client: httpx.Client) -> Callable[..., httpx.Response]:
    """Sends a form as a browser would: with the cookie and the form token of a page."""

    def post(path: str, **fields: str) -> httpx.Response:
        page = client.get("/runs")
        mark = re.search(r'name="mark" value="([0-9a-f]+)"', page.text)
        assert mark is not None
        return client.post(path, data={"mark": mark[1], **fields})

    return post


@pytest.fixture
def postgres_url(postgres_server: str) -> Iterator[str]:
    """The URL of an empty database on PostgreSQL."""
    with database_like("template1", postgres_server) as url:
        yield url


@pytest.fixture(scope="module")
def module_postgres_url(postgres_server: str) -> Iterator[str]:
    """The URL of a database on PostgreSQL that a module's tests share."""
    with database_like("template1", postgres_server) as url:
        yield url
