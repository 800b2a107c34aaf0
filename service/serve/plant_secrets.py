"""Masks the secrets that a plant file names in the logs of the service and the collector."""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import Any

from stemwatch.service.config import Plant
from stemwatch.service.logs import hide

_TOKEN = "STEMWATCH_WEB_TOKEN"


def hide_secrets(plant: Plant) -> None:
    """Mask in the logs what the plant file names as secret: the environment variable of each key
    that ends in ``_variable``, and the content of each ``secret_file``."""
    hide([os.environ.get(_TOKEN), *_named(plant)])


def _named(plant: Plant) -> Iterator[str | None]:
    tables: list[Any] = [
        *plant.notifiers.values(),
        *plant.sources.values(),
        *plant.archives.values(),
    ]
    for table in tables:
        for key, value in table.model_dump(exclude_none=True).items():
            if key.endswith("_variable"):
                yield os.environ.get(str(value))
            elif key == "secret_file":
                try:
                    yield plant.beside(value).read_text(encoding="utf-8").strip()
                except (OSError, UnicodeDecodeError):
                    continue  # reported where the secret is used
