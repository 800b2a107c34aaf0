"""Signing in and out, one's account, users, tokens and the audit log, as forms."""

from __future__ import annotations

import re
from datetime import datetime, timedelta
from urllib.parse import parse_qs, urlsplit

import httpx
import pytest
from starlette.datastructures import QueryParams

from stemwatch.service.access.links import make_link
from stemwatch.service.access.tokens import make_token
from stemwatch.service.store.accounts.audit import AuditFilter
from stemwatch.service.store.accounts.records import OneTimeLinkKind, Scope, UserRole
from stemwatch.service.web.actions import Actions
from stemwatch.service.web.app import create_app
from stemwatch.service.web.auth.session_cookie import BROWSER_NAME, NAME, SECURE_NAME
from stemwatch.service.web.dependencies import Dependencies
from stemwatch.service.web.page_renderer import PageRenderer
from stemwatch.service.web.pages.audit_page import wanted_of
from stemwatch.service.web.pages.login_page import safe_place
from stemwatch.service.web.site import Site
from tests.service.example_user import make_user
from tests.service.web.example_plant import NOW, STICKY, serving
from tests.service.web.signed_in import NAMES, PASSWORD, bearer_of, user_of


def form_token_in(page: str) -> str:
    """The token of the first form of a page."""
    return re.search(r'name="mark" value="([0-9a-f]{64})"', page)[1]


class Browser:
    """Opens pages and sends their forms, with whatever cookies the site gave."""

    def __init__(self, client: httpx.Client) -> None:
        self.client = client

    def send(self, page: str, path: str, **fields: str) -> httpx.Response:
        """A form of ``page``."""
        mark = form_token_in(self.client.get(page).text)
        return self.client.post(path, data={"mark": mark, **fields})

    def sign_in(self, name: str, password: str = PASSWORD, wanted: str = "") -> httpx.Response:
        """The login."""
        return self.send("/login", "/login", name=name, password=password, next=wanted)


@pytest.fixture
def stranger(live: Site, client_of) -> Browser:
    """Somebody who has not signed in, where Ann (engineer) could."""
    make_user(live.store, "Ann", PASSWORD, UserRole.ENGINEER)
    return Browser(client_of(live, None))


@pytest.fixture
def admin(live: Site, client_of) -> Browser:
    """An admin who has signed in."""
    return Browser(client_of(live))


def test_a_login_leads_to_where_somebody_wanted_to_go(stranger: Browser) -> None:
    """And the pages say who is signed in; signed out, nothing is shown any more."""
    answer = stranger.sign_in("Ann", wanted=f"/valve?id={STICKY}")
    assert answer.status_code == 303
    assert answer.headers["location"] == f"/valve?id={STICKY}"
    cookie = answer.headers["set-cookie"]
    assert cookie.startswith(f"{NAME}=")
    assert {"HttpOnly", "SameSite=lax", "Path=/"} <= set(cookie.split("; "))
    assert "<bdi>Ann</bdi>" in stranger.client.get("/").text
    kept = dict(stranger.client.cookies)
    assert stranger.send("/", "/logout").headers["location"] == "/login"
    stranger.client.cookies.update(kept)  # a copy of the cookie is worth nothing either
    assert stranger.client.get("/").status_code == 401


def test_a_wrong_login_says_one_sentence_and_waits_after_some(stranger: Browser) -> None:
    """The name stays in the form, the password does not; then 429 with the time to wait."""
    answers = [stranger.sign_in("Ann", "a wrong password") for _ in range(6)]
    assert [answer.status_code for answer in answers] == [403] * 5 + [429]
    assert "Name or password is wrong." in answers[0].text
    assert 'value="Ann"' in answers[0].text
    assert "a wrong password" not in answers[0].text
    assert int(answers[5].headers["retry-after"]) >= 1
    assert NAME not in stranger.client.cookies


def test_a_login_never_adopts_a_session_cookie_set_before(stranger: Browser) -> None:
    """Whatever cookie a browser brings, a login gives it a new one."""
    stranger.client.cookies.set(NAME, "laid-down")
    given = stranger.sign_in("Ann").headers["set-cookie"]
    repeated = stranger.sign_in("Ann").headers["set-cookie"]
    assert "laid-down" not in given
    assert given != repeated


def test_a_login_ends_the_session_that_the_browser_had(stranger: Browser, live: Site) -> None:
    """Nobody who kept a copy of the cookie before stays in."""
    stranger.sign_in("Ann")
    old = stranger.client.cookies[NAME]
    stranger.sign_in("Ann")
    assert stranger.client.get("/").status_code == 200
    stranger.client.cookies.set(NAME, old)
    assert len(live.store.web_sessions.of_user(1, now=NOW, idle=timedelta(hours=1))) == 1


def test_a_browser_is_known_after_a_login(stranger: Browser, live: Site, client_of) -> None:
    """Others' guesses do not keep its user out; its cookie travels to the login alone."""
    result = stranger.sign_in("Ann").headers.get_list("set-cookie")
    (cookie,) = [item for item in result if item.startswith(f"{BROWSER_NAME}=")]
    assert {"HttpOnly", "SameSite=lax", "Path=/login", "Max-Age=7776000"} <= set(cookie.split("; "))
    stranger.send("/", "/logout")
    other = Browser(client_of(live, None))
    assert [other.sign_in("Ann", "a wrong one").status_code for _ in range(7)][-1] == 429
    assert other.sign_in("Ann").status_code == 429
    assert stranger.sign_in("Ann").status_code == 303


def test_a_login_form_needs_its_own_token(stranger: Browser) -> None:
    """No other page can sign a browser in under a name of its choosing."""
    fields = {"name": "Ann", "password": PASSWORD}
    assert stranger.client.post("/login", data=fields).status_code == 403
    stranger.client.get("/login")
    wrong = stranger.client.post("/login", data={"mark": "0" * 64, **fields})
    assert wrong.status_code == 403
    assert NAME not in stranger.client.cookies


@pytest.mark.parametrize(
    ("wanted", "led"),
    [
        ("/alerts?state=open", "/alerts?state=open"),
        ("https://evil.example/", "/"),
        ("//evil.example/", "/"),
        ("/\\evil.example", "/"),
        ("javascript:alert(1)", "/"),
        ("/x\r\nset-cookie: a=b", "/"),
        ("//[", "/"),
        ("alerts", "/"),
        ("", "/"),
    ],
)
def test_a_login_leads_nowhere_else(wanted: str, led: str) -> None:
    """A link to the login cannot send anybody to another site."""
    assert safe_place(wanted) == led


def test_with_tls_the_cookie_never_travels_without(live: Site) -> None:
    """Behind a proxy with TLS it is secure and bound to this very name."""
    import asyncio

    make_user(live.store, "Ann", PASSWORD, UserRole.VIEWER)
    transport = httpx.ASGITransport(create_app(live))

    async def ask() -> str:
        async with httpx.AsyncClient(transport=transport, base_url="https://localhost") as client:
            mark = form_token_in((await client.get("/login")).text)
            fields = {"mark": mark, "name": "Ann", "password": PASSWORD}
            answer = await client.post("/login", data=fields)
            assert (await client.get("/")).status_code == 200
            return answer.headers["set-cookie"]

    cookie = asyncio.run(ask())
    assert cookie.startswith(f"{SECURE_NAME}=")
    assert "Secure" in cookie.split("; ")


def test_a_form_that_was_opened_before_a_restart_is_taken_after_it(live: Site, client_of) -> None:
    """Session and form token belong to the browser and the store, not to a process."""
    before = Browser(client_of(live))
    mark, cookies = form_token_in(before.client.get("/runs").text), dict(before.client.cookies)
    repeated = serving(live)
    with (
        repeated as base,
        httpx.Client(base_url=base, trust_env=False, verify=False, timeout=30) as after,
    ):
        after.cookies.update(cookies)
        answer = after.post("/runs/begin", data={"mark": mark, "area": ""})
    assert answer.status_code == 303
    assert len(live.store.queue.going()) == 1


def test_the_first_admin_comes_by_the_link_and_invites_the_others(store, client_of) -> None:
    """From an empty database to an engineer at work, without a password in anybody else's hands."""
    from stemwatch.service.access.links import first_link

    site = Site(store=store)
    first = Browser(client_of(site, None))
    assert "Nobody can sign in yet" in first.client.get("/login").text
    parts = urlsplit(first_link(store, "http://127.0.0.1:8300/"))
    path, secret = f"{parts.path}?{parts.query}", parse_qs(parts.query)["link"][0]
    fields = {"link": secret, "name": "Karl", "password": PASSWORD}
    odd = first.send(path, "/welcome", **fields, again="something else")
    assert odd.status_code == 422
    assert "not the same" in odd.text
    assert first.send(path, "/welcome", **fields, again=PASSWORD).status_code == 303
    assert "<bdi>Karl</bdi>" in first.client.get("/").text
    assert first.client.get(path).status_code == 410
    page = first.send("/users", "/users/invite", role="engineer", note="Ann").text
    invited = re.search(r'value="http://[^"]+(/welcome\?link=[\w-]{43})"', page)[1]
    second = Browser(client_of(site, None))
    fields = {"link": invited.partition("=")[2], "name": "Ann", "password": PASSWORD}
    assert second.send(invited, "/welcome", **fields, again=PASSWORD).status_code == 303
    assert store.accounts.find("Ann").role is UserRole.ENGINEER
    sentences = [(item.who, item.action) for item in store.audit.read(AuditFilter())[::-1]]
    assert sentences == [
        ("Karl", "become a user"), ("Karl", "manage users"), ("Ann", "become a user"),
    ]  # fmt: skip


def test_a_password_is_changed_by_who_knows_it(stranger: Browser, live: Site, client_of) -> None:
    """Every other browser is signed out, this one stays, under a new cookie."""
    stranger.sign_in("Ann")
    other = Browser(client_of(live, None))
    other.sign_in("Ann")
    new = {"password": "another long phrase", "again": "another long phrase"}
    wrong = stranger.send("/account", "/account/password", present="a guess", **new)
    assert wrong.status_code == 422
    assert "present password is wrong" in wrong.text
    result = stranger.send("/account", "/account/password", present=PASSWORD, **new)
    assert result.status_code == 303
    assert "Your password is changed" in stranger.client.get(result.headers["location"]).text
    assert other.client.get("/").status_code == 401


def test_a_token_is_shown_once_and_revoked(stranger: Browser, live: Site) -> None:
    """Made with the scopes that were ticked; its page, its log and its list do not show it."""
    stranger.sign_in("Ann")
    fields = {"name": "historian script", "scope": "read", "days": "30"}
    page = stranger.send("/account", "/account/tokens/make", **fields).text
    secret = re.search(r'value="(stw_[\w-]{43})"', page)[1]
    assert secret not in stranger.client.get("/account").text
    assert secret not in str(live.store.audit.read(AuditFilter()))
    with serving(live) as base:
        headers = {"authorization": f"Bearer {secret}"}
        me = httpx.get(f"{base}/api/v1/me", headers=headers, trust_env=False).json()
        assert (me["name"], me["role"], me["scopes"]) == ("Ann", "engineer", ["read"])
        (token,) = live.store.api_tokens.all()
        stranger.send("/account", "/account/tokens/revoke", token=str(token.id))
        repeated = httpx.get(f"{base}/api/v1/me", headers=headers, trust_env=False)
    assert repeated.status_code == 401


def test_users_neither_make_tokens_above_their_role_nor_revoke_those_of_others(
    stranger: Browser, live: Site
) -> None:
    """A scope above one's role, a lifetime that is none, somebody else's token."""
    stranger.sign_in("Ann")
    base = {"name": "x", "days": "30"}
    result = stranger.send("/account", "/account/tokens/make", **base, scope="admin")
    assert result.status_code == 422
    odd = stranger.send("/account", "/account/tokens/make", name="x", days="9999", scope="read")
    assert odd.status_code == 422
    make_token(live.store, user_of(live), "the admin's", [Scope.READ], now=NOW)
    (token,) = live.store.api_tokens.all()
    removed = stranger.send("/account", "/account/tokens/revoke", token=str(token.id))
    assert removed.status_code == 404
    assert live.store.api_tokens.all()[0].revoked is None


def test_an_admin_manages_users(admin: Browser, live: Site) -> None:
    """Role, new password, disable, enable; each is in the log with the name of the user."""
    ann = user_of(live, UserRole.VIEWER)
    number = {"user": str(ann.id)}
    admin.send("/users", "/users/role", **number, role="engineer")
    page = admin.send("/users", "/users/password", **number).text
    assert re.search(r'value="http://[^"]+/welcome\?link=[\w-]{43}"', page)
    admin.send("/users", "/users/disable", **number)
    assert live.store.accounts.get(ann.id).disabled == NOW
    assert live.store.access_links.open(NOW) == []
    assert admin.send("/users", "/users/password", **number).status_code == 409
    admin.send("/users", "/users/enable", **number)
    result = live.store.accounts.get(ann.id)
    assert (result.role, result.disabled) == (UserRole.ENGINEER, None)
    about = [item.about for item in live.store.audit.read(AuditFilter(action="manage users"))[::-1]]
    assert about[0] == f"user {ann.id}; role engineer; {ann.name}; before viewer"
    assert all(ann.name in item for item in about)


@pytest.mark.parametrize(
    ("path", "fields", "status"),
    [
        ("/users/role", {"user": "1", "role": "boss"}, 422),
        ("/users/role", {"user": "99", "role": "viewer"}, 404),
        ("/users/role", {"user": "1", "role": "viewer"}, 409),
        ("/users/disable", {"user": "1"}, 409),
        ("/users/disable", {"user": "9" * 15}, 404),
        ("/users/links/withdraw", {"number": "99"}, 404),
        ("/tokens/revoke", {"token": "99"}, 404),
    ],
)
def test_what_cannot_be_done_with_users_is_refused(admin: Browser, path, fields, status) -> None:
    """With a sentence; the only admin stays one."""
    answer = admin.send("/users", path, **fields)
    assert answer.status_code == status
    assert 'class="reason"' in answer.text


def test_a_link_can_be_withdrawn_from_the_page(admin: Browser, live: Site) -> None:
    """It stands in the list until then, without its secret."""
    secret, link = make_link(
        live.store,
        OneTimeLinkKind.INVITATION,
        UserRole.VIEWER,
        made_by="A",
        now=NOW,
        note="for Bob",
    )
    page = admin.client.get("/users").text
    assert "for Bob" in page
    assert secret not in page
    admin.send("/users", "/users/links/withdraw", number=str(link.id))
    assert "for Bob" not in admin.client.get("/users").text


@pytest.mark.long
def test_the_audit_page_filters_and_pages(admin: Browser, live: Site) -> None:
    """By the address, so that a view can be sent; hostile words stay words."""
    for number in range(120):
        admin.client.post(f"/api/v1/valve/note?id={STICKY}", json={"text": f"{number}"})
    make_user(live.store, "<b>Eve</b>", PASSWORD, "viewer")
    page = admin.client.get("/audit?action=add+a+note&start=2026-03-30&stop=2026-03-30").text
    assert page.count("<tr>") == 101
    older = re.search(r'href="(/audit\?[^"]+)">Older', page)[1].replace("&amp;", "&")
    assert admin.client.get(older).text.count("<tr>") == 21
    assert "No entry matches" in admin.client.get("/audit?start=2026-03-31").text
    assert "<b>Eve" not in page
    lines = admin.client.get("/api/v1/audit?limit=5").json()
    assert [line["who"] for line in lines] == [NAMES[UserRole.ADMIN]] * 5


@pytest.mark.parametrize(
    ("day", "end"),
    [
        ("2026-03-30", "2026-03-30T22:00:00+00:00"),
        ("2026-10-25", "2026-10-25T23:00:00+00:00"),  # of 25 hours
        ("9999-12-31", None),
        ("no day", None),
    ],
)
def test_the_last_day_of_the_audit_page_counts_whole(live: Site, day: str, end: str | None) -> None:
    """By the plant's clock, also when it is put back; what is no day filters nothing."""
    deps = Dependencies(site=live, renderer=PageRenderer(live), actions=Actions(live.store))
    stop = wanted_of(QueryParams({"stop": day}), deps).stop
    assert stop == (None if end is None else datetime.fromisoformat(end))


def test_a_viewer_is_shown_no_button_that_would_be_refused(live: Site, client_of) -> None:
    """Pages are whole without them."""
    reader, doer = client_of(live, UserRole.VIEWER), client_of(live, UserRole.ENGINEER)
    for path in ("/alerts", f"/valve?id={STICKY}", "/runs"):
        pages = [item.get(path).text for item in (reader, doer)]
        places = [re.findall(r'<form method="post" action="([^"]+)"', page) for page in pages]
        assert set(places[0]) <= {"/logout"}
        assert len(set(places[1])) > 1


def test_an_unused_session_ends_and_leads_to_the_login(live: Site, client_of) -> None:
    """After a long time without use the session has ended."""
    client = client_of(live)
    assert client.get("/").status_code == 200
    object.__setattr__(live, "clock", lambda: NOW + timedelta(hours=13))
    assert client.get("/").status_code == 401


def test_tokens_of_everybody_are_seen_and_ended_by_an_admin(admin: Browser, live: Site) -> None:
    """The list shows owner and first letters of each token."""
    bearer_of(live, UserRole.ENGINEER)
    page = admin.client.get("/tokens").text
    assert NAMES[UserRole.ENGINEER] in page
    (token,) = live.store.api_tokens.all()
    admin.send("/tokens", "/tokens/revoke", token=str(token.id))
    assert live.store.api_tokens.all()[0].revoked == NOW
