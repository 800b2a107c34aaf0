"""The store: results, samples, runs, alerts and users in SQLite or PostgreSQL.

``Store`` and ``open_store`` are imported when first used, so that reading a plant file, which
needs only ``DatabaseUrl``, does not load a database library.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from stemwatch.service.store.database_url import DatabaseUrl as DatabaseUrl
from stemwatch.service.store.errors import StoreError as StoreError

if TYPE_CHECKING:
    from stemwatch.service.store.store import Store as Store
    from stemwatch.service.store.store import open_store as open_store


def __getattr__(name: str) -> Any:
    if name in ("Store", "open_store"):
        return getattr(import_module("stemwatch.service.store.store"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
