"""An empty store on either engine, with one user in it where a test asks for one."""

from __future__ import annotations

from datetime import UTC, datetime

import pytest

from stemwatch.service.access.passwords import hash_password
from stemwatch.service.store.accounts.records import User, UserRole
from stemwatch.service.store.store import Store
from tests.service.store.conftest import postgres_server as postgres_server
from tests.service.store.conftest import postgres_template as postgres_template
from tests.service.store.conftest import pytest_generate_tests as pytest_generate_tests
from tests.service.store.conftest import sqlite_template as sqlite_template
from tests.service.store.conftest import store as store
from tests.service.store.conftest import store_url as store_url

NOW = datetime(2026, 3, 30, 12, 0, tzinfo=UTC)
PASSWORD = "wet gasket, dry bonnet"


@pytest.fixture(scope="session")
def hashed() -> str:
    """The hash of ``PASSWORD``, worked out once."""
    return hash_password(PASSWORD)


@pytest.fixture
def ann(store: Store, hashed: str) -> User:
    """An engineer whose password is ``PASSWORD``."""
    return store.accounts.add("Ann Berg", UserRole.ENGINEER, hashed, added_by="test", now=NOW)
