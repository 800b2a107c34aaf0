"""Helpers for tests of the file connector."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from stemwatch.connectors.historian import HistorianFile, ReadOptions

Opener = Callable[..., HistorianFile]


@pytest.fixture
def open_text(tmp_path: Path) -> Opener:
    """Writes text or bytes to a file and opens it."""

    def opener(
        content: str | bytes, name: str = "loop.csv", options: ReadOptions | None = None
    ) -> HistorianFile:
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode("utf-8"))
        return HistorianFile(path, options or ReadOptions())

    return opener
