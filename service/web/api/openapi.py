"""The API's own description, with what it asks of whoever calls it."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter, FastAPI, Request
from fastapi.responses import HTMLResponse

from stemwatch.service.access.permissions import PERMISSIONS, SCOPE_OF, Operation
from stemwatch.service.web.auth.route_permissions import ROUTE_OPERATIONS
from stemwatch.service.web.auth.session_cookie import NAME
from stemwatch.service.web.dependencies import Deps

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
    make_schema = app.openapi

    def openapi() -> dict[str, Any]:
        already_made = app.openapi_schema is not None
        document = make_schema()
        if not already_made:
            _describe(document)
        return document

    app.openapi = openapi  # type: ignore[method-assign]  # FastAPI's own way to extend it


def _describe(document: dict[str, Any]) -> None:
    document.setdefault("components", {})["securitySchemes"] = _SCHEMES
    for path, methods in document["paths"].items():
        for method, described in methods.items():
            operation = ROUTE_OPERATIONS.get(f"{method.upper()} {path}", Operation.UNDECLARED)
            least = PERMISSIONS[operation].least
            if least is None:
                described["security"] = []
                continue
            described["security"] = [{"token": []}, {"session": []}]
            needed = f"Needs the role {least}; a token, the scope {SCOPE_OF[least]}."
            described["description"] = (
                f"{described.get('description', '').rstrip()}\n\n{needed}".strip()
            )
            for status, words in _REFUSED.items():
                described["responses"].setdefault(
                    status, {"description": words, "content": _SENTENCE}
                )


router = APIRouter(include_in_schema=False)


@router.get("/api/docs")
def docs(request: Request, deps: Deps) -> HTMLResponse:
    """Every operation with its parameters, and every shape with its fields."""
    document: dict[str, Any] = request.app.openapi()
    operations = [
        {"parameters": [], "summary": "", **operation, "path": path, "method": method.upper()}
        for path, methods in document["paths"].items()
        for method, operation in methods.items()
    ]
    return deps.renderer.page(
        request,
        "api_docs.html",
        here="",
        open_alerts=deps.open_alerts(),
        about=document["info"],
        operations=operations,
        shapes=document.get("components", {}).get("schemas", {}),
        kind=kind_of,
    )


def kind_of(schema: dict[str, Any]) -> str:
    """A schema in a few words, such as ``list of ValveLine`` or ``number or null``."""
    if "$ref" in schema:
        return str(schema["$ref"]).rsplit("/", 1)[1]
    if "anyOf" in schema:
        return " or ".join(kind_of(kind) for kind in schema["anyOf"])
    if "enum" in schema:
        return " or ".join(str(value) for value in schema["enum"])
    if schema.get("type") == "array":
        return f"list of {kind_of(schema.get('items', {}))}"
    if schema.get("type") == "object" and isinstance(schema.get("additionalProperties"), dict):
        return f"object of {kind_of(schema['additionalProperties'])}"
    type_name = str(schema.get("type", "anything"))
    return f"{type_name} ({schema['format']})" if "format" in schema else type_name
