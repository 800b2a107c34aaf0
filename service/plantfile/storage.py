"""Which store a plant writes to."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from stemwatch.service.store.database_url import Address

VARIABLE = "STEMWATCH_STORAGE_URL"
DEFAULT_NAME = "stemwatch.db"
_SQLITE_FILE = "sqlite:///"


def storage_address(url: str | None, plant_file: Path, variables: Mapping[str, str]) -> Address:
    """The environment's address, else the file's ``url``, else a database beside the file.

    A relative SQLite path is relative to the plant file, so that a command finds the same store
    from every folder.
    """
    chosen = variables.get(VARIABLE, "").strip() or url or f"{_SQLITE_FILE}{DEFAULT_NAME}"
    name = chosen.removeprefix(_SQLITE_FILE)
    if name in (chosen, "", ":memory:") or name.startswith("file:"):
        return Address(chosen)
    return Address(f"{_SQLITE_FILE}{plant_file.parent / name}")
