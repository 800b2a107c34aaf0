"""``Started``: a command that runs until Ctrl-C as a process, and what it says."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from pathlib import Path

import pytest

# Not at its fastest, 4: a machine that is busy with other tests then polls the plant so unevenly
# that a healthy valve is far from its baseline.
DEMO = ("demo", "--live", "--port", "0", "--speed", "2.5")


def _ignore_ctrl_c() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)


class Started:
    """``command`` with ``folder`` to write into; what it prints is read as it comes.

    ``in_background`` as a shell script starts it with ``&``, which ignores Ctrl-C.
    """

    def __init__(
        self, folder: Path, command: Sequence[str] = DEMO, *, in_background: bool = False
    ) -> None:
        self.folder = folder
        self.lines: list[str] = []
        self.process = subprocess.Popen(
            [sys.executable, "-m", "stemwatch.service", *command, "--out", str(folder)],
            env={**os.environ, "OMP_NUM_THREADS": "1", "PYTHONUNBUFFERED": "1"},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
            preexec_fn=_ignore_ctrl_c if in_background else None,
        )
        self._reading = threading.Thread(target=self._read)
        self._reading.start()

    def said(self, pattern: str, seconds: float = 180.0) -> re.Match[str]:
        """What it says by ``pattern``, as soon as it has said it."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            for line in self.lines.copy():
                if result := re.search(pattern, line):
                    return result
            if self.process.poll() is not None:
                break
            time.sleep(0.1)
        return pytest.fail(f"it did not say {pattern!r}:\n{self.everything()}")

    def everything(self) -> str:
        """All that it has said, and the end of the service's log."""
        log = self.folder / "service.log"
        more = log.read_text(encoding="utf-8") if log.exists() else ""
        return "\n".join([*self.lines, more[-5000:]])

    def stop(self) -> int:
        """Ctrl-C, as a terminal sends it; the exit status."""
        os.killpg(self.process.pid, signal.SIGINT)
        status = self.process.wait(timeout=120)
        self._reading.join()
        return status

    def terminate(self) -> int:
        """SIGTERM, as ``kill`` or a service manager sends it; the exit status."""
        self.process.terminate()
        status = self.process.wait(timeout=60)
        self._reading.join()
        return status

    def kill(self) -> None:
        """End whatever still runs; what it started ends with it."""
        if self.process.poll() is None:
            self.process.terminate()
            try:
                self.process.wait(timeout=90)
            except subprocess.TimeoutExpired:
                self.process.kill()
        self.process.wait()
        self._reading.join(timeout=20)

    def _read(self) -> None:
        assert self.process.stdout is not None
        with self.process.stdout as text:
            for line in text:
                self.lines.append(line.rstrip())
