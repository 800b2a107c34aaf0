"""The client address in a proxy header is trusted from configured proxies only."""

from __future__ import annotations

import logging
from dataclasses import replace

import httpx
import pytest
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import PlainTextResponse
from starlette.routing import Route

from stemwatch.service.config import load_plant
from stemwatch.service.web.site import Site
from tests.service.web.example_plant import serving_app

SAID = {"x-forwarded-for": "198.51.100.7", "x-forwarded-proto": "https"}


async def who(request: Request) -> PlainTextResponse:
    return PlainTextResponse(f"{request.client.host} {request.url.scheme}")


@pytest.mark.parametrize(
    ("proxies", "text", "seen"),
    [
        ((), SAID, "127.0.0.1 http"),
        (("192.0.2.1",), SAID, "127.0.0.1 http"),
        (("127.0.0.1",), SAID, "198.51.100.7 https"),
        (("127.0.0.0/8",), SAID, "198.51.100.7 https"),
        (("127.0.0.1",), {"x-forwarded-for": "10.1.1.1, 198.51.100.7"}, "198.51.100.7 http"),
        (("127.0.0.1",), {}, "127.0.0.1 http"),
    ],
)
def test_only_named_proxies_are_believed(proxies, text, seen) -> None:
    """Any program of the machine could write the headers; and of several addresses in it, the
    one that the proxy itself has seen counts."""
    app = Starlette(routes=[Route("/", who)])
    with serving_app(app, proxies=proxies) as base:
        assert httpx.get(base, headers=text).text == seen


def test_an_untrusted_proxy_is_logged(live: Site, client_of, tmp_path, caplog) -> None:
    """Else everybody behind it would share one address, and one count of failed logins."""
    (tmp_path / "plain.toml").write_text("[plant]\n", encoding="utf-8")
    (tmp_path / "named.toml").write_text(
        '[service]\ntrusted_proxies = ["127.0.0.1"]\n', encoding="utf-8"
    )
    for name, times in (("named", 0), ("plain", 1)):
        plant = load_plant(tmp_path / f"{name}.toml", environment={})
        with caplog.at_level(logging.WARNING):
            client_of(replace(live, plant=plant)).get("/login", headers=SAID)
        assert caplog.text.count("name it in trusted_proxies") == times
