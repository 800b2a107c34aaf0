"""``Tape``: one loop's signals, simulated some way ahead of the time they are served at."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stemwatch.models.plant import PlantLoop, simulate_loop
from stemwatch.models.recording import Floats, Role
from stemwatch.service.modbus_plant.wear import Wear, worn

ROLES = (Role.OP, Role.MV, Role.PV, Role.SP, Role.MODE)


@dataclass(frozen=True)
class Stretch:
    """Rows (n, 5) of OP, MV, PV, SP and mode from ``start_s`` of plant time on; NaN is no value."""

    start_s: float
    interval_s: float
    rows: Floats

    @property
    def stop_s(self) -> float:
        """The plant time just behind the last row."""
        return self.start_s + len(self.rows) * self.interval_s


def simulate_stretch(
    loop: PlantLoop, wear: Wear | None, start_s: float, worn_s: float, length_s: float, seed: int
) -> Stretch:
    """``length_s`` seconds of ``loop`` from plant time ``start_s``, its valve ``worn_s`` worn at
    first and wearing on.

    Chance differs from stretch to stretch, the set-point moves of the loop come again in each. PV
    and SP are in the loop's engineering units, OP and MV in percent.
    """
    now = replace(worn(loop, wear, worn_s, length_s), duration_s=length_s)
    place = round(start_s / loop.archive.interval_s)
    recording = simulate_loop(now, seed + 7919 * place).recording
    columns = []
    for role in ROLES:
        signal = recording.get(role)
        values = np.full(len(recording), np.nan) if signal is None else signal.values
        if role in (Role.PV, Role.SP):
            scale = loop.pv_range
            values = scale.low + values / 100.0 * (scale.high - scale.low)
        columns.append(values)
    return Stretch(start_s, recording.interval_s, np.column_stack(columns))


class Tape:
    """Stretches of one loop, one behind the other."""

    def __init__(self, first: Stretch) -> None:
        self._stretches = [first]
        self._none = np.full(len(ROLES), np.nan)

    @property
    def stop_s(self) -> float:
        """Up to where it is simulated."""
        return self._stretches[-1].stop_s

    def append(self, stretch: Stretch) -> None:
        """Go on with ``stretch`` from its start; what was simulated beyond that is forgotten."""
        kept = [one for one in self._stretches if one.start_s < stretch.start_s]
        self._stretches = [*kept, stretch]

    def row(self, plant_s: float) -> Floats:
        """The five values at ``plant_s``, which must not go back; NaN where nothing is
        simulated."""
        while len(self._stretches) > 1 and self._stretches[1].start_s <= plant_s:
            self._stretches.pop(0)
        stretch = self._stretches[0]
        place = int((plant_s - stretch.start_s) / stretch.interval_s + 1e-9)
        return stretch.rows[place] if 0 <= place < len(stretch.rows) else self._none
