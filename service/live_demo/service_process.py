"""``ServiceProcess``: ``stemwatch serve`` as a process of its own."""

from __future__ import annotations

import asyncio
import contextlib
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

_ADDRESS = re.compile(r"^Serving (http://\S+)")
_END_S = 60.0
# Ctrl-C in a terminal is for the demo, which then ends the service in order.
_OWN_GROUP: dict[str, Any] = {}
if sys.platform == "win32":
    _OWN_GROUP["creationflags"] = subprocess.CREATE_NEW_PROCESS_GROUP
else:
    _OWN_GROUP["process_group"] = 0


class ServiceEnded(OSError):
    """The service ended without being asked to."""


class ServiceProcess:
    """The service for ``plant_file`` on loopback with its log in the file ``log``; use it with
    ``async with``. ``announce`` gets each line that it prints: its address, and how to sign in
    first."""

    def __init__(
        self, plant_file: Path, port: int, log: Path, announce: Callable[[str], None]
    ) -> None:
        self._file, self._port, self._log, self._say = plant_file, port, log, announce
        self._process: asyncio.subprocess.Process | None = None
        self._reading: asyncio.Task[None] | None = None
        self._address: asyncio.Future[str] | None = None

    async def __aenter__(self) -> ServiceProcess:
        command = ["-m", "stemwatch.service", "serve", "--plant", str(self._file)]
        with self._log.open("ab") as log:
            self._process = await asyncio.create_subprocess_exec(
                sys.executable,
                *command,
                "--port",
                str(self._port),
                cwd=self._file.parent,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=log,
                **_OWN_GROUP,
            )
        self._address = asyncio.get_running_loop().create_future()
        self._reading = asyncio.create_task(self._pass_on())
        return self

    async def __aexit__(self, *_: object) -> None:
        process = self._process
        if process is None:
            return
        if process.returncode is None:
            with contextlib.suppress(ProcessLookupError):
                process.terminate()
        try:
            await asyncio.wait_for(process.wait(), _END_S)
        except TimeoutError:
            process.kill()
            await process.wait()
        if self._reading is not None:
            await self._reading

    async def address(self) -> str:
        """The address of the pages, once they are served. Raises ``ServiceEnded``."""
        assert self._address is not None
        return await asyncio.shield(self._address)

    async def ended(self) -> None:
        """Waits until the service ends by itself, and raises ``ServiceEnded``."""
        assert self._process is not None
        raise self._sentence(await self._process.wait())

    async def _pass_on(self) -> None:
        assert self._process is not None
        assert self._process.stdout is not None
        assert self._address is not None
        async for line in self._process.stdout:
            log_line = line.decode("utf-8", "replace").rstrip()
            self._say(log_line)
            if (match := _ADDRESS.match(log_line)) and not self._address.done():
                self._address.set_result(match[1])
        if not self._address.done():
            self._address.set_exception(self._sentence(await self._process.wait()))
            self._address.exception()  # marks it as seen, in case nobody awaits the address

    def _sentence(self, status: int) -> ServiceEnded:
        return ServiceEnded(f"the service ended with status {status}; its log is {self._log}")
