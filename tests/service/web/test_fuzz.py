"""Whatever an address holds, the answer is a page or a sentence, never a failure."""

from __future__ import annotations

import asyncio
from typing import Any

import httpx
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from stemwatch.service.store.store import open_store
from stemwatch.service.web.app import create_app
from stemwatch.service.web.site import Site
from tests.service.web.example_plant import HOSTILE, NOW, STICKY, fill
from tests.service.web.signed_in import cookie_of

PAGES = (
    *("/", "/valve", "/alerts", "/run", "/runs", "/sources", "/settings", "/api/docs", "/x"),
    *("/account", "/users", "/tokens", "/audit", "/login"),
)
NAMES = (
    *("id", "q", "area", "verdict", "criticality", "sort", "order", "page", "state", "done"),
    *("who", "start", "before", "next"),
)
words = st.one_of(
    st.text(max_size=12),
    st.sampled_from([STICKY, HOSTILE, "1", "-1", "1e9", "9" * 25, "\x00", "%", "_", "sticky"]),
)
printable = words.filter(str.isprintable)
MANY = settings(
    max_examples=15,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)


class Asking:
    """An application without a network between, asked by somebody who may see everything."""

    def __init__(self, site: Site) -> None:
        self._app = create_app(site)
        self._cookies = cookie_of(site)

    def __call__(self, method: str, path: str, **what: Any) -> httpx.Response:
        """One answer."""

        async def ask() -> httpx.Response:
            transport = httpx.ASGITransport(self._app)
            async with httpx.AsyncClient(
                transport=transport, base_url="http://localhost", cookies=self._cookies
            ) as item:
                return await item.request(method, path, **what)

        return asyncio.run(ask())


@pytest.fixture(scope="module", params=["sqlite", pytest.param("pg", marks=pytest.mark.postgres)])
def asking(request, tmp_path_factory):
    """The small plant's pages on either engine, without a plant file."""
    url = f"sqlite:///{tmp_path_factory.mktemp('fuzz') / 'store.db'}"
    if request.param == "pg":
        url = request.getfixturevalue("module_postgres_url")
    with open_store(url) as store:
        fill(store, months=1)
        yield Asking(Site(store=store, clock=lambda: NOW))


@MANY
@given(
    path=st.sampled_from(PAGES),
    fields=st.lists(st.tuples(st.sampled_from(NAMES), printable), max_size=5),
)
def test_no_address_breaks_a_page(asking, path, fields):
    """Found, not found or refused; with the policy on it, and nothing unescaped in it."""
    answer = asking("GET", path, params=fields)
    assert answer.status_code in (200, 404, 422)
    assert "content-security-policy" in answer.headers
    assert "<script>alert" not in answer.text


ODD = ["a\x00b", "\ufffe", "\N{RIGHT-TO-LEFT OVERRIDE}", "ÿ" * 300]


@pytest.mark.parametrize("text", ODD, ids=["NUL", "no sign", "override", "long"])
def test_signs_that_a_database_refuses_are_looked_for_in_vain(asking, text):
    """NUL is in no text of PostgreSQL; asking for it is no failure of ours."""
    for path in PAGES:
        answer = asking("GET", path, params=dict.fromkeys(NAMES, text))
        assert answer.status_code in (200, 404, 422)
