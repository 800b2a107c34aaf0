"""``/api/docs``: the API described on a plain page, made from its own OpenAPI."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse

from stemwatch.service.web.desk import AtDesk

router = APIRouter(include_in_schema=False)


@router.get("/api/docs")
def docs(request: Request, desk: AtDesk) -> HTMLResponse:
    """Every operation with its parameters, and every shape with its fields."""
    document: dict[str, Any] = request.app.openapi()
    operations = [
        {"parameters": [], "summary": "", **operation, "path": path, "method": method.upper()}
        for path, methods in document["paths"].items()
        for method, operation in methods.items()
    ]
    return desk.frame.page(
        request,
        "api_docs.html",
        here="",
        open_alerts=desk.open_alerts(),
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
        return " or ".join(kind_of(one) for one in schema["anyOf"])
    if "enum" in schema:
        return " or ".join(str(one) for one in schema["enum"])
    if schema.get("type") == "array":
        return f"list of {kind_of(schema.get('items', {}))}"
    if schema.get("type") == "object" and isinstance(schema.get("additionalProperties"), dict):
        return f"object of {kind_of(schema['additionalProperties'])}"
    said = str(schema.get("type", "anything"))
    return f"{said} ({schema['format']})" if "format" in schema else said
