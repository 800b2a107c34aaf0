"""``Collector``: every device polled, every sample on disk at once, all of them to the store."""

from __future__ import annotations

import asyncio
import logging
import threading
from collections import deque
from collections.abc import Iterable
from queue import SimpleQueue

from stemwatch.connectors.modbus import Device, DevicePoller, SampleBatch
from stemwatch.connectors.modbus.device_state import DeviceState
from stemwatch.service.collector.forwarder import Forwarder, ForwarderState
from stemwatch.service.collector.sample_sink import SampleSink
from stemwatch.service.collector.spool import Spool

log = logging.getLogger(__name__)

GATHER_S = 0.5  # how long samples gather before the store gets them
_IN_MEMORY = 2000  # batches that wait in memory while the disk takes nothing


class Collector:
    """Polls ``devices`` and brings their samples to ``sink`` by way of ``spool``.

    Three activities that do not wait for one another: an event loop polls, a thread appends to the
    spool what was polled, and a thread hands over to the store what was appended. One device that
    hangs, a store that is away and a slow disk therefore cost no other device a poll.
    """

    def __init__(
        self,
        devices: Iterable[Device],
        sink: SampleSink,
        spool: Spool,
        *,
        gather_s: float = GATHER_S,
    ) -> None:
        self.dropped = 0  # samples that neither disk nor memory had room for
        self._spool = spool
        self._queue: SimpleQueue[SampleBatch | None] = SimpleQueue()
        self._pollers = [DevicePoller(device, self._queue.put) for device in devices]
        self._forwarder = Forwarder(spool, sink)
        self._gather_s = gather_s
        self._more, self._stop = threading.Event(), threading.Event()

    @property
    def states(self) -> list[DeviceState]:
        """How each device is doing, in the order they were given."""
        return [poller.state for poller in self._pollers]

    @property
    def store(self) -> ForwarderState:
        """How the store is doing."""
        return self._forwarder.state

    async def run(self) -> None:
        """Collect until cancelled; what was polled by then is on disk when this returns."""
        self._more.set()  # what an earlier process left behind
        writing = threading.Thread(target=self._keep, name="spool")
        draining = threading.Thread(
            target=self._forwarder.run,
            args=(self._more, self._stop, self._gather_s),
            name="forwarder",
        )
        for thread in (writing, draining):
            thread.start()
        polling = [asyncio.create_task(poller.run()) for poller in self._pollers]
        for_ever = asyncio.Event()  # without devices there is still a spool to hand over
        try:
            await asyncio.gather(*polling, for_ever.wait())
        finally:
            for task in polling:
                task.cancel()
            try:
                await asyncio.gather(*polling, return_exceptions=True)
                self._queue.put(None)
                await asyncio.to_thread(writing.join)
            finally:  # also where somebody is in a hurry: no thread may outlive this
                self._queue.put(None)
                self._stop.set()
                await asyncio.to_thread(draining.join)

    def _keep(self) -> None:
        """Append to the spool whatever is polled; hold it in memory while the disk is full."""
        held: deque[SampleBatch] = deque()
        while True:
            batch = self._queue.get()
            if batch is not None:
                held.append(batch)
            while held and self._appended(held[0]):
                held.popleft()
            while len(held) > _IN_MEMORY:
                self._drop(held.popleft())
            if batch is None:
                for lost in held:
                    self._drop(lost)
                return

    def _appended(self, batch: SampleBatch) -> bool:
        try:
            self._spool.append(batch)
        except OSError as error:
            log.error("the spool cannot be written: %s; samples wait in memory", error)
            return False
        except Exception:  # a mistake of ours may cost this batch, never those behind it
            about = {"device": batch.source}
            log.exception("a batch of %s cannot be kept", batch.source, extra=about)
            self._drop(batch)
            return True
        self._more.set()
        return True

    def _drop(self, batch: SampleBatch) -> None:
        self.dropped += len(batch)
        log.error(
            "NO ROOM: %d samples of %s were dropped, %d in all; free space where the spool is",
            len(batch),
            batch.source,
            self.dropped,
            extra={"device": batch.source},
        )


def collect(collector: Collector, stop: threading.Event) -> None:
    """Run ``collector`` on an event loop of its own until ``stop`` is set.

    For a thread or a process that does nothing else, so that pages and fits cost no poll its time.
    """

    async def until_stopped() -> None:
        running = asyncio.create_task(collector.run())
        waiting = asyncio.create_task(asyncio.to_thread(stop.wait))
        await asyncio.wait([running, waiting], return_when=asyncio.FIRST_COMPLETED)
        stop.set()
        running.cancel()
        await asyncio.wait([running, waiting])
        if not running.cancelled():
            running.result()

    asyncio.run(until_stopped())
