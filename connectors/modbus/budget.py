"""How long one poll occupies a serial line, from the map alone."""

from __future__ import annotations

from collections.abc import Iterable

from stemwatch.connectors.modbus.blocks import Block
from stemwatch.connectors.modbus.device import Link

REQUEST_BYTES = 8  # unit, function, address, count, checksum
REPLY_BYTES = 5  # unit, function, byte count, checksum
TURNAROUND_S = 0.005  # a quick device; many take ten times as long, so this is a lower limit
FAST_BAUDRATE = 19_200  # above it the silence between frames is 1.75 ms, not 3.5 characters
FAST_SILENCE_S = 0.00175


def poll_time_s(blocks: Iterable[Block], link: Link) -> float:
    """Seconds that reading all ``blocks`` takes at least on the serial line of ``link``.

    Each request: ``8 + 5 + 2 words`` characters of start, data, parity and stop bits, two silences
    of 3.5 characters (1.75 ms above 19200 baud; Modbus over Serial Line 1.02, section 2.5.1.1),
    the device's own time of 5 ms, and the pause that the map asks for.
    """
    bits = 1 + link.bytesize + (link.parity != "N") + link.stopbits
    character_s = bits / link.baudrate
    silence_s = FAST_SILENCE_S if link.baudrate > FAST_BAUDRATE else 3.5 * character_s
    total_s = 0.0
    for block in blocks:
        characters = REQUEST_BYTES + REPLY_BYTES + 2 * block.count
        total_s += characters * character_s + 2 * silence_s + TURNAROUND_S + link.pause_s
    return total_s
