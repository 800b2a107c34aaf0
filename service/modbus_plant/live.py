"""``LivePlant``: loops that run on, simulated ahead in a process of their own."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from dataclasses import dataclass

import numpy as np

from stemwatch.models.recording import Floats
from stemwatch.models.studies.simulator import PlantLoop
from stemwatch.service.modbus_plant.register_layout import MOST_LOOPS
from stemwatch.service.modbus_plant.simulated_ahead import (
    ROLES,
    SimulatedAhead,
    Stretch,
    simulate_stretch,
)
from stemwatch.service.modbus_plant.wear import Wear
from stemwatch.service.process_lifecycle import begin_child, starting_quietly

STRETCH_S = 1800.0
REPAIR_S = 5.0  # of plant time, during which a valve under repair shows no value


@dataclass
class _Running:
    """One loop while it runs: since when it wears, and what is being simulated for it."""

    loop: PlantLoop
    seed: int
    wear: Wear | None
    ahead: SimulatedAhead
    new_since_s: float = 0.0
    coming: Future[Stretch] | None = None


class LivePlant:
    """The signals of every loop at a plant time that only goes forward.

    ``wear`` names, by tag, the valves that get worse. The simulation runs ``stretch_s`` seconds of
    plant time at once in another process, so that serving never waits for it, and less where wear
    begins or ends in between. A stretch goes on from a state like the one before it ended in; only
    one in which wear grows begins in balance, which looks like a short upset of the loop.

    Raises ``ValueError`` without loops, for more loops than the registers hold, for a repeated tag,
    and for wear of an unknown loop.
    """

    def __init__(
        self,
        loops: Sequence[PlantLoop],
        *,
        wear: Mapping[str, Wear] | None = None,
        seed: int = 1,
        stretch_s: float = STRETCH_S,
    ) -> None:
        wear = wear or {}
        _check(loops, wear)
        self._stretch_s = stretch_s
        # Neither fork nor a thread: the server runs threads, and a kernel would hold its lock.
        context = multiprocessing.get_context("spawn")
        self._pool = ProcessPoolExecutor(
            max_workers=1, mp_context=context, initializer=_leave_ctrl_c
        )
        seeds = [seed + 100_003 * index for index in range(len(loops))]
        with starting_quietly():  # this starts the process
            first = [
                self._pool.submit(
                    simulate_stretch,
                    loop,
                    wear.get(loop.tag),
                    0.0,
                    0.0,
                    _length_s(wear.get(loop.tag), 0.0, stretch_s),
                    own_seed,
                )
                for loop, own_seed in zip(loops, seeds, strict=True)
            ]
        self._running = {
            loop.tag: _Running(loop, own_seed, wear.get(loop.tag), SimulatedAhead(stretch.result()))
            for loop, own_seed, stretch in zip(loops, seeds, first, strict=True)
        }

    @property
    def loops(self) -> tuple[PlantLoop, ...]:
        """The loops as they were at the beginning."""
        return tuple(running.loop for running in self._running.values())

    def rows(self, plant_s: float) -> list[Floats]:
        """OP, MV, PV, SP and mode of each loop at ``plant_s``; requests the next stretch in
        time."""
        return [self._row(running, plant_s) for running in self._running.values()]

    def repair(self, tag: str, plant_s: float, *, lasting: bool = False) -> None:
        """Repair the valve of loop ``tag`` at ``plant_s``.

        For ``REPAIR_S`` seconds it is out of service and its loop shows no value, so that the
        change is not taken for a movement of the stem. From then on it is as new, and wears again
        unless the repair is ``lasting``. Raises ``KeyError`` for an unknown tag.
        """
        running = self._running[tag]
        running.ahead.append(
            Stretch(plant_s, running.loop.archive.interval_s, np.empty((0, len(ROLES))))
        )
        running.new_since_s = plant_s + REPAIR_S
        if lasting:
            running.wear = None
        running.coming = self._simulate(running, running.new_since_s)

    def begin_wear(self, tag: str, wear: Wear, plant_s: float) -> None:
        """The valve of loop ``tag``, as new until now, wears from ``plant_s`` on.

        Raises ``KeyError`` for a tag that is not there.
        """
        running = self._running[tag]
        running.wear, running.new_since_s = wear, plant_s
        running.coming = self._simulate(running, plant_s)

    def close(self) -> None:
        """Stop simulating, and wait for the end of the other process.

        Waiting matters: at the exit of Python 3.11 a pool that is still ending may find its pipe
        closed and print a traceback.
        """
        self._pool.shutdown(wait=True, cancel_futures=True)

    def _row(self, running: _Running, plant_s: float) -> Floats:
        if running.coming is not None and running.coming.done():
            running.ahead.append(running.coming.result())
            running.coming = None
        if running.coming is None and running.ahead.stop_s - plant_s < self._stretch_s / 2:
            running.coming = self._simulate(running, max(running.ahead.stop_s, plant_s))
        return running.ahead.row(plant_s)

    def _simulate(self, running: _Running, start_s: float) -> Future[Stretch]:
        worn_s = start_s - running.new_since_s
        length_s = _length_s(running.wear, worn_s, self._stretch_s)
        before = running.ahead.before(start_s)
        return self._pool.submit(
            simulate_stretch,
            running.loop,
            running.wear,
            start_s,
            worn_s,
            length_s,
            running.seed,
            before,
        )


def _leave_ctrl_c() -> None:
    """Ctrl-C reaches every process of a terminal; this one ends when its parent tells it to."""
    begin_child(ignore=(signal.SIGINT,))


def _length_s(wear: Wear | None, worn_s: float, most_s: float) -> float:
    """How long a stretch is: wear keeps its slope in it."""
    return most_s if wear is None else min(wear.even_for_s(worn_s), most_s)


def _check(loops: Sequence[PlantLoop], wear: Mapping[str, Wear]) -> None:
    tags = [loop.tag for loop in loops]
    if not 1 <= len(tags) <= MOST_LOOPS:
        raise ValueError(f"1 to {MOST_LOOPS} loops are served, received {len(tags)}")
    if repeated := sorted({tag for tag in tags if tags.count(tag) > 1}):
        raise ValueError(f"every loop needs a tag of its own; twice: {repeated}")
    if unknown := sorted(set(wear) - set(tags)):
        raise ValueError(f"wear of loops that are not there: {unknown}; there are {sorted(tags)}")
