"""``toml_value``: a value as it stands in a plant file."""

from __future__ import annotations

import json


def toml_value(value: object) -> str:
    """A text, number, truth value or list as TOML, which is written as in JSON but for U+007F."""
    json_value = list(value) if isinstance(value, tuple) else value
    return json.dumps(json_value, ensure_ascii=False).replace("\x7f", "\\u007f")
