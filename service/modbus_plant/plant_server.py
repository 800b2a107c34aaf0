"""``PlantServer``: the simulated plant behind a Modbus server; ``serve_plant`` for a command."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import Awaitable, Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stemwatch.models.studies.simulator import PlantLoop
from stemwatch.service.modbus_plant.live import LivePlant
from stemwatch.service.modbus_plant.plant_file import plant_toml
from stemwatch.service.modbus_plant.register_layout import STRIDE, words
from stemwatch.service.modbus_plant.wear import Wear
from stemwatch.service.process_lifecycle import on_stop_signal

if TYPE_CHECKING:
    from pymodbus.constants import ExcCodes

LOOPBACK = "127.0.0.1"
PLANT_FILE = "plant.toml"
UNIT_ID = 1


class PlantServer:
    """Serves ``plant`` as unit 1 of a Modbus TCP device, in holding and input registers alike.

    ``speed`` is how many plant seconds pass in a second: at 10 a valve wears ten times as fast, and
    a loop sampled every 0.1 s looks as it does at 1 s. Requests to write are refused. Use it with
    ``async with``; ``port`` 0 takes a free one, which ``port`` then tells.
    """

    unit_id = UNIT_ID

    def __init__(
        self,
        plant: LivePlant,
        host: str = LOOPBACK,
        port: int = 0,
        *,
        speed: float = 1.0,
        clock_s: Callable[[], float] = time.monotonic,
    ) -> None:
        if speed <= 0.0:
            raise ValueError(f"speed must be above 0, received {speed}")
        self.plant, self.host, self.port, self.speed = plant, host, port, speed
        # Plant seconds between two updates of the registers.
        self._tick_s = min(loop.archive.interval_s for loop in plant.loops)
        self._clock_s = clock_s
        self._began_s = clock_s()
        self._shown: int | None = None  # the tick whose values the registers hold
        self._server: Any = None  # a ModbusTcpServer, half of whose methods have no types

    @property
    def plant_s(self) -> float:
        """Plant time, in seconds since the start."""
        return (self._clock_s() - self._began_s) * self.speed

    def repair(self, tag: str, *, lasting: bool = False) -> None:
        """The valve of loop ``tag`` is as new from now on; ``lasting``: it wears no more."""
        self.plant.repair(tag, self.plant_s, lasting=lasting)

    def begin_wear(self, tag: str, wear: Wear) -> None:
        """The valve of loop ``tag``, as new until now, begins to wear."""
        self.plant.begin_wear(tag, wear, self.plant_s)

    async def __aenter__(self) -> PlantServer:
        from pymodbus.server import ModbusTcpServer
        from pymodbus.simulator import DataType, SimData, SimDevice

        size = STRIDE * len(self.plant.loops)
        memory = SimData(0, values=[0] * size, datatype=DataType.REGISTERS, readonly=True)
        device = SimDevice(id=UNIT_ID, simdata=[memory], action=self._answer)
        self._server = ModbusTcpServer(device, address=(self.host, self.port))
        self._began_s = self._clock_s()
        try:
            await self._server.serve_forever(background=True)
        except RuntimeError as error:
            raise OSError(
                f"the simulated plant cannot listen on {self.host}:{self.port}; expected an "
                "address of this computer and a port that is free and allowed (above 1023)"
            ) from error
        self.port = self._server.transport.sockets[0].getsockname()[1]
        return self

    async def __aexit__(self, *_: object) -> None:
        if self._server is not None:
            await self._server.shutdown()
        self.plant.close()

    async def _answer(
        self,
        function_code: int,
        start_address: int,
        address: int,
        count: int,
        current_registers: list[int],
        set_values: list[int] | list[bool] | None,
    ) -> ExcCodes | None:
        """Called for each request, before it is answered from ``current_registers``."""
        from pymodbus.constants import ExcCodes

        if set_values is not None:
            return ExcCodes.ILLEGAL_FUNCTION
        tick = int(self.plant_s / self._tick_s)
        if tick != self._shown:
            self._shown = tick
            new_words = words(self.plant.rows(tick * self._tick_s))
            current_registers[: len(new_words)] = new_words
        return None


def serve_plant(
    loops: Sequence[PlantLoop],
    folder: Path,
    host: str = LOOPBACK,
    port: int = 5020,
    *,
    speed: float = 1.0,
    every_s: float = 1.0,
    zone: str,
    wear: Mapping[str, Wear] | None = None,
    seed: int = 1,
    ready: Callable[[PlantServer, Path], None] = lambda server, file: None,
    beside_serving: Callable[[PlantServer], Awaitable[object]] | None = None,
) -> None:
    """Serve ``loops`` until interrupted, with ``plant.toml`` written into ``folder``.

    ``ready`` is called once with the server and the plant file when requests are answered, and
    ``beside_serving`` runs as long as the server does. Raises ``OSError`` where the address cannot
    be listened on.
    """

    async def run() -> None:
        plant = LivePlant(loops, wear=wear, seed=seed)
        stop, loop = asyncio.Event(), asyncio.get_running_loop()
        with on_stop_signal(lambda: loop.call_soon_threadsafe(stop.set)):
            async with PlantServer(plant, host, port, speed=speed) as server:
                begin(server)
                await _until(stop, None if beside_serving is None else beside_serving(server))

    def begin(server: PlantServer) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        text = plant_toml(loops, host=host, port=server.port, every_s=every_s, zone=zone)
        file = folder / PLANT_FILE
        file.write_text(text, encoding="utf-8", newline="\n")
        ready(server, file)

    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(run())


async def _until(stop: asyncio.Event, beside_serving: Awaitable[object] | None) -> None:
    """Wait for ``stop``, or for the end or failure of ``beside_serving``."""
    stopping = asyncio.ensure_future(stop.wait())
    working = stopping if beside_serving is None else asyncio.ensure_future(beside_serving)
    await asyncio.wait({stopping, working}, return_when=asyncio.FIRST_COMPLETED)
    if working.done():
        working.result()
    for pending in (stopping, working):
        pending.cancel()
    await asyncio.gather(stopping, working, return_exceptions=True)
