"""``SimulatedAhead``: one loop's signals, simulated some way ahead of when they are served."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from stemwatch.models.recording import Floats, Role
from stemwatch.models.studies.simulator import PlantLoop, simulate_loop
from stemwatch.service.modbus_plant.wear import Wear, worn

ROLES = (Role.OP, Role.MV, Role.PV, Role.SP, Role.MODE)
ALIKE = 5  # rows by which a stretch is matched to the one before it
_SEARCHED_S = 600.0  # of simulation, searched for a state like the end of the last stretch


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
    loop: PlantLoop,
    wear: Wear | None,
    start_s: float,
    worn_s: float,
    length_s: float,
    seed: int,
    before: Floats | None = None,
) -> Stretch:
    """``length_s`` seconds of ``loop`` from plant time ``start_s``, whose valve has worn for
    ``worn_s`` seconds before and goes on wearing.

    Random disturbances differ from stretch to stretch; the set-point moves of the loop are
    repeated. PV and SP are in the loop's engineering units, OP and MV in percent.

    With ``before``, the last ``ALIKE`` rows or more that were served, the stretch continues from a
    similar state. While friction grows, no later place can be chosen, and the stretch begins in
    balance.
    """
    now = worn(loop, wear, worn_s, length_s)
    joined = before is not None and len(before) >= ALIKE and now.upsets.growth == 0.0
    searched_s = _SEARCHED_S if joined else 0.0
    rows, interval_s = _simulated(replace(now, duration_s=searched_s + length_s), start_s, seed)
    if before is not None and joined:
        searched = round(searched_s / interval_s)
        first = _going_on(rows[:searched], before[-ALIKE:])
        rows = rows[first : first + len(rows) - searched]
    return Stretch(start_s, interval_s, rows)


def _simulated(loop: PlantLoop, start_s: float, seed: int) -> tuple[Floats, float]:
    """Rows (n, 5) of ``loop``, with random numbers seeded by ``start_s``, and their interval in
    s."""
    row = round(start_s / loop.archive.interval_s)
    recording = simulate_loop(loop, seed + 7919 * row).recording
    columns = []
    for role in ROLES:
        signal = recording.get(role)
        values = np.full(len(recording), np.nan) if signal is None else signal.values
        if role in (Role.PV, Role.SP):
            scale = loop.pv_range
            values = scale.low + values / 100.0 * (scale.high - scale.low)
        columns.append(values)
    return np.column_stack(columns), recording.interval_s


def _going_on(rows: Floats, before: Floats) -> int:
    """The place in ``rows`` (n, 5), behind as many of them as ``before`` has, whose rows before it
    are most like ``before``.

    These rows determine the loop's state: OP, PV and SP the controller's integral, MV the stem, PV
    the process, and their recent course the delays between them. Each signal is scaled by its
    standard deviation; signals without a value in ``before`` do not count.
    """
    past = sliding_window_view(rows, len(before), axis=0)  # (n - ALIKE + 1, 5, ALIKE)
    finite = np.isfinite(before).T
    spread = np.array([_spread(column) for column in rows.T])
    deviation = np.where(finite, (past - before.T) / spread[:, np.newaxis], 0.0)
    distance = np.sum(deviation**2, axis=(1, 2))
    return int(np.argmin(np.where(np.isnan(distance), np.inf, distance))) + len(before)


def _spread(values: Floats) -> float:
    """Standard deviation of what is there; 1 where nothing is, or nothing moves."""
    finite = values[np.isfinite(values)]
    return float(np.std(finite)) or 1.0 if finite.size else 1.0


class SimulatedAhead:
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
        earlier_stretches = [
            earlier for earlier in self._stretches if earlier.start_s < stretch.start_s
        ]
        self._stretches = [*earlier_stretches, stretch]

    def before(self, plant_s: float) -> Floats:
        """The last ``ALIKE`` rows (n, 5) before ``plant_s``; fewer where fewer are simulated, none
        where the last one was earlier."""
        for stretch in reversed(self._stretches):
            if stretch.start_s < plant_s:
                behind = math.ceil((plant_s - stretch.start_s) / stretch.interval_s - 1e-9)
                has_row = behind <= len(stretch.rows)
                return (
                    stretch.rows[max(behind - ALIKE, 0) : behind] if has_row else stretch.rows[:0]
                )
        return self._stretches[0].rows[:0]

    def row(self, plant_s: float) -> Floats:
        """The five values at ``plant_s``, which must not go back; NaN where nothing is
        simulated."""
        while len(self._stretches) > 1 and self._stretches[1].start_s <= plant_s:
            self._stretches.pop(0)
        stretch = self._stretches[0]
        row = int((plant_s - stretch.start_s) / stretch.interval_s + 1e-9)
        return stretch.rows[row] if 0 <= row < len(stretch.rows) else self._none
