"""Which register holds what, in the simulated device."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from stemwatch.models.recording import Floats, Role
from stemwatch.models.studies.simulator import PlantLoop
from stemwatch.models.studies.simulator.historian import SUFFIX

STRIDE = 10  # registers of one loop; the last one is spare
PLACE = {Role.OP: 0, Role.MV: 2, Role.PV: 4, Role.SP: 6, Role.MODE: 8}
MOST_LOOPS = 65_536 // STRIDE


def tag(loop: PlantLoop, role: Role) -> str:
    """The tag of one signal: ``FIC-101.OP``; ``ZT`` is the position transmitter."""
    return f"{loop.tag}.{SUFFIX[role]}"


def signals(loop: PlantLoop) -> tuple[Role, ...]:
    """The signals that the loop has."""
    return tuple(role for role in PLACE if role is not Role.MV or loop.transmitters.has_position)


@dataclass(frozen=True, kw_only=True)
class ServedRegister:
    """Where one signal is: its first holding register, counted from 0."""

    tag: str
    role: Role
    address: int
    kind: str  # FLOAT32 or UINT16
    unit: str


def registers(loops: Sequence[PlantLoop]) -> Iterator[ServedRegister]:
    """The registers of ``loops``, consecutive from 0 on."""
    for index, loop in enumerate(loops):
        for role in signals(loop):
            yield ServedRegister(
                tag=tag(loop, role),
                role=role,
                address=STRIDE * index + PLACE[role],
                kind="UINT16" if role is Role.MODE else "FLOAT32",
                unit=unit(loop, role),
            )


def unit(loop: PlantLoop, role: Role) -> str:
    """The unit that a signal is served in; none for the mode."""
    if role is Role.MODE:
        return ""
    return "%" if role in (Role.OP, Role.MV) else loop.pv_range.unit


def words(rows: Sequence[Floats]) -> list[int]:
    """The registers that hold ``rows``, one of five values for each loop.

    OP, MV, PV and SP are FLOAT32 with the most significant word first, NaN for no value; the mode
    is UINT16, 65535 for no value.
    """
    table = np.asarray(rows, dtype=np.float64)
    memory = np.zeros((len(table), STRIDE), dtype=">u2")
    memory[:, :8] = np.ascontiguousarray(table[:, :4], dtype=">f4").view(">u2")
    memory[:, 8] = np.where(np.isfinite(table[:, 4]), table[:, 4], 65_535).astype(np.uint16)
    word_list: list[int] = memory.ravel().tolist()
    return word_list
