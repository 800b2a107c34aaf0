"""The API's own description, with what it asks of whoever calls it."""

from __future__ import annotations

from typing import Any

from fastapi import FastAPI

from stemwatch.service.access.rights import RIGHTS, SCOPE_OF, Operation
from stemwatch.service.web.permits import PERMITS
from stemwatch.service.web.session_cookie import NAME

_SCHEMES = {
    "token": {"type": "http", "scheme": "bearer", "description": "A token of a user."},
    "session": {"type": "apiKey", "in": "cookie", "name": NAME, "description": "A browser."},
}
_REFUSED = {
    "401": "Nobody is signed in, and no token lets in.",
    "403": "The role or the token does not allow it.",
    "503": "The database does not answer.",
}
_SENTENCE = {"application/json": {"schema": {"$ref": "#/components/schemas/Refusal"}}}


def describe_access(app: FastAPI) -> None:
    """Make ``app.openapi`` say for each operation who may call it, and how a refusal looks."""
    plain = app.openapi

    def openapi() -> dict[str, Any]:
        known = app.openapi_schema is not None
        document = plain()
        if not known:
            _describe(document)
        return document

    app.openapi = openapi  # type: ignore[method-assign]  # FastAPI's own way to extend it


def _describe(document: dict[str, Any]) -> None:
    document.setdefault("components", {})["securitySchemes"] = _SCHEMES
    for path, methods in document["paths"].items():
        for method, said in methods.items():
            operation = PERMITS.get(f"{method.upper()} {path}", Operation.UNDECLARED)
            least = RIGHTS[operation].least
            if least is None:
                said["security"] = []
                continue
            said["security"] = [{"token": []}, {"session": []}]
            needed = f"Needs the role {least}; a token, the scope {SCOPE_OF[least]}."
            said["description"] = f"{said.get('description', '').rstrip()}\n\n{needed}".strip()
            for status, words in _REFUSED.items():
                said["responses"].setdefault(status, {"description": words, "content": _SENTENCE})
