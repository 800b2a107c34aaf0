"""Pages below a path of their host, as ``https://plant.example/valves/``, where ``address`` in
``[service]`` has one."""

from __future__ import annotations

from urllib.parse import urlsplit

from starlette.types import ASGIApp, Receive, Scope, Send


def path_of_address(address: str) -> str:
    """The path below which people reach the pages, without a slash at its end; empty for a host of
    their own."""
    return urlsplit(address).path.rstrip("/")


def below_path(app: ASGIApp, path: str) -> ASGIApp:
    """``app`` below ``path`` too, as a proxy passes it on unchanged, and at the root, as whoever
    asks this machine itself does. Links lead to where the request came to."""

    async def with_root(scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "http" and f"{scope['path']}/".startswith(f"{path}/"):
            asked = f"{path}/" if scope["path"] == path else scope["path"]
            scope = {**scope, "root_path": path, "path": asked}
        await app(scope, receive, send)

    return with_root if path else app


def root_of(scope: Scope) -> str:
    """The path below which a request reached the pages, without a slash at its end."""
    return str(scope.get("root_path", "")).rstrip("/")


def own_path(scope: Scope) -> str:
    """The path of a request below that of the pages, as its route declares it."""
    return str(scope["path"]).removeprefix(root_of(scope)) or "/"
