"""What all tests share: the real recordings, and with ``STRICT=1`` no skipped real service."""

from __future__ import annotations

import os
from collections.abc import Generator
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[1]
STRICT = os.environ.get("STRICT", "") not in ("", "0")
MUST_RUN = ("browser", "postgres")


@pytest.fixture(scope="session")
def recordings() -> Path:
    """The folder of real recordings, which is not part of the repository."""
    beside = ROOT.parent / "shared" / "recordings"
    folder = Path(os.environ.get("STEMWATCH_RECORDINGS", beside))
    if not folder.is_dir():
        pytest.skip(
            f"REAL RECORDINGS NOT FOUND at {folder}: set STEMWATCH_RECORDINGS to their folder; "
            "nothing about real files was tested"
        )
    return folder


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item,
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """A skipped test of a browser or a database server counts as failed."""
    report = yield
    marked = any(item.get_closest_marker(name) for name in MUST_RUN)
    if STRICT and marked and report.skipped and not hasattr(report, "wasxfail"):
        _fail(report)
    return report


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report() -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    """A module that is skipped as a whole counts as failed: a package is missing."""
    report = yield
    if STRICT and report.skipped:
        _fail(report)
    return report


def _fail(report: Any) -> None:
    reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else report.longrepr
    report.outcome = "failed"
    report.longrepr = f"{reason}; with STRICT=1 this may not be skipped"
