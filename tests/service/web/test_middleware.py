"""Which requests are accepted, and which security headers every answer has."""

from __future__ import annotations

import logging
import re
from dataclasses import replace
from importlib.resources import files

import pytest

from stemwatch.service.store.errors import StoreError
from stemwatch.service.web.pages.settings_page import shown_keys
from stemwatch.service.web.site import Check, Site
from tests.service.web.example_plant import HOSTILE, STICKY

PAGES = ("/", "/alerts", "/runs", "/sources", "/settings", "/api/docs", "/nowhere", "/run?id=77")
TOKEN = "a-long-and-secret-token"


@pytest.mark.parametrize("path", [*PAGES, f"/valve?id={STICKY}", "/api/v1/valves", "/healthz"])
def test_every_answer_says_what_a_browser_may_do(client, path):
    """Errors too: only our own scripts and styles, no frames, nothing kept by the browser."""
    headers = client.get(path).headers
    policy = headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "script-src 'self';" in policy
    assert "frame-ancestors 'none'" in policy
    assert headers["x-content-type-options"] == "nosniff"
    assert headers["cache-control"] == "no-store"


@pytest.mark.parametrize("path", [*PAGES, f"/valve?id={STICKY}"])
def test_no_page_holds_a_script_or_names_another_machine(client, path):
    """Scripts are files of ours, there are no event attributes, and no address leaves."""
    text = client.get(path).text
    scripts = re.findall(r"<script\b[^>]*>(.*?)</script>", text, re.DOTALL)
    assert scripts
    assert set(scripts) == {""}
    assert not re.search(r"<[^>]+\son\w+\s*=", text)
    loaded = re.findall(r"""(?:src|href|action)=["']([^"']+)""", text)
    assert [item for item in loaded if re.match(r"(?:\w+:)?//", item)] == []


@pytest.mark.parametrize(
    "host",
    ["127.0.0.1:8410@evil", "127.0.0.1@evil:1", "127.0.0.1:", "127.0.0.1:1/x", "[::1]:80@evil",
     "localhost:1 evil", "localhost:999999", ""],
)  # fmt: skip
def test_a_host_that_is_no_name_and_port_is_refused(client, host):
    """In 127.0.0.1:8410@evil the machine is evil, and one-time links are built of it."""
    assert client.get("/login", headers={"host": host}).status_code == 421


@pytest.mark.parametrize("host", ["127.0.0.1:8410", "localhost", "[::1]:8300", "LOCALHOST:1"])
def test_a_host_of_this_machine_is_answered(client, host):
    """With and without port, whatever the letters' case."""
    assert client.get("/login", headers={"host": host}).status_code == 200


def test_an_unforeseen_failure_is_a_page_with_the_headers_too(live, client, monkeypatch, caplog):
    """The reader gets a sentence, the log gets the trace, and the policy holds there as well."""

    def fail(*_):
        raise RuntimeError("geheim")

    monkeypatch.setattr(type(live.store), "ranking", fail)
    with caplog.at_level(logging.ERROR):
        answer = client.get("/")
    assert answer.status_code == 500
    assert "service&#39;s log" in answer.text
    assert "geheim" not in answer.text
    assert "geheim" in caplog.text
    assert "content-security-policy" in answer.headers


def test_a_database_that_is_away_is_said_so(live, client, monkeypatch):
    """503 with a sentence, on pages, in the API and for the supervisor, without the address."""

    def away(*_):
        raise StoreError("postgresql://plant@db/x: reading failed")

    monkeypatch.setattr(type(live.store.transactions), "reading", away)
    for path in ("/", "/api/v1/valves", "/healthz"):
        answer = client.get(path)
        assert answer.status_code == 503
        assert "database does not answer" in answer.text
        assert "plant@db" not in answer.text


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1.evil.example", "", "[::2]:80"])
def test_a_foreign_name_is_not_answered(client, host):
    """A page elsewhere whose name was made to point at this machine reads nothing."""
    answer = client.get("/", headers={"host": host})
    assert answer.status_code in (400, 421)
    assert STICKY not in answer.text


@pytest.mark.parametrize("host", ["localhost", "LOCALHOST:8080", "127.0.0.1:1", "[::1]:9", "[::1]"])
def test_this_machines_names_are_answered(client, host):
    """With or without a port, in any case."""
    assert client.get("/", headers={"host": host}).status_code == 200


def bearer(secret: str) -> dict[str, str]:
    """The header by which a program shows its token."""
    return {"authorization": f"Bearer {secret}"}


def test_the_token_of_the_environment_reads_and_acts(live, client_of):
    """It opens pages and API, signs with its own name, and manages nobody."""
    client = client_of(replace(live, token=TOKEN), None)
    assert client.get("/", headers=bearer(TOKEN)).status_code == 200
    note = {"text": "from a script"}
    path = f"/api/v1/valve/note?id={STICKY}"
    assert client.post(path, json=note, headers=bearer(TOKEN)).status_code == 200
    assert live.store.notes(STICKY)[-1].who == "STEMWATCH_WEB_TOKEN"
    for path in ("/users", "/account", "/tokens", "/audit", "/api/v1/audit"):
        assert client.get(path, headers=bearer(TOKEN)).status_code == 403


@pytest.mark.parametrize("wrong", ["Bearer wrong", "Bearer", "Basic eDp5", f"Basic {TOKEN}", ""])
def test_a_wrong_token_opens_nothing(live, client_of, wrong):
    """Not even beside a session that would do: who shows a token is asked for a right one."""
    client = client_of(replace(live, token=TOKEN))
    answer = client.get("/api/v1/valves", headers={"authorization": wrong})
    assert answer.status_code == 401
    assert answer.headers["www-authenticate"].startswith("Bearer")
    assert STICKY not in answer.text


def test_the_token_is_in_no_text_of_the_site(live):
    """Printing the site for a log does not print its token."""
    assert TOKEN not in repr(replace(live, token=TOKEN))


def test_a_token_that_can_be_guessed_opens_nothing(live, client_of, caplog):
    """The log says so at the start, without the token itself."""
    with caplog.at_level(logging.WARNING):
        client = client_of(replace(live, token="valves"), None)
    assert "lets nobody in" in caplog.text
    assert "valves" not in caplog.text
    assert client.get("/api/v1/valves", headers=bearer("valves")).status_code == 401


def test_health_says_what_does_not_work(live, client_of):
    """503 as soon as one part says that it does not work, with the part's own words."""
    checks = (Check(name="collector", ok=False, says="no sample for 2 min"),)
    answer = client_of(replace(live, checks=lambda: checks)).get("/healthz")
    assert answer.status_code == 503
    assert answer.json()["ok"] is False
    assert answer.json()["checks"][1]["says"] == "no sample for 2 min"


@pytest.mark.parametrize("name", ["../app.py", "..%2Fapp.py", "app.py", "%00", "uplot.txt"])
def test_only_named_files_are_served(client, name):
    """No path leads into the file system."""
    assert client.get(f"/static/{name}").status_code == 404


def test_files_are_kept_by_the_browser_until_they_change(client):
    """The digest in the address makes them safe to keep; without it they are asked for again."""
    page = client.get("/").text
    address = re.search(r'href="(/static/pages\.css\?v=\w+)"', page)[1]
    assert "immutable" in client.get(address).headers["cache-control"]
    assert client.get("/static/pages.css?v=old").headers["cache-control"] == "no-cache"


def test_a_body_that_is_too_long_is_not_read(client):
    """Nobody fills the memory through a form."""
    answer = client.post("/runs/begin", content=b"x" * 100_000)
    assert answer.status_code == 413


def test_settings_show_no_secret(store, client_of, tmp_path):
    """The database's password and secrets of sources are masked."""
    from stemwatch.service.store.database_url import DatabaseUrl
    from tests.service.web.example_plant import plant_of

    plant = plant_of(tmp_path, store)
    store.address = DatabaseUrl("postgresql://plant:geheim@db/stemwatch")
    text = client_of(Site(store=store, plant=plant)).get("/settings").text
    assert "geheim" not in text
    assert "***" in text
    assert "sticky_S_percent" in text


def test_what_could_be_a_secret_is_masked_wherever_it_stands():
    """Keys of any depth; of a webhook's address only the machine is shown."""
    given = {
        "kind": "webhook",
        "url": "https://user:geheim@hooks.example/services/geheim?token=geheim",
        "link": {"target": "10.1.2.3", "api_key": "geheim", "port": 502},
        "secret_variable": "GEHEIM",
        "registers": [{"tag": f"T{k}"} for k in range(9)],
        "to": ["a@plant.org"],
    }
    result = dict(shown_keys(given))
    assert "geheim" not in str(result).lower()
    assert result["url"] == "https://hooks.example/***"
    assert result["link.target"] == "10.1.2.3"
    assert result["registers"] == "9 entries"
    assert result["to"] == "a@plant.org"


def test_no_template_marks_a_text_as_safe():
    """Escaping is never switched off for anything that came from outside."""
    folder = files("stemwatch.service.web").joinpath("templates")
    for template in folder.iterdir():
        text = template.read_text("utf-8")
        assert "|safe" not in text.replace(" ", "")
        assert "autoescape" not in text


def test_hostile_names_are_words_everywhere(client):
    """A tag that is a script is written out on every page that names it."""
    for path, fields in (("/", {}), ("/valve", {"id": HOSTILE}), ("/alerts", {})):
        text = client.get(path, params=fields).text
        assert "<script>alert" not in text
        assert "<img src=x" not in text
        assert "&lt;script&gt;alert(1)" in text
