"""``DevicePoller``: one device, polled on its schedule until told to stop.

No fault of a device ends it: every instant yields a batch with a sample for each tag, good or with
the reason why not.
"""

from __future__ import annotations

import asyncio
import logging
import random
import time
from collections.abc import Callable
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from stemwatch.connectors.modbus.backoff import Backoff
from stemwatch.connectors.modbus.block_reader import BlockReader, Columns
from stemwatch.connectors.modbus.blocks import Block, BlockPlan
from stemwatch.connectors.modbus.connection import Connection
from stemwatch.connectors.modbus.device import Device
from stemwatch.connectors.modbus.device_state import DeviceState
from stemwatch.connectors.modbus.poll_schedule import PollSchedule, Slot
from stemwatch.connectors.modbus.read_fault import FaultKind, ReadFault, no_connection
from stemwatch.connectors.modbus.sample_batch import SampleBatch, one_instant
from stemwatch.models.recording import Quality

log = logging.getLogger(__name__)
LONGEST_WAIT_S = 15.0  # between attempts to reach a device or unit that does not answer
_FIRST_UNIT_WAIT_S = 0.5
_SPLITS_PER_POLL = 64  # more requests that one poll may send to find the refused registers
_MARKED_MISSES = 100  # instants missed in a row that are marked; after these there are no samples
NOT_POLLED = "not polled: the poll before it took too long"
Deliver = Callable[[SampleBatch], None]


@dataclass
class _Unit:
    """A unit that did not answer, and until when it is not asked again."""

    backoff: Backoff
    until_s: float = 0.0
    fault: ReadFault | None = None


@dataclass
class _Poll:
    """The results of one poll so far."""

    columns: Columns
    splits_left: int = _SPLITS_PER_POLL
    fault: str = ""

    def mark(self, reader: BlockReader, fault: ReadFault, *, fault_is_known: bool = False) -> None:
        """Mark a block without words; ``fault_is_known`` where the fault is not of this poll."""
        self.fault = self.fault or ("" if fault_is_known else fault.reason)
        missing = fault.kind in (FaultKind.NO_CONNECTION, FaultKind.SILENT, FaultKind.NOT_ASKED)
        quality = Quality.MISSING if missing else Quality.BAD
        self.columns.mark(reader.places, quality, fault.reason)


class DevicePoller:
    """Polls ``device`` and hands each poll's samples to ``deliver``, in the order of time.

    ``deliver`` is called on the event loop and must return at once. A sample bears the instant of
    its slot; a poll that cannot begin within a quarter of a second (or half an interval) of it is
    not made, and the slot's samples are marked.
    """

    def __init__(
        self,
        device: Device,
        deliver: Deliver,
        *,
        schedule: PollSchedule | None = None,
        rng: random.Random | None = None,
    ) -> None:
        self.device = device
        self.state = DeviceState(device.name, str(device.link))
        self._deliver = deliver
        self._schedule = schedule or PollSchedule(device.every_s)
        self._rng = rng or random.Random()
        self._line = Connection(device.link)
        self._block_plan = BlockPlan(device.blocks())
        self._tags = device.tags
        self._place_of = {tag: index for index, tag in enumerate(self._tags)}
        self._readers: WeakKeyDictionary[Block, BlockReader] = WeakKeyDictionary()
        self._units: dict[int, _Unit] = {}
        self._backoff = Backoff(0.2, LONGEST_WAIT_S, self._rng)
        self._opening: asyncio.Task[None] | None = None
        self._why: ReadFault | None = None

    async def run(self) -> None:
        """Poll until cancelled."""
        try:
            await self.start()
            while True:
                slot = await self._schedule.next()
                self._deliver_missed(slot)
                self._deliver(await self._poll_without_raising(slot.at_us))
                _stop_if_cancelled()
        finally:
            await self.stop()

    async def start(self) -> None:
        """Connect. The first poll waits for its connection; every later one keeps its instant."""
        await asyncio.wait([self._reconnect()], timeout=self.device.link.timeout_s)

    async def stop(self) -> None:
        """Close the connection and stop trying to connect."""
        if self._opening is not None:
            self._opening.cancel()
        self._line.close()

    async def poll(self, at_us: int) -> SampleBatch:
        """One poll, whose samples bear the time ``at_us`` (microseconds since 1970)."""
        poll = _Poll(Columns(len(self._tags)))
        for block in self._block_plan.blocks():
            await self._read(block, poll)
        if not self._line.connected:
            self._reconnect()
        columns = poll.columns
        batch = one_instant(
            self.device.name, self._tags, at_us, columns.values, columns.quality, columns.reasons
        )
        self._note(at_us, batch, poll.fault)
        return batch

    async def _poll_without_raising(self, at_us: int) -> SampleBatch:
        """A poll that never raises: an unforeseen error affects only this poll's samples."""
        began_us = self._schedule.now_us()
        try:
            batch = await self.poll(at_us)
        except Exception as error:
            log_fields = {"device": self.device.name}
            text = "device %s: a poll failed in an unforeseen way"
            log.exception(text, self.device.name, extra=log_fields)
            self._line.close()
            self._reconnect()
            batch = self._all_bad(at_us, f"unforeseen: {type(error).__name__}", Quality.BAD)
            self._note(at_us, batch, f"{type(error).__name__}: {error}")
        ended_us = self._schedule.now_us()
        self.state.late_s.append((ended_us - at_us) / 1e6)
        self.state.took_s.append((ended_us - began_us) / 1e6)
        return batch

    async def _read(self, block: Block, poll: _Poll, *, piece: bool = False) -> None:
        """Ask for ``block``; ``piece`` where it is divided for this poll only."""
        reader = self._reader(block)
        if fault := self._not_asked_because(block):
            poll.mark(reader, fault)
            return
        if fault := self._block_plan.resting(block):
            poll.mark(reader, fault, fault_is_known=True)
            return
        pieces = block.avoiding(self._line.lengths_to_avoid(block.unit_id, block.table))
        if len(pieces) > 1:
            for each in pieces:
                await self._read(each, poll, piece=True)
            return
        try:
            words = await self._line.read(block.unit_id, block.table, block.first, block.count)
        except ReadFault as fault:
            await self._after(fault, block, poll, piece=piece)
            return
        self._units.pop(block.unit_id, None)
        self._backoff.succeeded()
        reader.read(words, poll.columns)

    def _reader(self, block: Block) -> BlockReader:
        reader = self._readers.get(block)
        if reader is None:
            reader = self._readers[block] = BlockReader(block, self._place_of)
        return reader

    async def _after(
        self, fault: ReadFault, block: Block, poll: _Poll, *, piece: bool = False
    ) -> None:
        if fault.splits and poll.splits_left > 0 and not piece:
            poll.splits_left -= 1
            if halves := self._block_plan.split(block):
                for half in halves:
                    await self._read(half, poll)
                return
            self._block_plan.rest(block, fault)
            log_fields = {"device": self.device.name}
            log.warning(
                "device %s: %s: %s", self.device.name, block, fault.reason, extra=log_fields
            )
        elif fault.unit_is_silent:
            self._pause_unit(block.unit_id, fault)
        if not await self._line.reopen():
            self._why = fault
        poll.mark(self._reader(block), fault)

    def _not_asked_because(self, block: Block) -> ReadFault | None:
        if not self._line.connected:
            return self._why or no_connection("")
        unit = self._units.get(block.unit_id)
        if unit is not None and time.monotonic() < unit.until_s:
            return unit.fault
        return None

    def _pause_unit(self, unit_id: int, fault: ReadFault) -> None:
        unit = self._units.get(unit_id)
        if unit is None:
            unit = _Unit(Backoff(_FIRST_UNIT_WAIT_S, LONGEST_WAIT_S, self._rng))
            self._units[unit_id] = unit
        unit.fault = fault
        unit.until_s = time.monotonic() + unit.backoff.failed()

    def _reconnect(self) -> asyncio.Task[None]:
        """Try to connect in the background until it succeeds."""
        if self._opening is None or self._opening.done():
            self._opening = asyncio.create_task(self._keep_opening())
        return self._opening

    async def _keep_opening(self) -> None:
        if self.state.polls:  # wait first: some devices accept connections and drop them at once
            await asyncio.sleep(self._backoff.failed())
        while not self._line.connected:
            try:
                await self._line.open()
                _stop_if_cancelled()
            except asyncio.CancelledError:
                self._line.close()
                raise
            except ReadFault as fault:
                self._why = fault
            except Exception as error:
                self._why = no_connection(f"{type(error).__name__}: {error}")
            else:
                self._why = None
                self.state.reconnects += 1
                self._units.clear()
                return
            await asyncio.sleep(self._backoff.failed())

    def _deliver_missed(self, slot: Slot) -> None:
        """Deliver marked samples for the instants missed before ``slot``."""
        if slot.clock_went_back:
            log.warning(
                "device %s: the computer's clock was set back; samples whose time comes a second "
                "time are bad, since either clock may have been the wrong one",
                self.device.name,
                extra={"device": self.device.name},
            )
        self.state.missed += len(slot.missed_us)
        for at_us in slot.missed_us[:_MARKED_MISSES]:
            batch = self._all_bad(at_us, NOT_POLLED, Quality.MISSING)
            self.state.bad += len(batch)
            self._deliver(batch)

    def _note(self, at_us: int, batch: SampleBatch, fault: str) -> None:
        state = self.state
        if batch.good:
            state.last_good_us = at_us
        if bool(fault) != bool(state.fault):
            level = logging.WARNING if fault else logging.INFO
            log.log(level, "device %s: %s", self.device.name, fault or "reads again")
        state.connected, state.fault = self._line.connected, fault
        state.polls += 1
        state.good += batch.good
        state.bad += len(batch) - batch.good
        state.refused = self._block_plan.refused

    def _all_bad(self, at_us: int, reason: str, quality: Quality) -> SampleBatch:
        count = len(self._tags)
        values, qualities = np.full(count, np.nan), np.full(count, quality)
        return one_instant(self.device.name, self._tags, at_us, values, qualities, [reason] * count)


def _stop_if_cancelled() -> None:
    """Raise a cancellation that came at the same moment as an answer.

    Until Python 3.12 ``asyncio.wait_for``, through which every answer comes, then returns the
    answer and forgets the cancellation; the task still counts it.
    """
    task = asyncio.current_task()
    if task is not None and task.cancelling():
        raise asyncio.CancelledError
