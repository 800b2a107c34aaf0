"""Styles and scripts, put together once from files of this package and of the report.

Each has its digest in its address, so that a browser keeps it for as long as it is the same.
"""

from __future__ import annotations

import hashlib
from functools import cache
from importlib.resources import files

from fastapi import APIRouter, HTTPException, Request, Response

BUNDLES = {
    "pages.css": (
        "report/scripts/vendor/uPlot.min.css",
        "report/styles/report.css",
        "report/styles/mismatch.css",
        "report/styles/print.css",
        "web/static/pages.css",
        "web/static/valve.css",
    ),
    "theme.js": ("report/scripts/theme.js",),
    "pages.js": ("web/static/pages.js",),
    "valve.js": (
        "report/scripts/vendor/uPlot.iife.min.js",
        "report/scripts/axes.js",
        "report/scripts/loop.js",
        "web/static/signals.js",
        "web/static/months.js",
        "web/static/valve.js",
    ),
    "uplot-licence.txt": ("report/scripts/vendor/uPlot-LICENSE.txt",),
}
TYPES = {"css": "text/css", "js": "text/javascript", "txt": "text/plain"}
A_YEAR = "public, max-age=31536000, immutable"

router = APIRouter(include_in_schema=False)


@cache
def bundle(name: str) -> bytes:
    """The bytes of a bundle. Raises ``KeyError`` where there is none of this name."""
    root = files("stemwatch.service")
    texts = [root.joinpath(path).read_text("utf-8").strip() for path in BUNDLES[name]]
    return (";\n" if name.endswith(".js") else "\n").join(texts).encode()


@cache
def address(name: str) -> str:
    """Where a page finds a bundle, below the root of the site."""
    return f"/static/{name}?v={hashlib.sha256(bundle(name)).hexdigest()[:16]}"


@router.get("/static/{name}")
def static(name: str, request: Request) -> Response:
    """One bundle; 404 for every other name, so that no path leads into the file system."""
    if name not in BUNDLES:
        raise HTTPException(404, f"there is no file {name!r}")
    kind = f"{TYPES[name.rsplit('.', 1)[1]]}; charset=utf-8"
    # Without the digest the address is the same for a new version, so browsers must revalidate it.
    has_digest = request.url.query == address(name).partition("?")[2]
    keep = A_YEAR if has_digest else "no-cache"
    return Response(bundle(name), headers={"content-type": kind, "cache-control": keep})
