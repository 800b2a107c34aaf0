"""Every route against every role, by session, by token and by neither."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from typing import Any

import httpx
import pytest
from fastapi import FastAPI
from starlette.routing import BaseRoute

from stemwatch.service.access.permissions import PERMISSIONS, CurrentUser, Operation
from stemwatch.service.access.sessions import form_token_of
from stemwatch.service.access.tokens import BEGINS
from stemwatch.service.store.accounts.audit import AuditFilter
from stemwatch.service.store.accounts.records import Scope, UserRole
from stemwatch.service.web.app import create_app
from stemwatch.service.web.auth.route_permissions import ROUTE_OPERATIONS
from tests.service.web.example_plant import STICKY
from tests.service.web.signed_in import NAMES, bearer_of, cookie_of, user_of

# What a request must hold to be answered; of forms and bodies as little as is refused kindly.
FIELDS = {"id": STICKY, "name": "pages.css", "start": "2026-03-30T11:00:00Z"}
FIELDS |= {"stop": "2026-03-30T12:00:00Z"}
FORM = {"alert": "999", "how": "acknowledge", "run": "999", "valve": STICKY, "text": "x"}
FORM |= {"user": "999", "role": "viewer", "token": "999", "number": "999", "days": "7"}
FORM |= {"name": "x", "password": "x", "present": "x", "again": "x"}
BODY = {"text": "x", "until": "2027-01-01T00:00:00Z"}


def routes_of(routes: list[BaseRoute]) -> Iterator[tuple[str, str]]:
    """Every method and path that an application answers, however deep the route lies."""
    for route in routes:
        inner = getattr(route, "original_router", None) or getattr(route, "app", None)
        if hasattr(inner, "routes") and not hasattr(route, "methods"):
            yield from routes_of(inner.routes)
            continue
        for method in getattr(route, "methods", None) or ():
            if method != "HEAD":
                yield method, str(getattr(route, "path", route))


def ask(app: FastAPI, method: str, path: str, **what: Any) -> httpx.Response:
    """One answer of the application."""

    async def once() -> httpx.Response:
        transport = httpx.ASGITransport(app)
        cookies = what.pop("cookies", None)
        async with httpx.AsyncClient(
            transport=transport, base_url="http://localhost", cookies=cookies
        ) as client:
            return await client.request(method, path, **what)

    return asyncio.run(once())


@pytest.fixture
def app(live) -> FastAPI:
    """The small plant's application."""
    return create_app(live)


def test_every_route_declares_its_right(app):
    """A route without a line in the table fails here; so does a line without a route."""
    result = {f"{method} {path}" for method, path in routes_of(app.routes)}
    assert sorted(result) == sorted(ROUTE_OPERATIONS)
    assert {*ROUTE_OPERATIONS.values()} == {*Operation} - {Operation.UNDECLARED}


def test_a_route_without_a_declared_permission_is_refused_to_all(live, monkeypatch):
    """Without a declared right even an admin's token gets nothing, and a viewer less."""
    from stemwatch.service.web.auth import route_permissions as permits

    forgotten = {name: what for name, what in ROUTE_OPERATIONS.items() if name != "GET /alerts"}
    monkeypatch.setattr(permits, "ROUTE_OPERATIONS", forgotten)
    app = create_app(live)
    assert ask(app, "GET", "/alerts", headers=bearer_of(live)).status_code == 403
    answer = ask(app, "GET", "/alerts", cookies=cookie_of(live, UserRole.ENGINEER))
    assert answer.status_code == 403
    assert STICKY not in answer.text


def request_for(name: str) -> tuple[str, str, dict[str, Any]]:
    """Method, path and contents of a request for a route."""
    method, path = name.split()
    path = path.replace("{name}", "pages.css")
    if method == "GET":
        return method, path, {"params": FIELDS}
    if path.startswith("/api/"):
        return method, path, {"params": {"id": "999"}, "json": BODY}
    return method, path, {"data": FORM}


def let_in(live, role: UserRole, way: str) -> tuple[CurrentUser | None, dict[str, Any]]:
    """Who asks in this way, and what the request carries for it."""
    if way == "session":
        cookies = cookie_of(live, role)
        mark = form_token_of(*cookies.values())
        return CurrentUser(name="", role=role, signed_in_by=""), {"cookies": cookies, "mark": mark}
    if way == "token":
        current_user = CurrentUser(name="", role=role, signed_in_by="", scopes=frozenset(Scope))
        return current_user, {"headers": bearer_of(live, role), "mark": ""}
    return None, {"mark": ""}


def expected(name: str, current_user: CurrentUser | None, *, is_form: bool) -> set[int]:
    """The statuses of refusal that are due: none where the right is there."""
    operation = ROUTE_OPERATIONS[name]
    if PERMISSIONS[operation].least is None:
        return set()
    if current_user is None:
        return {401}
    by_token = current_user.scopes is not None
    return set() if current_user.may(operation) and not (by_token and is_form) else {403}


# Every role and every way of signing in has its short turn.
IN_LONG = {
    (UserRole.VIEWER, "token"),
    (UserRole.ENGINEER, "session"),
    (UserRole.ADMIN, "session"),
    (UserRole.ADMIN, "token"),
    (UserRole.ENGINEER, "nobody"),
    (UserRole.ADMIN, "nobody"),
}


@pytest.mark.parametrize(
    ("role", "way"),
    [
        pytest.param(role, way, marks=[pytest.mark.long] if (role, way) in IN_LONG else [])
        for role in UserRole
        for way in ("session", "token", "nobody")
    ],
)
def test_every_route_refuses_roles_without_its_permission(live, app, role, way):
    """Every route: let in where the right is there, else refused with nothing in the answer."""
    current_user, carried = let_in(live, role, way)
    for name, operation in ROUTE_OPERATIONS.items():
        if way == "session":  # some routes end the session they were asked in
            current_user, carried = let_in(live, role, way)
        what = {key: value for key, value in carried.items() if key != "mark"}
        method, path, sent = request_for(name)
        if "data" in sent and PERMISSIONS[operation].least is not None:
            sent["data"] = {**sent["data"], "mark": carried["mark"]}
        answer = ask(app, method, path, **what, **sent)
        due = expected(name, current_user, is_form="data" in sent)
        if due:
            assert answer.status_code in due, name
            others = {item for mine, item in NAMES.items() if mine is not role}
            assert not [data for data in (STICKY, *others) if data in answer.text], name
        elif PERMISSIONS[operation].least is not None:
            assert answer.status_code not in (401, 403), name
        assert answer.status_code != 500, name


@pytest.mark.parametrize(
    ("scopes", "path", "status"),
    [
        ((Scope.READ,), "GET /api/v1/valves", 200),
        ((Scope.READ,), "POST /api/v1/valve/note", 403),
        ((Scope.ACT,), "GET /api/v1/valves", 403),
        ((Scope.ACT,), "POST /api/v1/valve/note", 200),
        ((Scope.ADMIN,), "GET /api/v1/audit", 200),
        ((Scope.ADMIN,), "GET /api/v1/valves", 403),
        ((Scope.READ, Scope.ACT), "GET /api/v1/audit", 403),
        ((Scope.READ,), "GET /metrics", 200),
    ],
)
def test_a_token_does_what_its_scopes_say_and_no_more(live, app, scopes, path, status):
    """A token of an admin has only the rights of its scopes; a scope does not include others."""
    method, place = path.split()
    what = {"json": {"text": "x"}} if method == "POST" else {}
    headers = bearer_of(live, UserRole.ADMIN, scopes)
    answer = ask(app, method, place, params={"id": STICKY}, headers=headers, **what)
    assert answer.status_code == status


@pytest.mark.parametrize(
    "path",
    [
        "/users%0A",
        "http://localhost//users",
        "/users/",
        "/USERS",
        "/./users",
        "/x/../users",
        "/users;x",
        "/users%00",
    ],
)
def test_no_spelling_of_an_address_gets_around_the_table(live, app, path):
    """The permission check and the router see the same path, however it is spelled."""
    answer = ask(app, "GET", path, cookies=cookie_of(live, UserRole.VIEWER))
    assert answer.status_code in (307, 403, 404)
    assert NAMES[UserRole.ADMIN] not in answer.text


@pytest.mark.parametrize("method", ["HEAD", "OPTIONS", "PUT", "DELETE", "PATCH", "TRACE"])
def test_no_other_method_gets_around_the_table(live, app, method):
    """A route answers its own methods only, and nobody is told which."""
    for path in ("/", "/users", "/api/v1/valves", "/api/openapi.json"):
        body = {} if method in ("HEAD", "OPTIONS") else {"content": b""}
        headers = {"content-length": "0"}
        nobody = ask(app, method, path, headers=headers, **body)
        assert nobody.status_code == 401
        assert "allow" not in nobody.headers


def test_opening_a_page_without_session_leads_to_the_login_and_back(live, app):
    """A browser gets a redirect that keeps the address; everything else gets 401."""
    html = {"accept": "text/html,*/*"}
    answer = ask(app, "GET", "/valve", params={"id": STICKY}, headers=html)
    assert answer.status_code == 303
    assert answer.headers["location"] == f"/login?next=%2Fvalve%3Fid%3D{STICKY}"
    for headers in ({}, {**html, "x-stemwatch-refresh": "1"}, {**html, "authorization": "x"}):
        assert ask(app, "GET", "/valve", headers=headers).status_code == 401


def test_whoever_is_refused_is_told_what_is_missing(live, app):
    """The refusal names the role that is needed and the user's role, or the missing scope."""
    answer = ask(app, "GET", "/users", cookies=cookie_of(live, UserRole.ENGINEER))
    assert f"needs the role admin; {NAMES[UserRole.ENGINEER]} is engineer" in answer.text
    headers = bearer_of(live, UserRole.ADMIN, (Scope.READ,))
    answer = ask(app, "GET", "/api/v1/audit", headers=headers)
    assert "needs the scope admin" in answer.json()["detail"]


def test_a_role_holds_from_the_next_request_on(live, app):
    """Taken or given, for sessions and tokens alike."""
    cookies, headers = cookie_of(live, UserRole.ENGINEER), bearer_of(live, UserRole.ENGINEER)
    user_of(live, UserRole.ADMIN)
    user = live.store.accounts.find(NAMES[UserRole.ENGINEER])
    live.store.accounts.set_role(user.id, UserRole.ADMIN)
    assert ask(app, "GET", "/users", cookies=cookies).status_code == 200
    live.store.accounts.set_role(user.id, UserRole.VIEWER)
    assert ask(app, "GET", "/users", cookies=cookies).status_code == 403
    note = {"params": {"id": STICKY}, "json": {"text": "x"}}
    assert ask(app, "POST", "/api/v1/valve/note", headers=headers, **note).status_code == 403


def test_every_change_and_every_refusal_is_in_the_audit_log(live, app):
    """Who, how, from where, what, about what, and what became of it; reading is not in it."""
    cookies = cookie_of(live, UserRole.ENGINEER)
    ask(app, "GET", "/", cookies=cookies)
    ask(app, "GET", "/users", cookies=cookies)
    params = {"id": STICKY}
    headers = bearer_of(live, UserRole.ENGINEER)
    ask(app, "POST", "/api/v1/valve/note", params=params, json={"text": "s"}, headers=headers)
    ask(app, "POST", "/api/v1/valve/note", params=params, json={"text": ""}, headers=headers)
    ask(app, "POST", "/api/v1/runs", json={}, headers={"authorization": f"Bearer {BEGINS}x"})
    result = live.store.audit.read(AuditFilter())[::-1]
    sentences = [
        (item.who, item.how, item.action, item.about, item.outcome.value) for item in result
    ]
    me = NAMES[UserRole.ENGINEER]
    assert sentences == [
        (me, "session", "manage users", "", "refused"),
        (me, "token test", "add a note", f"id {STICKY}", "done"),
        (me, "token test", "add a note", f"id {STICKY}", "failed"),
        ("", "a bad token", "begin a run", "", "refused"),
    ]
    assert {item.address for item in result} == {"127.0.0.1"}


def test_strangers_cannot_fill_the_audit_log(live, app):
    """A hundred bad tokens from one address within a minute are one entry."""
    for number in range(100):
        ask(app, "GET", "/api/v1/runs", headers={"authorization": f"Bearer {number}"})
    assert len(live.store.audit.read(AuditFilter())) == 1
