"""The JSON of ``stemwatch explain``, version 1, described by ``explain.schema.json``."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

from stemwatch.service.explain.explain_recording import Explained
from stemwatch.service.presenter.false_discoveries import discoveries
from stemwatch.service.presenter.wording import printable
from stemwatch.service.report.json_contract import by_window_object, mismatch_object

VERSION = 1


def to_object(explained: Explained, *, stands: bool | None = None) -> dict[str, Any]:
    """One explanation as plain JSON types; its fields stand in docs/json.md.

    ``stands`` says whether its effects stand among all that were explained together.
    """
    return {
        "version": VERSION,
        "recording": printable(explained.source),
        "valve": printable(explained.valve),
        **mismatch_object(explained.mismatch, stands=stands),
        "by_window": None if explained.by_window is None else by_window_object(explained.by_window),
    }


def to_json(valves: Sequence[Explained]) -> str:
    """All of them as a list, in the order in which they were asked for."""
    stands_of_each = discoveries([explained.mismatch for explained in valves]).standing
    objects = [
        to_object(explained, stands=stands_of_valve)
        for explained, stands_of_valve in zip(valves, stands_of_each, strict=True)
    ]
    return json.dumps(objects, allow_nan=False, ensure_ascii=False, indent=1) + "\n"
