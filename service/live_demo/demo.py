"""``LiveDemo``: starts and stops all parts of the demo in order."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any, TypeVar

from stemwatch.service.live_demo.folder import DemoFolder
from stemwatch.service.live_demo.loops import WEARING, live_loops
from stemwatch.service.live_demo.mail_catcher import CaughtMail, MailCatcher
from stemwatch.service.live_demo.plant_file import demo_toml
from stemwatch.service.live_demo.recorded_maintenance import (
    RecordedMaintenance,
    repair_recorded_valves,
    wear_after_baseline,
)
from stemwatch.service.live_demo.service_process import ServiceProcess
from stemwatch.service.live_demo.timing import DemoTiming
from stemwatch.service.modbus_plant import PlantServer
from stemwatch.service.modbus_plant.live import LivePlant
from stemwatch.service.store.store import Store, open_store

T = TypeVar("T")


class LiveDemo:
    """The demo in the folder ``out`` with its pages on ``port`` (0 takes a free one).

    ``announce`` gets lines for the terminal, ``ready`` the address of the pages once they are
    served.
    """

    def __init__(
        self,
        out: Path,
        timing: DemoTiming,
        port: int,
        *,
        announce: Callable[[str], None],
        ready: Callable[[str], object] = lambda address: None,
        seed: int = 1,
    ) -> None:
        self._out, self._timing, self._port, self._seed = out, timing, port, seed
        self._say, self._ready = announce, ready

    async def run(self, stop: asyncio.Event) -> None:
        """Run until ``stop`` is set. Raises ``OSError`` where the folder or a port is taken, or
        where the service ends by itself."""
        folder = DemoFolder(self._out)
        try:
            # Opened before the plant is started: opening blocks, and the plant could not answer
            # meanwhile.
            with open_store(folder.database) as store:
                await self._run(folder, store, stop)
        finally:
            folder.release()

    async def _run(self, folder: DemoFolder, store: Store, stop: asyncio.Event) -> None:
        async with MailCatcher(folder.mails, on_mail=self._mail_came) as mails:
            self._say(f"Mails are kept in {mails.list_file}")
            loops = live_loops()
            # In a thread, since simulating the first minutes takes seconds.
            plant = await asyncio.to_thread(LivePlant, loops, seed=self._seed)
            async with PlantServer(plant, speed=self._timing.speed) as server:
                self._say(f"The simulated plant answers Modbus on 127.0.0.1:{server.port}")
                text = demo_toml(
                    loops,
                    self._timing,
                    modbus_port=server.port,
                    mail_port=mails.port,
                    pages_port=self._port,
                )
                folder.plant_file.write_text(text, encoding="utf-8", newline="\n")
                await self._watch(folder, store, server, stop)

    async def _watch(
        self, folder: DemoFolder, store: Store, server: PlantServer, stop: asyncio.Event
    ) -> None:
        """Run the service on the plant, wear its valve, and repair valves with recorded work."""
        async with ServiceProcess(folder.plant_file, self._port, folder.log, self._say) as service:
            address = await _first(service.address(), stop)
            if address is None:
                return
            for line in self._introduction(address):
                self._say(line)
            self._ready(address)

            maintenance = RecordedMaintenance(store, [loop.tag for loop in server.plant.loops])

            async def work() -> None:
                await asyncio.gather(
                    service.ended(),
                    wear_after_baseline(store, server, WEARING, self._timing.wear, self._wears),
                    repair_recorded_valves(maintenance, server, self._repaired),
                )

            await _first(work(), stop)

    def _wears(self, tag: str) -> None:
        alert_wait_min = self._timing.alert_after_s / self._timing.speed / 60.0
        self._say(
            f"{tag} was screened as new and begins to wear. Its alert and the mail come in about "
            f"{alert_wait_min:.0f} minutes."
        )

    def _repaired(self, tag: str) -> None:
        window = self._timing.window_s / 60.0
        self._say(
            f"{tag} has been repaired: its simulated valve is as new. The first run whose window "
            f"begins after the repair shows it, in {window:.1f} minutes or a little more."
        )

    def _mail_came(self, mail: CaughtMail) -> None:
        self._say(f"A mail arrived ({mail.file}): {mail.subject}")

    def _introduction(self, address: str) -> list[str]:
        return [
            f"1. All valves are screened every {self._timing.schedule_s:g} s. Once {WEARING} has a "
            "baseline it wears, until it sticks.",
            f"2. When the mail has come, acknowledge the alert: {address}alerts",
            f"3. Record maintenance: {address}valve?id={WEARING} - the valve is then repaired.",
            "4. Look there again: a note says, with both intervals, whether it helped.",
            "Ctrl-C ends the demo.",
        ]


async def _first(work: Coroutine[Any, Any, T], stop: asyncio.Event) -> T | None:
    """The result of ``work``, or ``None`` where ``stop`` was set before."""
    working, stopping = asyncio.create_task(work), asyncio.create_task(stop.wait())
    try:
        await asyncio.wait((working, stopping), return_when=asyncio.FIRST_COMPLETED)
        return working.result() if working.done() else None
    finally:
        for task in (working, stopping):
            task.cancel()
            await asyncio.wait((task,))
