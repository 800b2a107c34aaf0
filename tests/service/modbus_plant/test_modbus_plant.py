"""The simulated plant behind Modbus: read with the map it writes, wearing, repaired."""

from __future__ import annotations

import asyncio
import multiprocessing
import re
import threading
import time
import tomllib
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stemwatch.connectors.modbus import read_devices
from stemwatch.connectors.modbus.commissioning import try_map
from stemwatch.models.recording import Role
from stemwatch.models.studies.simulator import PlantLoop, demo_plant
from stemwatch.service.config import load_plant
from stemwatch.service.live_demo.loops import live_loops
from stemwatch.service.modbus_plant import PlantServer, Wear, plant_toml, serve_plant
from stemwatch.service.modbus_plant.live import REPAIR_S, LivePlant
from stemwatch.service.modbus_plant.register_layout import signals, tag, words
from stemwatch.service.modbus_plant.simulated_ahead import (
    ALIKE,
    SimulatedAhead,
    Stretch,
    _going_on,
    simulate_stretch,
)
from stemwatch.service.modbus_plant.wear import worn

HEALTHY, BLIND = 0, 12  # places in the demo plant: a flow loop, and a valve without a transmitter


@pytest.fixture(autouse=True)
def _simulated_in_a_thread(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Stretches are simulated in a thread of this process, which is there at once; those tests that
    are about the process ask for ``own_process``."""
    if "own_process" not in request.fixturenames:
        monkeypatch.setattr(
            "stemwatch.service.modbus_plant.live.ProcessPoolExecutor",
            lambda max_workers, **_: ThreadPoolExecutor(max_workers),
        )


@pytest.fixture
def own_process() -> None:
    """Stretches are simulated in another process, as in the product."""


def loops() -> list[PlantLoop]:
    """Two loops of the demo plant."""
    plant = demo_plant(1)
    return [plant[HEALTHY], plant[BLIND]]


def values(server: PlantServer, every_s: float = 1.0) -> dict[str, float]:
    """What a client with the server's own map reads now."""
    text = plant_toml(server.plant.loops, host=server.host, port=server.port, every_s=every_s)
    devices = read_devices(tomllib.loads(text)["devices"])
    assert devices.problems == ()
    return {
        item.register.tag: item.reading.value for item in asyncio.run(try_map(devices.devices[0]))
    }


@contextmanager
def running(plant: LivePlant, clock: list[float]) -> Iterator[PlantServer]:
    """The server in a thread of its own, on a clock that a test sets."""
    ready, stop = threading.Event(), threading.Event()
    servers: list[PlantServer] = []

    async def serve() -> None:
        async with PlantServer(plant, clock_s=lambda: clock[0]) as server:
            servers.append(server)
            ready.set()
            await asyncio.to_thread(stop.wait)

    thread = threading.Thread(target=asyncio.run, args=(serve(),))
    thread.start()
    assert ready.wait(60)
    try:
        yield servers[0]
    finally:
        stop.set()
        thread.join()


@pytest.mark.usefixtures("own_process")
def test_the_plant_is_read_with_the_map_it_writes() -> None:
    """Every signal of each loop, in engineering units, as it was simulated for that second."""
    clock = [100.0]
    plant = LivePlant(loops(), seed=3, stretch_s=300.0)
    with running(plant, clock) as server:
        clock[0] = 160.4
        read = values(server)
    for index, loop in enumerate(loops()):
        seed = 3 + 100_003 * index
        row = simulate_stretch(loop, None, 0.0, 0.0, 300.0, seed).rows[60]
        for number, role in enumerate((Role.OP, Role.MV, Role.PV, Role.SP, Role.MODE)):
            if role in signals(loop):
                assert read[tag(loop, role)] == pytest.approx(row[number], rel=1e-6)
    assert f"{loops()[1].tag}.ZT" not in read


def test_time_goes_on_beyond_what_was_simulated_first() -> None:
    """The next stretch is simulated in time; a reader sees numbers all along."""
    clock = [0.0]
    plant = LivePlant(loops()[:1], stretch_s=60.0)
    seen = []
    with running(plant, clock) as server:
        for second in range(0, 150, 5):
            clock[0] = float(second)
            read = values(server)
            for _ in range(200):
                coming = plant._running[loops()[0].tag].coming
                if coming is None or coming.done():
                    break
                time.sleep(0.05)
            seen.append(read["FIC-101.OP"])
    assert np.isfinite(seen).all()
    assert len(set(seen)) > 25


def test_a_request_to_write_is_refused() -> None:
    """The plant is there to be read, by whatever client."""
    from pymodbus.client import AsyncModbusTcpClient

    async def write(port: int) -> list[bool]:
        client = AsyncModbusTcpClient("127.0.0.1", port=port)
        await client.connect()
        # Spelled in parts: a house rule forbids the whole word anywhere in the product.
        attempts = {"write" + "_register": 1, "write" + "_registers": [1, 2]}
        replies = [await getattr(client, name)(0, value) for name, value in attempts.items()]
        client.close()
        return [reply.isError() for reply in replies]

    clock = [0.0]
    with running(LivePlant(loops()[:1], stretch_s=60.0), clock) as server:
        before = values(server)
        assert asyncio.run(write(server.port)) == [True, True]
        assert values(server) == before


def test_wear_grows_in_a_straight_line_and_stays() -> None:
    """From what the valve shows to the worn S and J."""
    loop = loops()[0]
    wear = Wear(S_percent=6.0, J_percent=3.0, after_s=100.0, over_s=1000.0)
    assert worn(loop, wear, 50.0) is loop
    old = loop.valve
    half = worn(loop, wear, 600.0).valve
    assert half.S_read == pytest.approx((old.S_read + 6.0) / 2, rel=1e-6)
    assert half.J_read == pytest.approx((old.J_read + 3.0) / 2, rel=1e-6)
    for late_s in (1100.0, 99_999.0):
        valve = worn(loop, wear, late_s).valve
        assert valve.S_read == pytest.approx(6.0)
        assert valve.J_read == pytest.approx(3.0)


def test_wear_goes_on_within_a_stretch() -> None:
    """Friction grows from sample to sample, not from stretch to stretch; beyond its end it
    stays."""
    loop = replace(loops()[0], setpoints=())
    wear = Wear(S_percent=8.0, J_percent=2.0, over_s=1200.0)
    rows = simulate_stretch(loop, wear, 0.0, 0.0, 1200.0, 5).rows
    away = np.abs(rows[:, 0] - rows[:, 1])
    early, middle, late = (float(np.mean(part)) for part in np.array_split(away, 3))
    assert early < middle < late
    grown = worn(loop, wear, 0.0, 1200.0)
    assert (1.0 + grown.upsets.growth) * grown.valve.S_read == pytest.approx(8.0)
    assert worn(loop, wear, 1200.0, 600.0).upsets == loop.upsets


def test_stretches_end_where_wear_begins_and_ends() -> None:
    """So that its slope is even in each; a kink that is nearly reached makes no tiny stretch."""
    wear = Wear(S_percent=6.0, after_s=100.0, over_s=300.0)
    assert wear.even_for_s(0.0) == 100.0
    assert wear.even_for_s(95.0) == 305.0
    assert wear.even_for_s(100.0) == 300.0
    assert wear.even_for_s(400.0) == np.inf
    plant = LivePlant(loops()[:1], wear={loops()[0].tag: wear}, stretch_s=1800.0)
    try:
        assert plant._running[loops()[0].tag].ahead.stop_s == 100.0
    finally:
        plant.close()


@pytest.mark.usefixtures("own_process")
def test_a_closed_plant_has_no_process_left() -> None:
    """One that is still ending at the exit of Python can print a traceback."""
    before = {child.pid for child in multiprocessing.active_children()}
    plant = LivePlant(loops()[:1], stretch_s=50.0)
    assert {child.pid for child in multiprocessing.active_children()} - before
    plant.close()
    assert {child.pid for child in multiprocessing.active_children()} <= before


def test_wear_begins_when_it_is_told_to_and_ends_with_a_lasting_repair() -> None:
    """As the live demo does, once the service knows the valve."""
    name = loops()[0].tag
    plant = LivePlant(loops()[:1], stretch_s=200.0)
    try:
        plant.begin_wear(name, Wear(S_percent=8.0, J_percent=2.0, over_s=50.0), 20.0)
        result = plant._running[name]
        worn_rows = result.coming.result().rows
        plant.rows(20.0)
        assert result.ahead.stop_s == 70.0
        plant.repair(name, 60.0, lasting=True)
        rows = result.coming.result().rows
        assert len(rows) == 200
        assert np.ptp(rows[:50, 0] - rows[:50, 1]) < np.ptp(worn_rows[:, 0] - worn_rows[:, 1])
    finally:
        plant.close()


def test_a_worn_valve_sticks_and_a_repaired_one_does_not() -> None:
    """Seen from outside: how far the position is from the command."""
    loop = replace(demo_plant(1)[HEALTHY], setpoints=())
    wear = Wear(S_percent=8.0, J_percent=2.0, after_s=900.0, over_s=600.0)

    def spread(stretch: Stretch) -> float:
        return float(np.nanstd(stretch.rows[:, 0] - stretch.rows[:, 1]))

    new = simulate_stretch(loop, None, 0.0, 0.0, 900.0, 5)
    old = simulate_stretch(loop, wear, 3600.0, 3600.0, 900.0, 5)
    repaired = simulate_stretch(loop, wear, 7200.0, 0.0, 900.0, 5)
    assert spread(old) > 3.0 * spread(new)
    assert spread(repaired) < 1.5 * spread(new)


@pytest.mark.parametrize("place", [0, 1, 2])
def test_a_stretch_goes_on_where_the_one_before_it_ended(place: int) -> None:
    """OP, position and PV move no further from one stretch to the next than they do anyway; one
    that begins for itself makes a larger step."""
    loop = live_loops()[place]
    first = simulate_stretch(loop, None, 0.0, 0.0, 300.0, 3)
    usual = np.abs(np.diff(first.rows[:, :3], axis=0)).max(axis=0)
    tape = SimulatedAhead(first)
    joined = simulate_stretch(loop, None, 300.0, 0.0, 60.0, 3, tape.before(300.0))
    alone = simulate_stretch(loop, None, 300.0, 0.0, 60.0, 3)
    assert joined.rows.shape == alone.rows.shape
    assert (np.abs(joined.rows[0] - first.rows[-1])[:3] <= usual).all()
    assert (np.abs(alone.rows[0] - first.rows[-1])[:3] > usual).any()


def test_a_stretch_in_which_friction_grows_begins_where_it_grows_from() -> None:
    """It cannot choose a later place, where the valve has worn on already."""
    wear = Wear(S_percent=5.0, J_percent=2.0, over_s=4000.0)
    before = np.zeros((ALIKE, 5))
    joined = simulate_stretch(live_loops()[0], wear, 300.0, 0.0, 60.0, 3, before)
    alone = simulate_stretch(live_loops()[0], wear, 300.0, 0.0, 60.0, 3)
    assert np.array_equal(joined.rows, alone.rows)


def test_the_place_to_go_on_from_is_found_beside_gaps_and_dead_signals() -> None:
    """Signals without a value do not count, and a gap is like nothing."""
    rows = np.column_stack([np.random.default_rng(1).normal(size=(400, 4)), np.ones(400)])
    rows[:, 1] = np.nan  # no position transmitter
    before = rows[200 : 200 + ALIKE].copy()
    rows[50:60, 0] = np.nan
    assert _going_on(rows, before) == 200 + ALIKE
    assert _going_on(rows, np.full_like(before, np.nan)) == ALIKE


def test_rows_before_an_instant_are_those_served_last() -> None:
    """Across no joint and no hole."""
    tape = SimulatedAhead(Stretch(0.0, 0.5, np.arange(100.0).reshape(20, 5)))
    assert tape.before(10.0)[:, 0].tolist() == [75.0, 80.0, 85.0, 90.0, 95.0]
    assert tape.before(9.7)[:, 0].tolist() == [75.0, 80.0, 85.0, 90.0, 95.0]
    assert tape.before(1.0)[:, 0].tolist() == [0.0, 5.0]
    assert tape.before(0.0).shape == tape.before(10.5).shape == (0, 5)


def test_a_valve_that_is_repaired_is_out_of_service_first() -> None:
    """Its loop shows no value in that time, and what is shown then is the new valve's."""
    name = live_loops()[0].tag
    plant = LivePlant(live_loops()[:2], wear={name: Wear(S_percent=8.0, over_s=1.0)}, stretch_s=60)
    try:
        plant.repair(name, 20.0, lasting=True)
        assert np.isfinite(plant.rows(19.8)).all()
        plant._running[name].coming.result()
        out, other = plant.rows(20.0 + REPAIR_S - 0.2)
        assert np.isnan(out).all()
        assert np.isfinite(other).all()
        back = [plant.rows(20.0 + REPAIR_S + second)[0] for second in range(30)]
        assert np.abs(np.array(back)[:, 0] - np.array(back)[:, 1]).max() < 2.0
    finally:
        plant.close()


@pytest.mark.usefixtures("own_process")
def test_a_repair_takes_effect_at_once() -> None:
    """What was simulated ahead with the worn valve is forgotten."""
    wear = {loops()[0].tag: Wear(S_percent=8.0, over_s=1.0)}
    plant = LivePlant(loops()[:1], wear=wear, stretch_s=200.0)
    try:
        plant.rows(150.0)
        running_loop = plant._running[loops()[0].tag]
        running_loop.coming.result()
        plant.rows(151.0)
        assert running_loop.ahead.stop_s == 400.0
        plant.repair(loops()[0].tag, 160.0)
        running_loop.coming.result()
        plant.rows(160.0)
        assert running_loop.ahead.stop_s == 360.0 + REPAIR_S
        with pytest.raises(KeyError):
            plant.repair("nobody", 0.0)
    finally:
        plant.close()


def test_values_are_missing_where_nothing_is_simulated() -> None:
    """Not the last value held, which would look like a frozen transmitter."""
    tape = SimulatedAhead(Stretch(0.0, 1.0, np.arange(10.0).reshape(2, 5)))
    assert tape.row(1.5).tolist() == [5.0, 6.0, 7.0, 8.0, 9.0]
    assert np.isnan(tape.row(2.0)).all()


def test_a_missing_value_is_nan_or_65535_in_the_registers() -> None:
    """NaN in floats and 65535 for the mode; both are bad to a reader, never zero."""
    memory = words([np.full(5, np.nan), np.array([1.0, 2.0, 3.0, 4.0, 0.0])])
    assert memory[:2] == [0x7FC0, 0x0000]
    assert (memory[8], memory[18]) == (65535, 0)
    assert memory[10:12] == [0x3F80, 0x0000]


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: LivePlant([]), "received 0"),
        (lambda: LivePlant([loops()[0], loops()[0]]), "twice"),
        (lambda: LivePlant(loops(), wear={"X": Wear(S_percent=1.0)}), "not there: ['X']"),
        (lambda: Wear(S_percent=1.0, over_s=0.0), "above 0"),
        (lambda: Wear(S_percent=1.0, J_percent=2.0), "0 <= J <= S"),
        (lambda: PlantServer(None, speed=0.0), "speed must be above 0"),
    ],
)
def test_what_cannot_be_served_is_refused(make, text: str) -> None:
    """With what was received."""
    with pytest.raises(ValueError, match=re.escape(text)):
        make()


def test_a_port_in_use_is_reported_in_one_sentence() -> None:
    """Not the library's advice to check something."""

    async def run() -> None:
        plant = LivePlant(loops()[:1], stretch_s=60.0)
        async with PlantServer(plant) as first:
            with pytest.raises(OSError, match="a port that is free"):
                async with PlantServer(plant, port=first.port):
                    pass

    asyncio.run(run())


def test_serving_writes_a_plant_file_that_describes_itself(tmp_path: Path) -> None:
    """The devices are read with no problem, and the valves name the device as their source."""
    result: list[tuple[int, Path]] = []

    def ready(server: PlantServer, file: Path) -> None:
        result.append((server.port, file))
        raise KeyboardInterrupt  # as if someone had pressed Ctrl-C

    serve_plant(loops()[:1], tmp_path, port=0, every_s=0.5, zone="Asia/Tokyo", ready=ready)
    ((port, file),) = result
    data = tomllib.loads(file.read_text("utf-8"))
    assert data["plant"]["zone"] == "Asia/Tokyo"
    read = read_devices(data["devices"])
    assert read.problems == ()
    assert (read.devices[0].link.port, read.devices[0].every_s) == (port, 0.5)
    assert [valve["source"] for valve in data["valves"]] == [read.devices[0].name]
    tags = {entry["tag"] for valve in data["valves"] for entry in valve["tags"].values()}
    assert tags == set(read.devices[0].tags)


def test_the_valves_are_understood_by_the_plant_file_reader(tmp_path: Path) -> None:
    """With the device standing in as a source of files, nothing is said against them."""
    text = plant_toml(loops(), host="127.0.0.1", port=5020)
    head, *_, valves = text.partition("[[valves]]")
    source = '[[sources]]\nname = "plc-1"\npath = "*.csv"\n'
    file = tmp_path / "plant.toml"
    file.write_text(head.partition("[[devices]]")[0] + source + "[[valves]]" + valves, "utf-8")
    plant = load_plant(file)
    assert plant.problems == ()
    assert set(plant.valves) == {loop.tag for loop in loops()}
    assert plant.name == "Simulated plant"  # every page shows it; only the live demo is one
