"""What is costly to set up, once for all processes of a test run."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

try:
    import fcntl
except ImportError:  # where files are locked otherwise, each process makes its own
    fcntl = None  # type: ignore[assignment]


def made_once(
    tmp_path_factory: pytest.TempPathFactory, name: str, make: Callable[[Path], None]
) -> Path:
    """The folder ``name`` with what ``make`` leaves in it: the first process of the run makes it,
    the others wait for that. Whoever uses it must leave it as it is."""
    base = tmp_path_factory.getbasetemp()
    of_many = "PYTEST_XDIST_WORKER" in os.environ and fcntl is not None
    shared = base.parent if of_many else base
    folder, finished = shared / name, shared / f"{name}.made"
    with (shared / f"{name}.lock").open("w") as lock:
        if of_many:
            fcntl.flock(lock, fcntl.LOCK_EX)
        if not finished.exists():
            folder.mkdir()
            make(folder)
            finished.touch()
    return folder
