"""``problems_of``: the errors of pydantic as ``Problem``s with file, line, key, what was found and
what was expected."""

from __future__ import annotations

import types
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from stemwatch.connectors.secret import masked
from stemwatch.connectors.settings import CONTRADICTION, KeyPath, Problem, either_of, nearest


class PlantFileError(Exception):
    """The plant file cannot be used. ``problems`` holds every mistake in it."""

    def __init__(self, problems: Sequence[Problem]) -> None:
        self.problems = tuple(problems)
        super().__init__("\n".join(str(problem) for problem in self.problems))

    def __reduce__(self) -> tuple[type[PlantFileError], tuple[tuple[Problem, ...]]]:
        return PlantFileError, (self.problems,)


@dataclass(frozen=True)
class TableLocation:
    """Where a table was read, for messages: its file, its name, and how its keys are shown."""

    file: str
    name: str  # "valves[FIC-101]", or empty for the top
    line_of: Callable[[KeyPath], int | None]  # of a path inside the table
    key_of: Callable[[KeyPath], str] | None = None  # of a CSV file: a column instead of a key

    def problem(self, path: KeyPath, found: str, expected: str) -> Problem:
        """The problem at ``path`` inside this table."""
        return Problem(
            file=self.file,
            line=self.line_of(path),
            key=self._key(path),
            found=found,
            expected=expected,
        )

    def _key(self, path: KeyPath) -> str:
        if self.key_of is not None:
            return self.key_of(path)
        text = self.name
        for part in path:
            text += f"[{part + 1}]" if isinstance(part, int) else f".{part}"
        return text.removeprefix(".")


def problems_of(
    error: ValidationError, model: type[BaseModel], location: TableLocation
) -> list[Problem]:
    """One problem for each mistake in ``error``, which validating ``model`` raised."""
    return [_problem(details, model, location) for details in error.errors(include_url=False)]


def described(value: Any) -> str:
    """A value as it stands in the file, with its type."""
    if value is None:
        return "nothing"
    if isinstance(value, Mapping):
        return "a table"
    if isinstance(value, list | tuple):
        return f"a list of {len(value)}"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return "an empty text" if not value else f"the text {_short(repr(masked(value)))}"
    return _short(str(value))


def _short(text: str) -> str:
    return text if len(text) <= 80 else f"{text[:77]}..."


def _problem(details: ErrorDetails, model: type[BaseModel], location: TableLocation) -> Problem:
    path: KeyPath = tuple(details["loc"])
    if details["type"] == "extra_forbidden":
        model_fields = _model_at(model, path[:-1]).model_fields
        hint = nearest(str(path[-1]), model_fields)
        if len(path) > 1 and path[-1] in model.model_fields:
            hint = f"; {path[-1]} belongs at the top of the file, before the first [table]"
        return location.problem(path, "an unknown key", either_of(model_fields) + hint)
    if details["type"] == CONTRADICTION:
        context = details["ctx"]
        return location.problem((*path, *context["key"]), context["found"], context["expected"])
    field = _field_at(model, path)
    found_text = described(None) if details["type"] == "missing" else described(details["input"])
    return location.problem(path, found_text, _expected(details, field))


def _expected(details: ErrorDetails, field: FieldInfo | None) -> str:
    if details["type"] == "value_error":
        return str(details["ctx"]["error"])
    if field is not None and field.description:
        return field.description
    return details["msg"]


def _field_at(model: type[BaseModel], path: KeyPath) -> FieldInfo | None:
    names = [part for part in path if isinstance(part, str)]
    field: FieldInfo | None = None
    for name in names:
        if name not in model.model_fields:
            return field
        field = model.model_fields[name]
        model = _model_in(field.annotation) or model
    return field


def _model_at(model: type[BaseModel], path: KeyPath) -> type[BaseModel]:
    field = _field_at(model, path)
    return model if field is None else _model_in(field.annotation) or model


def _model_in(annotation: Any) -> type[BaseModel] | None:
    """The model inside ``Model``, ``Model | None`` or ``Annotated[Model, ...]``."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    if get_origin(annotation) in (Union, types.UnionType, Annotated):
        inner = (_model_in(argument) for argument in get_args(annotation))
        return next((model for model in inner if model), None)
    return None
