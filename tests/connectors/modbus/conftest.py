"""A serial line without hardware."""

from __future__ import annotations

import os
import shutil
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest


@pytest.fixture
def serial_pair(tmp_path: Path) -> Iterator[tuple[str, str]]:
    """Two serial ports joined by a wire, without hardware."""
    if shutil.which("socat") is None:
        reason = "SERIAL LINES ARE NOT TESTED: no socat on this computer"
        if os.environ.get("STRICT", "") not in ("", "0"):
            pytest.fail(f"{reason}; with STRICT=1 this may not be skipped")
        pytest.skip(reason)
    ends = [tmp_path / "here", tmp_path / "there"]
    links = [f"pty,raw,echo=0,link={end}" for end in ends]
    process = subprocess.Popen(["socat", *links], stderr=subprocess.DEVNULL)
    try:
        for _ in range(200):
            if all(end.exists() for end in ends):
                break
            time.sleep(0.02)
        yield str(ends[0]), str(ends[1])
    finally:
        process.terminate()
        process.wait(timeout=10)
