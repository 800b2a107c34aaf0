"""The API against its own description, asked by every role and by nobody (schemathesis)."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest
import schemathesis
from hypothesis import HealthCheck, given, settings
from schemathesis.checks import not_a_server_error
from schemathesis.core.result import Ok
from schemathesis.specs.openapi.checks import (
    content_type_conformance,
    response_headers_conformance,
    response_schema_conformance,
    status_code_conformance,
)

from stemwatch.service.access.permissions import CurrentUser, Operation
from stemwatch.service.store.accounts.records import UserRole
from stemwatch.service.store.store import open_store
from stemwatch.service.web.app import create_app
from stemwatch.service.web.auth.route_permissions import ROUTE_OPERATIONS
from stemwatch.service.web.site import Site
from tests.service.web.example_plant import NOW, fill
from tests.service.web.signed_in import bearer_of

CHECKS = [
    not_a_server_error,
    status_code_conformance,
    content_type_conformance,
    response_headers_conformance,
    response_schema_conformance,
]
HOST = {"host": "localhost"}
OPERATIONS = [name for name in ROUTE_OPERATIONS if name.startswith(("GET /api/v1", "POST /api/v1"))]
OTHERS = ["GET /health", "GET /healthz", "GET /ready", "GET /metrics"]
FEW = settings(
    max_examples=4,
    suppress_health_check=list(HealthCheck),
)

pytestmark = pytest.mark.hypothesis  # drawn anew by ``make explore``

IN_LONG = [pytest.mark.postgres, pytest.mark.long]


class Api:
    """The API of a small plant, and the headers by which each role is let in."""

    def __init__(self, site: Site) -> None:
        self.bearers = {role: bearer_of(site, role) for role in UserRole}
        headers = {**HOST, **self.bearers[UserRole.ADMIN]}
        self.schema = schemathesis.openapi.from_asgi(
            "/api/openapi.json", create_app(site), headers=headers
        )

    def ask(self, name: str, headers: dict[str, str]) -> set[int]:
        """Call an operation with whatever its description allows and more; the statuses that
        came back. Fails where an answer is not as described."""
        method, path = name.split()
        result: set[int] = set()

        @FEW
        @given(case=self.schema[path][method].as_strategy())
        def every(case: schemathesis.Case) -> None:
            answer = case.call(headers={**HOST, **headers})
            case.validate_response(answer, checks=CHECKS)
            result.add(answer.status_code)

        every()
        return result


@contextmanager
def small_plant(url: str) -> Iterator[Api]:
    """The small plant in this database, without a plant file."""
    with open_store(url) as store:
        fill(store, months=1)
        yield Api(Site(store=store, clock=lambda: NOW))


@pytest.fixture(scope="module")
def sqlite_api(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Api]:
    """On SQLite."""
    with small_plant(f"sqlite:///{tmp_path_factory.mktemp('fuzz') / 'store.db'}") as api:
        yield api


@pytest.fixture(scope="module")
def pg_api(module_postgres_url: str) -> Iterator[Api]:
    """On PostgreSQL."""
    with small_plant(module_postgres_url) as api:
        yield api


@pytest.fixture(params=["sqlite", pytest.param("pg", marks=pytest.mark.postgres)])
def api(request: pytest.FixtureRequest) -> Api:
    """The small plant on either engine, made once for all tests: a user has 50 tokens at most."""
    return request.getfixturevalue(f"{request.param}_api")


def test_every_operation_that_is_described_is_fuzzed(api: Api) -> None:
    """The names below are those of the description, none more and none less."""
    get_all_operations = [
        get_all_operation.ok()
        for get_all_operation in api.schema.get_all_operations()
        if isinstance(get_all_operation, Ok)
    ]
    described = {f"{item.method.upper()} {item.path}" for item in get_all_operations}
    assert described == {*OPERATIONS, *OTHERS}


@pytest.mark.parametrize("name", [*OPERATIONS, *OTHERS])
@pytest.mark.parametrize(
    ("api", "role"),
    [
        ("sqlite", UserRole.VIEWER),
        ("sqlite", UserRole.ADMIN),
        pytest.param("sqlite", UserRole.ENGINEER, marks=pytest.mark.long),
        pytest.param("pg", UserRole.ADMIN, marks=IN_LONG),
        pytest.param("pg", UserRole.VIEWER, marks=IN_LONG),
        pytest.param("pg", UserRole.ENGINEER, marks=IN_LONG),
    ],
    indirect=["api"],
)
def test_every_answer_is_as_described_whoever_asks(api: Api, name: str, role: UserRole) -> None:
    """No failure, no undescribed status, no field of another shape; and whoever lacks the right
    is refused whatever is sent."""
    answer = api.ask(name, api.bearers[role])
    allowed = CurrentUser(name="", role=role, signed_in_by="").may(ROUTE_OPERATIONS[name])
    assert (answer == {403}) is not allowed


@pytest.mark.parametrize("name", [*OPERATIONS, *OTHERS])
@pytest.mark.parametrize("api", ["sqlite", pytest.param("pg", marks=IN_LONG)], indirect=True)
def test_without_credentials_no_operation_gives_anything(api: Api, name: str) -> None:
    """401 to whatever is sent, as described; only the supervisors' questions are answered."""
    for headers in ({}, {"authorization": "Bearer stw_" + "x" * 43}):
        answer = api.ask(name, headers)
        assert answer == ({200} if ROUTE_OPERATIONS[name] is Operation.OPEN else {401})
