"""``ModbusConnector``: a device as a source of recordings, live and only live."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta

import numpy as np

from stemwatch.connectors.connector import (
    WHOLE,
    ConnectorError,
    TagInfo,
    TagMapping,
    UnknownTag,
    ValveTags,
    Window,
)
from stemwatch.connectors.modbus.device import Device
from stemwatch.connectors.modbus.poller import DevicePoller
from stemwatch.connectors.modbus.sample_batch import SampleBatch, joined
from stemwatch.models.recording import ClockFacts, Provenance, Quality, Recording, Role, Signal

LONGEST = timedelta(hours=4)
_MICRO = timedelta(microseconds=1)
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_NO_HISTORY = (
    "Modbus has no history: a register holds the present value and nothing else. Collect first, "
    "and read the valve from the store; or ask for a window that ends in the future, which is "
    "recorded while you wait"
)


class ModbusConnector:
    """Records a valve from a device while one waits; implements ``Connector``.

    ``tags`` lists the map without asking the device. ``read`` takes a window that ends up to four
    hours ahead, waits until its end and gives what was seen.
    """

    def __init__(self, device: Device) -> None:
        self.device = device

    def tags(self) -> Sequence[TagInfo]:
        """Every tag of the map with its unit, description and addresses; no roles are guessed."""
        return [
            TagInfo(
                tag=register.tag,
                unit=register.unit,
                description=register.description,
                remark=f"unit {register.unit_id}, {register.address} ({register.address.modicon})",
                facts={"own_interval_s": self.device.every_s},
            )
            for register in self.device.registers
        ]

    def read(self, valve: ValveTags, window: Window = WHOLE) -> Recording:
        """Record ``valve`` from now, or ``window.start``, until ``window.stop``.

        Raises ``UnknownTag`` for a tag that is not in the map and ``ConnectorError`` for a window
        in the past, without an end, or longer than four hours, and where the device gave nothing.
        """
        self._know(valve)
        now = datetime.now(UTC)
        start, stop = window.start or now, window.stop
        if stop is None or stop <= now or start < now - timedelta(seconds=self.device.every_s):
            raise ConnectorError(f"{self.device.name}: {_NO_HISTORY}")
        if stop - start > LONGEST:
            raise ConnectorError(
                f"{self.device.name}: a window of {stop - start} was asked for; expected up to "
                f"{LONGEST}. Collect into the store for longer ones"
            )
        batches = asyncio.run(self._record(start, stop))
        if not batches:
            raise ConnectorError(
                f"{self.device.name}: no instant of its schedule (every {self.device.every_s:g} s) "
                f"lies between {start} and {stop}"
            )
        return self._recording(valve, joined(batches))

    def _know(self, valve: ValveTags) -> None:
        known = set(self.device.tags)
        for mapping in valve.tags.values():
            if mapping.tag not in known:
                shown = ", ".join(sorted(known)[:8])
                raise UnknownTag(
                    f"{self.device.name}: the register map has no tag {mapping.tag!r}; it has "
                    f"{shown}{', ...' if len(known) > 8 else ''}"
                )

    async def _record(self, start: datetime, stop: datetime) -> list[SampleBatch]:
        batches: list[SampleBatch] = []
        await asyncio.sleep(max((start - datetime.now(UTC)).total_seconds(), 0.0))
        running = asyncio.create_task(DevicePoller(self.device, batches.append).run())
        done, _ = await asyncio.wait(
            [running], timeout=max((stop - datetime.now(UTC)).total_seconds(), 0.0)
        )
        if done:
            running.result()  # a poller never ends by itself, except by an error to be seen
        running.cancel()
        await asyncio.wait([running])
        first, last = (moment - _EPOCH for moment in (start, stop))
        return [batch for batch in batches if first <= int(batch.at_us[0]) * _MICRO < last]

    def _recording(self, valve: ValveTags, batch: SampleBatch) -> Recording:
        every_us = round(self.device.every_s * 1e6)
        first_us = int(batch.at_us.min())
        ticks = (batch.at_us - first_us) // every_us
        count = int(ticks.max()) + 1
        tags = np.array(batch.tags)
        signals = {}
        for role, mapping in valve.tags.items():
            values = np.full(count, np.nan)
            quality = np.full(count, Quality.MISSING, dtype=np.uint8)
            own = tags == mapping.tag
            values[ticks[own]] = batch.values[own]
            quality[ticks[own]] = batch.quality[own]
            unit = self._unit(mapping)
            if role is not Role.MODE and mapping.low is not None and mapping.high is not None:
                values = (values - mapping.low) / (mapping.high - mapping.low) * 100.0
                unit = "%"
            signals[role] = Signal(values=values, quality=quality, tag=mapping.tag, unit=unit)
        return Recording(
            valve=valve.valve,
            signals=signals,
            interval_s=self.device.every_s,
            start=_EPOCH + first_us * _MICRO,
            clock=ClockFacts(zone="the clock of this computer, in UTC"),
            provenance=Provenance(
                source=f"{self.device.name} at {self.device.link}",
                layout="Modbus registers",
                decisions=("each sample bears the instant of its poll",),
            ),
        )

    def _unit(self, mapping: TagMapping) -> str:
        known = {register.tag: register.unit for register in self.device.registers}
        return mapping.unit or known[mapping.tag] or "%"
