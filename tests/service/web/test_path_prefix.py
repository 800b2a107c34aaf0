"""Pages below a path of their host, as a proxy passes it on."""

from __future__ import annotations

import asyncio
import re

import httpx
import pytest

from stemwatch.service.web.app import create_app
from stemwatch.service.web.path_prefix import below_path, path_of_address
from stemwatch.service.web.site import Site
from tests.service.web.example_plant import STICKY
from tests.service.web.signed_in import cookie_of

ADDRESS = "https://plant.example/stem/"


def answer_of(site: Site, path: str, *, signed_in: bool = True) -> httpx.Response:
    """What a browser gets at ``path`` of a service whose address is ``ADDRESS``."""
    app = below_path(create_app(site), path_of_address(ADDRESS))

    async def ask() -> httpx.Response:
        async with httpx.AsyncClient(
            transport=httpx.ASGITransport(app),
            base_url="http://localhost",
            cookies=cookie_of(site) if signed_in else {},
            headers={"accept": "text/html"},
        ) as client:
            return await client.get(path)

    return asyncio.run(ask())


def links_in(text: str) -> list[str]:
    """Every link of a page that leads to the service itself."""
    return re.findall(r"""(?:href|src|action)="(/[^"]*)""", text)


@pytest.mark.parametrize(
    ("page", "root"),
    [(f"/stem/valve?id={STICKY}", "/stem/"), ("/stem", "/stem/"), (f"/valve?id={STICKY}", "/")],
)
def test_links_lead_to_where_the_page_was_asked(live: Site, page: str, root: str) -> None:
    """Below the path through the proxy, at the root on the machine itself."""
    answer = answer_of(live, page)
    links = links_in(answer.text)
    assert answer.status_code == 200
    assert len(links) > 10
    assert all(link.startswith(root) for link in links)
    assert root == "/stem/" or not any(link.startswith("/stem/") for link in links)


def test_what_goes_by_the_path_of_a_request_goes_by_its_own(live: Site) -> None:
    """The login leads back to the page, the API refuses in JSON, bundles are kept by browsers, and
    a neighbour's path is none of ours."""
    login = answer_of(live, f"/stem/valve?id={STICKY}", signed_in=False)
    assert login.headers["location"] == f"/stem/login?next=%2Fvalve%3Fid%3D{STICKY}"
    refused = answer_of(live, "/stem/api/v1/valve/signals?id=nobody")
    assert (refused.status_code, list(refused.json())) == (422, ["detail"])
    missing = answer_of(live, "/stem/static/nothing.js")
    assert "cache-control" not in missing.headers
    assert answer_of(live, "/stemming/valve").status_code == 404


def test_an_address_without_a_path_changes_nothing(live: Site) -> None:
    """The application is served as it is."""
    app = create_app(live)
    assert [below_path(app, path_of_address(one)) for one in ("", "https://a.b", "http://a/")] == [
        app
    ] * 3
