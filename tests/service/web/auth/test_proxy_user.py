"""Sign-in by a proxy's header: off by default, from named proxies alone, however it is forged."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import httpx
import pytest

from stemwatch.service.config import load_plant
from stemwatch.service.config.problems import PlantFileError
from stemwatch.service.store.accounts.audit import AuditFilter
from stemwatch.service.store.accounts.records import UserRole
from stemwatch.service.web.app import create_app
from stemwatch.service.web.auth.session_cookie import NAME
from stemwatch.service.web.site import Site
from tests.service.web.example_plant import STICKY, serving_app
from tests.service.web.signed_in import NAMES, cookie_of, user_of

HEADER = "X-Remote-User"
ENGINEER = NAMES[UserRole.ENGINEER]
ON = f'[service]\ntrusted_proxies = ["127.0.0.1"]\nuser_header = "{HEADER}"\n'
ELSEWHERE = ON.replace("127.0.0.1", "192.0.2.7")
OFF = '[service]\ntrusted_proxies = ["127.0.0.1"]\n'


@contextmanager
def served(live: Site, folder: Path, text: str) -> Iterator[httpx.Client]:
    """The pages behind the server of the product, with this plant file."""
    file = folder / "proxied.toml"
    file.write_text(text, encoding="utf-8")
    plant = load_plant(file, environment={})
    assert not plant.problems
    site = replace(live, plant=plant)
    for role in UserRole:
        user_of(site, role)
    proxies = plant.service.trusted_proxies
    with (
        serving_app(create_app(site), proxies=proxies) as base,
        httpx.Client(base_url=base, trust_env=False, timeout=30.0) as client,
    ):
        yield client


def who(client: httpx.Client, *headers: tuple[str, str], **options: object) -> str:
    """As whom the API lets these headers in; the status where it does not."""
    answer = client.get("/api/v1/me", headers=list(headers), **options)  # type: ignore[arg-type]
    return str(answer.json()["name"]) if answer.status_code == 200 else str(answer.status_code)


def test_whom_a_trusted_proxy_names_is_signed_in(live: Site, tmp_path: Path) -> None:
    """Without a password or a cookie, with the role that the user has here."""
    with served(live, tmp_path, ON) as client:
        assert who(client, (HEADER, ENGINEER)) == ENGINEER
        assert who(client, (HEADER, ENGINEER.upper())) == ENGINEER
        assert who(client) == "401"
        page = client.get("/", headers={HEADER: ENGINEER})
        assert STICKY in page.text
        assert "/logout" not in page.text  # the proxy would sign in again at once
        account = client.get("/account", headers={HEADER: ENGINEER}).text
        assert "Signed in" in account
        assert "/logout" not in account
        assert "Change the password" not in account
        assert client.get("/users", headers={HEADER: ENGINEER}).status_code == 403


@pytest.mark.parametrize("text", [OFF, ELSEWHERE, ""])
def test_the_header_from_an_untrusted_address_is_ignored(
    live: Site, tmp_path: Path, text: str
) -> None:
    """Off by default; and from an address that is not named it opens nothing."""
    with served(live, tmp_path, text) as client:
        assert who(client, (HEADER, ENGINEER)) == "401"
        assert client.get("/", headers={HEADER: ENGINEER}).status_code in (303, 401)


@pytest.mark.parametrize(
    "forged",
    [
        [("X-Forwarded-For", "192.0.2.7")],
        [("X-Forwarded-For", "192.0.2.7, 192.0.2.7")],
        [("Forwarded", "for=192.0.2.7")],
        [("X-Real-IP", "192.0.2.7"), ("X-Forwarded-Proto", "https")],
        [("Via", "1.1 192.0.2.7")],
    ],
)
def test_no_header_makes_a_connection_come_from_the_proxy(
    live: Site, tmp_path: Path, forged: list[tuple[str, str]]
) -> None:
    """The proxy is known by the connection, not by what a request says of its way."""
    with served(live, tmp_path, ELSEWHERE) as client:
        assert who(client, (HEADER, ENGINEER), *forged) == "401"


def test_behind_a_trusted_proxy_the_readers_address_changes_nothing(
    live: Site, tmp_path: Path
) -> None:
    """The address that the proxy forwards is the reader's: the connection is the proxy's still."""
    with served(live, tmp_path, ON) as client:
        assert who(client, (HEADER, ENGINEER), ("X-Forwarded-For", "198.51.100.7")) == ENGINEER


def test_a_repeated_user_header_signs_in_nobody(live: Site, tmp_path: Path) -> None:
    """A proxy that adds its header to the reader's own would let everybody be anybody."""
    admin = NAMES[UserRole.ADMIN]
    with served(live, tmp_path, ON) as client:
        assert who(client, (HEADER, admin), (HEADER, ENGINEER)) == "403"
        assert who(client, (HEADER, admin), (HEADER.lower(), ENGINEER)) == "403"
        answer = client.get("/", headers=[(HEADER, admin), (HEADER, ENGINEER)])
        assert "must replace the header" in answer.text


@pytest.mark.parametrize("name", ["", "x" * 500, "a\x7fb", "nobody here", "<b>x</b>"])
def test_an_unknown_name_is_refused_and_logged(live: Site, tmp_path: Path, name: str) -> None:
    """Refused with a sentence, never an error, and noted in the audit log."""
    with served(live, tmp_path, ON) as client:
        answer = client.get("/overview", headers={HEADER: name.encode()})
        assert answer.status_code == 403
        assert "<b>x</b>" not in answer.text
        assert STICKY not in answer.text
    noted = live.store.audit.read(AuditFilter())
    assert any(entry.how == "proxy" and entry.outcome == "refused" for entry in noted)


def test_a_disabled_user_is_refused(live: Site, tmp_path: Path) -> None:
    """The proxy says who somebody is, not that they may come in."""
    with served(live, tmp_path, ON) as client:
        live.store.accounts.disable(user_of(live, UserRole.ENGINEER).id, live.clock())
        assert who(client, (HEADER, ENGINEER)) == "403"


def test_new_users_are_made_only_where_the_plant_file_says_so(live: Site, tmp_path: Path) -> None:
    """With a role for them they come in, once, as what it says; a password never fits them."""
    with served(live, tmp_path, ON + 'user_header_role = "viewer"\n') as client:
        assert who(client, (HEADER, "N. Ewcomer")) == "N. Ewcomer"
        assert who(client, (HEADER, "n. ewcomer")) == "N. Ewcomer"
        refused = client.post("/runs/begin", headers={HEADER: "N. Ewcomer"}, data={"mark": "x"})
        assert refused.status_code == 403
    result = live.store.accounts.find("N. Ewcomer")
    assert result is not None
    assert result.role is UserRole.VIEWER
    assert result.created_by == "proxy"


def test_forms_need_their_token_as_with_a_session(live: Site, tmp_path: Path) -> None:
    """Another site's page cannot make the proxy sign a form: the token belongs to a cookie."""
    with served(live, tmp_path, ON) as client:
        sent = {"valve": STICKY, "text": "looked at it"}
        headers = {HEADER: ENGINEER}
        assert client.post("/valve/note", headers=headers, data=sent).status_code == 403
        forged = {**sent, "mark": "0" * 64}
        assert client.post("/valve/note", headers=headers, data=forged).status_code == 403
        page = client.get(f"/valve?id={STICKY}", headers=headers)
        mark = re.search(r'name="mark" value="([0-9a-f]+)"', page.text)
        assert mark is not None
        right = {**sent, "mark": mark[1]}
        foreign = {**headers, "origin": "https://elsewhere.example"}
        assert client.post("/valve/note", headers=foreign, data=right).status_code == 403
        assert client.post("/valve/note", headers=headers, data=right).status_code == 303
    notes = live.store.notes(STICKY)
    assert ENGINEER in [note.who for note in notes if "looked at it" in note.note]
    entry = live.store.audit.read(AuditFilter(action="add a note"))[0]
    assert (entry.who, entry.how) == (ENGINEER, "proxy")


def test_a_token_and_a_session_work_beside_it(
    live: Site, tmp_path: Path, client_of: Callable[..., httpx.Client]
) -> None:
    """A program's token counts before the header; a session where the proxy names nobody."""
    with served(live, tmp_path, ON) as client:
        assert who(client, (HEADER, ENGINEER), ("Authorization", "Bearer wrong")) == "401"
        cookie = cookie_of(live, UserRole.VIEWER)[NAME]
        assert who(client, ("cookie", f"{NAME}={cookie}")) == NAMES[UserRole.VIEWER]
        both = who(client, ("cookie", f"{NAME}={cookie}"), (HEADER, ENGINEER))
        assert both == ENGINEER


@pytest.mark.parametrize("scheme", ["Basic QW5uOnNlY3JldA==", "Negotiate YIIZ", "Digest x=1"])
def test_what_the_proxy_was_told_itself_is_no_token(
    live: Site, tmp_path: Path, scheme: str
) -> None:
    """nginx with auth_basic and Apache with Kerberos pass the reader's Authorization header on."""
    with served(live, tmp_path, ON) as client:
        assert who(client, (HEADER, ENGINEER), ("Authorization", scheme)) == ENGINEER
        assert who(client, ("Authorization", scheme)) == "401"
        page = client.get("/", headers={"Authorization": scheme, "Accept": "text/html"})
        assert (page.status_code, page.headers["location"]) == (303, "/login")
    with served(live, tmp_path, ELSEWHERE) as client:
        assert who(client, (HEADER, ENGINEER), ("Authorization", scheme)) == "401"


@pytest.mark.parametrize(
    ("text", "answer"),
    [
        ('user_header = "X-Remote-User"', "trusted_proxies as well"),
        ('user_header = "Cookie"\ntrusted_proxies = ["127.0.0.1"]', "a header of its own"),
        ('user_header = "X-User"\ntrusted_proxies = ["0.0.0.0/0"]', "the proxy's own address"),
        ('user_header_role = "viewer"', "user_header as well"),
        ('user_header = "X User"\ntrusted_proxies = ["127.0.0.1"]', "the header in which"),
        (
            'user_header = "X-User"\ntrusted_proxies = ["127.0.0.1"]\nuser_header_role = "admin"',
            "the role of those who are no users yet",
        ),
    ],
)
def test_a_plant_file_that_would_believe_anybody_is_refused(
    tmp_path: Path, text: str, answer: str
) -> None:
    """The service does not start with it; each mistake is said with its line."""
    file = tmp_path / "plant.toml"
    file.write_text(f"[service]\n{text}\n", encoding="utf-8")
    with pytest.raises(PlantFileError) as refused:
        load_plant(file, environment={})
    assert answer in str(refused.value)
