"""``stemwatch serve`` as a process in a folder of its own, and what is asked of it."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from stemwatch.service.store.store import Store, open_store

# The service looks for what another process queued ten times as often as at a plant.
COMMAND = """
import typer
from stemwatch.service.cli.serve import run_now, serve
from stemwatch.service.run import queue_worker
queue_worker._LOOK_S = 0.5
app = typer.Typer()
app.command()(serve)
app.command()(run_now)
if __name__ == "__main__":
    app()
"""
TOKEN = "the-token-of-these-tests"
SERVICE = """
[limits]
min_duration_s = 5
[service]
workers = 1
valve_timeout_s = 60
window_s = 3600
[[notifiers]]
name = "log"
kind = "file"
path = "alerts.jsonl"
"""


class Site:
    """A folder with a plant file, and the commands run in it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        (folder / "command.py").write_text(COMMAND, encoding="utf-8")
        self._running: list[subprocess.Popen[str]] = []

    def start(
        self, *arguments: str, descriptors: int = 0, **environment: str
    ) -> subprocess.Popen[str]:
        """A command of the service in a process group of its own, with so many file descriptors
        at most."""
        limit = f"ulimit -n {descriptors};" if descriptors else ""
        command = [sys.executable, str(self.folder / "command.py"), *arguments]
        with (self.folder / "log.txt").open("a") as log:
            process = subprocess.Popen(
                ["sh", "-c", f'{limit} exec "$@"', "sh", *command],
                cwd=self.folder,
                env={**os.environ, "OMP_NUM_THREADS": "1", **environment},
                stdout=subprocess.PIPE,
                stderr=log,
                text=True,
                start_new_session=True,
            )
        self._running.append(process)
        return process

    def serve(self, descriptors: int = 0) -> tuple[subprocess.Popen[str], str]:
        """The service and the address of its pages."""
        process = self.start(
            "serve", "--port", "0", descriptors=descriptors, STEMWATCH_WEB_TOKEN=TOKEN
        )
        text = process.stdout.readline()
        match = re.search(r"http://\S+", text)
        assert match, text + self.log()
        return process, match[0]

    def store(self) -> Store:
        """The plant's store."""
        return open_store(f"sqlite:///{self.folder / 'stemwatch.db'}")

    def log(self) -> str:
        """What the processes have said so far."""
        return (self.folder / "log.txt").read_text(encoding="utf-8")

    def kill(self) -> None:
        """End whatever still runs."""
        for process in self._running:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            process.stdout.close()


@contextmanager
def site_in(folder: Path) -> Iterator[Site]:
    """A folder for the service; whatever still runs there afterwards is ended."""
    site = Site(folder)
    try:
        yield site
    finally:
        site.kill()


def get(address: str) -> tuple[int, str]:
    """Status and text of a page, asked for with the token of the environment."""
    request = urllib.request.Request(address, headers={"authorization": f"Bearer {TOKEN}"})
    with urllib.request.urlopen(request, timeout=20) as answer:
        return answer.status, answer.read().decode()


def until(there, seconds: float = 90.0, site: Site | None = None) -> None:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if there():
            return
        time.sleep(0.1)
    pytest.fail("it did not happen" + (f":\n{site.log()}" if site else ""))
