"""Plants drawn at random: units of loops in a row, a recycle, sources of oscillation, records."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.recording import Bools, Floats
from stemwatch.models.studies.interacting_loops.kernel import (
    DELAY,
    FROM,
    GAIN,
    INTEGRATING,
    JUMP,
    LAG,
    PROCESS,
    RESET,
    STEP,
    STICK,
    STRENGTH,
    TO,
    run_plant,
)

Ints = NDArray[np.int64]

SCAN_S = 2.0
EVERY = 5  # scans between samples: 10 s
LEAST_SHARE = 0.1  # of a loop's variance that makes it a member of an oscillation
_CALM = 0.3  # share of noise and loads that is left, so that a sticking valve still starts to cycle
_FASTEST_SEEN = 6.0 * EVERY  # scans: a period of fewer samples is not recorded
_MOST_SCANS = 21_600  # twelve hours
_FEWEST_CYCLES = 8  # in the record; what is slower is drift


class SourceKind(StrEnum):
    """The cause of a group's oscillation."""

    STICKING = "sticking valve"
    TIGHT = "tight loop"
    WAVE = "external wave"


@dataclass(frozen=True)
class Source:
    """A cause of oscillation: the loop it sits in, or -1 for a wave from outside."""

    kind: SourceKind
    loop: int


@dataclass(frozen=True, kw_only=True)
class DrawnPlant:
    """A drawn plant, before it runs. Arrays as ``run_plant`` takes them."""

    loops: Floats
    links: Floats
    set_points: Floats
    loads: Floats
    noise: Floats
    sticking: Floats
    units: tuple[int, ...]  # the unit of each loop
    sources: tuple[Source, ...] = ()
    waves: tuple[Floats, ...] = ()  # (m, scans) loads of each source, zero where it is a loop


@dataclass(frozen=True, kw_only=True)
class RunPlant:
    """The recorded signals of a plant and the truth behind them.

    ``sp``, ``pv``, ``op`` (m, n). ``shares`` (sources, m): the share of each PV's variance near the
    source's frequency that disappears without the source, or that the source alone adds to a calmer
    plant, whichever is larger. ``label`` (m,) by ``labels_by_share``. ``feeds``: the loops that
    each loop acts on.
    """

    interval_s: float
    sp: Floats
    pv: Floats
    op: Floats
    units: tuple[int, ...]
    sources: tuple[Source, ...]
    shares: Floats
    label: tuple[int, ...]
    feeds: Mapping[int, tuple[int, ...]]


def draw_plant(rng: np.random.Generator, sources: int | None = None) -> DrawnPlant:
    """A plant of 10 to 40 loops with 0 to 3 sources, or with ``sources`` of them."""
    m = int(rng.integers(10, 41))
    source_count = int(rng.integers(0, 4)) if sources is None else sources
    units = np.sort(rng.integers(0, max(2, m // 6), m))
    loops = np.stack([_loop(rng) for _ in range(m)])
    links = _damped(loops, _links(rng, units, loops))
    plant = DrawnPlant(
        loops=loops,
        links=links,
        set_points=_set_points(rng, m),
        loads=_loads(rng, loops),
        noise=rng.normal(size=(m, _MOST_SCANS)) * rng.uniform(0.03, 0.3, (m, 1)),
        sticking=np.ones((m, _MOST_SCANS)),
        units=tuple(int(unit) for unit in units),
    )
    for _ in range(source_count):
        plant = _with_source(rng, plant)
    return plant


def unrelated_loops(rng: np.random.Generator, count: int) -> RunPlant:
    """``count`` loops that have nothing to do with each other: each is one of a plant of its own.

    Whatever group is found among them is none. They are those of plants with and without sources,
    so that many oscillate, each with its own period.
    """
    rows: list[tuple[Floats, Floats, Floats]] = []
    for _ in range(count):
        plant = draw_plant(rng)
        pv, op = _run(plant, range(len(plant.sources)))
        loop = int(rng.integers(len(plant.units)))
        rows.append((_set_points_recorded(plant, pv.shape[1])[loop], pv[loop], op[loop]))
    size = min(pv.size for _, pv, _ in rows)
    sp, pv, op = (np.array([signal[:size] for signal in each]) for each in zip(*rows, strict=True))
    return RunPlant(
        interval_s=SCAN_S * EVERY,
        sp=sp,
        pv=pv,
        op=op,
        units=tuple(range(count)),
        sources=(),
        shares=np.zeros((0, count)),
        label=(-1,) * count,
        feeds={},
    )


def run_drawn(plant: DrawnPlant) -> RunPlant:
    """Run the plant as it is recorded, without each of its sources, and, with a third of its noise
    and loads, without any and with each source alone.
    """
    all_sources = range(len(plant.sources))
    pv, op = _run(plant, all_sources)
    shares = np.zeros((len(plant.sources), pv.shape[0]))
    calm = replace(
        plant,
        loads=_CALM * plant.loads,
        noise=_CALM * plant.noise,
        set_points=0.0 * plant.set_points,
    )
    recorded, quiet_pv = _moving(pv), _moving(_run(calm, [])[0])
    variance = np.var(recorded, axis=1) + 1e-12
    for index in all_sources:
        with_one = _moving(_run(calm, [index])[0])
        pv_without, op_without = _run(plant, [k for k in all_sources if k != index])
        bins = _of_source(plant, index, op, op_without)
        in_bins = _around(recorded, bins)
        caused = np.minimum(np.var(with_one, axis=1) - np.var(quiet_pv, axis=1), in_bins)
        needed = in_bins - _around(_moving(pv_without), bins)
        shares[index] = np.clip(np.maximum(caused, needed) / variance, 0.0, 1.0)
    return RunPlant(
        interval_s=SCAN_S * EVERY,
        sp=_set_points_recorded(plant, pv.shape[1]),
        pv=pv,
        op=op,
        units=plant.units,
        sources=plant.sources,
        shares=shares,
        label=labels_by_share(shares),
        feeds=_feeds(plant.links),
    )


def _of_source(plant: DrawnPlant, index: int, op: Floats, op_without: Floats) -> Bools:
    """The bins within a quarter of a source's frequency, and of its second and third harmonics.

    The frequency is the strongest, within 15 %, of a wave from outside, or of what OP of the loop
    has more than ``op_without`` the source. Other loops do not show it for certain: each run of a
    limit cycle is another one, and the differences of a strong one may hide a weak source.
    """
    loop = plant.sources[index].loop
    signals = plant.waves[index][:, ::EVERY] if loop < 0 else np.stack([op[loop], op_without[loop]])
    power = np.abs(np.fft.rfft(_moving(signals), axis=1)) ** 2
    more = power.sum(axis=0) if loop < 0 else np.maximum(power[0] - power[1], 0.0)
    total = np.cumsum(np.append(0.0, more))
    bins = np.arange(more.size)
    low = np.floor(bins / 1.15).astype(np.int64)
    high = np.minimum(np.ceil(bins * 1.15).astype(np.int64) + 1, bins.size)
    added = total[high] - total[low]
    strongest = _FEWEST_CYCLES + int(np.argmax(added[_FEWEST_CYCLES:]))
    near = slice(low[strongest], high[strongest])
    ratio = bins / np.average(bins[near], weights=more[near] + 1e-30)
    return np.asarray(np.any([np.abs(ratio / k - 1.0) <= 0.25 / k for k in (1, 2, 3)], axis=0))


def _around(values: Floats, bins: Bools) -> Floats:
    """(m,) variance within ``bins`` of the spectrum."""
    spectrum = np.abs(np.fft.rfft(values, axis=1)) ** 2
    return np.asarray(2.0 * spectrum[:, bins].sum(axis=1) / values.shape[1] ** 2)


def _feeds(links: Floats) -> dict[int, tuple[int, ...]]:
    """Which loops each loop acts on."""
    pairs = sorted({(int(link[FROM]), int(link[TO])) for link in links})
    return {a: tuple(to for start, to in pairs if start == a) for a in {a for a, _ in pairs}}


def labels_by_share(shares: Floats) -> tuple[int, ...]:
    """(m,) the source, or group, of each loop: the one with the largest of its ``shares``
    (sources, m), of at least ``LEAST_SHARE``, -1 for none. Where one is left with fewer than two
    loops, it is no group, and its loop belongs to the next; the weakest such goes first."""
    rows = list(range(shares.shape[0]))
    while rows:
        left = shares[rows]
        label = np.where(left.max(axis=0) >= LEAST_SHARE, np.array(rows)[left.argmax(axis=0)], -1)
        counts = {row: (int((label == row).sum()), float(shares[row].sum())) for row in rows}
        weakest = min(rows, key=lambda row: counts[row])
        if counts[weakest][0] >= 2:
            return tuple(int(number) for number in label.tolist())
        rows.remove(weakest)
    return tuple([-1] * shares.shape[1])


def _set_points_recorded(plant: DrawnPlant, samples: int) -> Floats:
    return np.asarray(50.0 + plant.set_points[:, EVERY - 1 :: EVERY][:, :samples])


def _moving(values: Floats) -> Floats:
    """Remove everything slower than two hours, which is drift and no oscillation."""
    width = 720
    padded = np.pad(values, ((0, 0), (width // 2, width - 1 - width // 2)), mode="edge")
    total = np.cumsum(np.pad(padded, ((0, 0), (1, 0))), axis=1)
    return np.asarray(values - (total[:, width:] - total[:, :-width]) / width)


def _run(plant: DrawnPlant, active: range | list[int]) -> tuple[Floats, Floats]:
    loops, loads = plant.loops.copy(), plant.loads.copy()
    for index, source in enumerate(plant.sources):
        if index in active:
            loads += plant.waves[index] if source.kind is SourceKind.WAVE else 0.0
        elif source.kind is SourceKind.STICKING:
            loops[source.loop, STICK] = 0.0
        elif source.kind is SourceKind.TIGHT:
            loops[source.loop, GAIN] *= 0.45
    return run_plant(
        loops, plant.links, plant.set_points, loads, plant.noise, plant.sticking, EVERY
    )


def _loop(rng: np.random.Generator) -> Floats:
    """Flow, pressure, temperature or level, tuned with margin; times in scans."""
    kind = rng.choice(4, p=[0.4, 0.2, 0.25, 0.15])
    lag = np.exp(rng.uniform(*np.log([(8, 20), (12, 35), (40, 150), (100, 400)][kind])))
    delay = max(1, round([0.3, 0.25, 0.25, 0.03][kind] * lag * rng.uniform(0.5, 1.5)))
    process = rng.uniform(0.6, 1.8)
    integrating = kind == 3
    closed = (delay + 1.0) * rng.uniform(2.0, 5.0) + (0.3 * lag if integrating else 0.0)
    if integrating:
        gain, reset = lag / (process * (closed + delay)), 4.0 * (closed + delay)
    else:
        gain, reset = lag / (process * (closed + delay)), min(lag, 4.0 * (closed + delay))
    step = float(rng.choice([0.0, 0.05, 0.2], p=[0.6, 0.3, 0.1]))
    return np.array([min(gain, 8.0), max(reset, 3.0), -48.0, 48.0, process, lag, delay,
                     float(integrating), 0.0, 0.0, step])  # fmt: skip


def _links(rng: np.random.Generator, units: Ints, loops: Floats) -> Floats:
    """Inside a unit most loops act on one or two others; a unit acts on the next, and in a third
    of plants the last one on the first."""
    m, links = units.size, []

    def link(a: int, b: int, strength: float) -> None:
        lag = np.exp(rng.uniform(np.log(3.0), np.log(40.0)))
        scale = 0.25 if loops[b, INTEGRATING] else 1.0
        links.append([a, b, strength * scale * rng.choice([-1.0, 1.0]), lag, rng.random() < 0.5])

    for a in range(m):
        same_unit = [b for b in range(m) if b != a and units[b] == units[a]]
        for b in rng.permutation(same_unit)[: rng.integers(2, 5)] if same_unit else []:
            link(a, int(b), rng.uniform(0.3, 1.2))
    for unit in range(int(units.max())):
        loops_of_unit, loops_of_next = (
            np.flatnonzero(units == unit),
            np.flatnonzero(units == unit + 1),
        )
        for _ in range(2 if loops_of_unit.size and loops_of_next.size else 0):
            link(
                int(rng.choice(loops_of_unit)),
                int(rng.choice(loops_of_next)),
                rng.uniform(0.4, 1.2),
            )
    first, last = np.flatnonzero(units == 0), np.flatnonzero(units == units.max())
    if first.size and units.max() > 0 and rng.random() < 0.33:
        link(int(rng.choice(last)), int(rng.choice(first)), rng.uniform(0.1, 0.4))
    return np.array(links, dtype=np.float64).reshape(-1, 5)


def _damped(loops: Floats, links: Floats) -> Floats:
    """The links, weakened until the plant without any source is stable with a margin: with
    controller gains a quarter and links a half larger.
    """
    m, scans = loops.shape[0], 9000
    pulse = np.zeros((m, scans))
    pulse[:, :50] = 3.0 * np.where(np.arange(m) % 2, 1.0, -1.0)[:, None]
    no_input, always = np.zeros((m, scans)), np.ones((m, scans))
    detuned = loops.copy()
    detuned[:, GAIN] *= 1.25
    detuned[:, STEP] = 0.0
    for _ in range(12):
        stronger = links.copy()
        stronger[:, STRENGTH] *= 1.5
        pv, _ = run_plant(detuned, stronger, no_input, pulse, no_input, always, EVERY)
        swing = np.abs(pv - 50.0)
        if (swing[:, -400:].max(axis=1) <= 0.02 * swing.max(axis=1) + 1e-6).all():
            break
        links = links * np.where(np.arange(5) == STRENGTH, 0.8, 1.0)
    return links


def _set_points(rng: np.random.Generator, m: int) -> Floats:
    """Constant, but for a step now and then in one loop of five."""
    out = np.zeros((m, _MOST_SCANS))
    for i in np.flatnonzero(rng.random(m) < 0.2):
        for scan in rng.integers(0, _MOST_SCANS, rng.integers(1, 6)):
            out[i, scan:] += rng.normal() * 2.0
    return out


def _loads(rng: np.random.Generator, loops: Floats) -> Floats:
    """Slow wandering loads, of times of their own, smaller where the process integrates."""
    from scipy.signal import lfilter

    m = loops.shape[0]
    out = np.empty((m, _MOST_SCANS))
    for i in range(m):
        keep = np.exp(-1.0 / np.exp(rng.uniform(np.log(20.0), np.log(1500.0))))
        white = rng.normal(size=_MOST_SCANS) * np.sqrt(1.0 - keep**2)
        size = rng.uniform(0.2, 0.7) * (0.3 if loops[i, INTEGRATING] else 1.0)
        out[i] = size * lfilter([1.0], [1.0, -keep], white)
    return out


def _with_source(rng: np.random.Generator, plant: DrawnPlant) -> DrawnPlant:
    """Add a source, in a loop that has none and that acts on others."""
    used_loops = {source.loop for source in plant.sources}
    out = np.bincount(plant.links[:, 0].astype(np.int64), minlength=plant.loops.shape[0])
    acting = set(np.flatnonzero(out >= 2).tolist()) - used_loops
    kind = rng.choice(list(SourceKind), p=[0.5, 0.25, 0.25])
    m = plant.loops.shape[0]
    wave = np.zeros((m, _MOST_SCANS))
    kind = SourceKind(str(kind))
    if kind is SourceKind.TIGHT:
        acting = {loop for loop in acting if _ultimate(plant.loops[loop])[1] >= _FASTEST_SEEN}
    if kind is SourceKind.WAVE or not acting:
        return replace(
            plant,
            sources=(*plant.sources, Source(SourceKind.WAVE, -1)),
            waves=(*plant.waves, _wave(rng, plant)),
        )
    loop = int(rng.choice(sorted(acting)))
    loops, sticking = plant.loops.copy(), plant.sticking.copy()
    if kind is SourceKind.STICKING:
        S = rng.uniform(3.0, 10.0)
        loops[loop, STICK], loops[loop, JUMP] = S, S * rng.uniform(0.1, 0.6)
        # Enough integral action that the loop hunts, as a plant's usual tuning does.
        loops[loop, GAIN] *= rng.uniform(1.0, 1.8)
        loops[loop, RESET] = max(3.0, loops[loop, RESET] * rng.uniform(0.4, 0.9))
        sticking[loop] = _present(rng)
    else:
        loops[loop, GAIN] = _ultimate(loops[loop])[0] * rng.uniform(1.0, 1.08)
        loops[loop, 2], loops[loop, 3] = -rng.uniform(6.0, 20.0), rng.uniform(6.0, 20.0)
    return replace(
        plant,
        loops=loops,
        sticking=sticking,
        sources=(*plant.sources, Source(kind, loop)),
        waves=(*plant.waves, wave),
    )


def _present(rng: np.random.Generator) -> Floats:
    """When a source acts: all the time, or in one source of four for a part of it."""
    out = np.ones(_MOST_SCANS)
    if rng.random() < 0.25:
        first, last = np.sort(rng.uniform(0.0, 1.0, 2))
        last = max(last, first + 0.35)
        out[: int(first * _MOST_SCANS)] = 0.0
        out[int(last * _MOST_SCANS) :] = 0.0
    return out


def _wave(rng: np.random.Generator, plant: DrawnPlant) -> Floats:
    """A sine, square or triangle from outside, its phase wandering, into one loop or several."""
    m = plant.loops.shape[0]
    period = np.exp(rng.uniform(np.log(60.0), np.log(900.0)))  # 2 to 30 min
    wander = np.cumsum(rng.normal(size=_MOST_SCANS)) * rng.uniform(0.0, 0.1) / np.sqrt(period)
    phase = 2.0 * np.pi * np.arange(_MOST_SCANS) / period + wander
    shape = int(rng.integers(0, 3))
    sine = np.sin(phase)
    wave = (sine, np.clip(4.0 * sine, -1.0, 1.0), 2.0 / np.pi * np.arcsin(sine))[shape]
    loops_reached = rng.permutation(m)[: rng.integers(2, 6)]
    out = np.zeros((m, _MOST_SCANS))
    for i in loops_reached:
        size = rng.uniform(1.0, 5.0) * (0.4 if plant.loops[i, INTEGRATING] else 1.0)
        out[i] = size * rng.choice([-1.0, 1.0]) * np.roll(wave, int(rng.integers(0, 60)))
    return out * _present(rng)


def _ultimate(loop: Floats) -> tuple[float, float]:
    """The ultimate gain of the loop's controller and the ultimate period."""
    w = np.exp(np.linspace(np.log(1e-4), np.log(np.pi), 8000))
    z = np.exp(1j * w)
    if loop[INTEGRATING]:
        process = loop[PROCESS] / loop[LAG] / (z - 1.0)
    else:
        process = loop[PROCESS] / loop[LAG] / (z - 1.0 + 1.0 / loop[LAG])
    open_loop = process * z ** (-loop[DELAY]) * (1.0 + z / (z - 1.0) / loop[RESET])
    phase = np.unwrap(np.angle(open_loop))
    past_180: Bools = phase <= -np.pi
    crossing = int(np.argmax(past_180)) if past_180.any() else w.size - 1
    return float(1.0 / np.abs(open_loop[crossing])), float(2.0 * np.pi / w[crossing])
