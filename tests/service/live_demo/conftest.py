"""The live demo as a process of its own."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.service.live_demo.running_demo import Started


@pytest.fixture
def started(tmp_path: Path) -> Iterator[Started]:
    """The live demo in a process group of its own."""
    result = Started(tmp_path / "demo")
    try:
        yield result
    finally:
        result.kill()
