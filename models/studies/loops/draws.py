"""Random loops without a position: process, tuning, disturbances, sensor, and their record."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stemwatch.models.recording import Floats
from stemwatch.models.studies.loops.archive import archived
from stemwatch.models.studies.loops.kernel import LoopNumbers, run_scans
from stemwatch.models.studies.loops.random_signals import (
    coloured,
    many_scales,
    now_and_then,
    slewed,
    stepped,
    times_of_many_scales,
    wave,
)

# Disturbances of a loop, and how often each is drawn. Every one occurs with a sticking and with a
# sound stem, so that the disturbance itself is no evidence.
STORIES = {
    "quiet": 0.05,
    "load": 0.16,
    "tight": 0.14,
    "wave": 0.17,
    "set points": 0.16,
    "cascade": 0.10,
    "neighbour": 0.10,
    "noisy": 0.06,
    "sensor": 0.03,
    "saturated": 0.03,
}
_SECOND_STORY = 0.35  # of loops in which a second disturbance acts
_LEFT_AS_BUILT = 0.4  # of loops: a reset time that nobody matched to the process
_MANY_SCALES = 0.4  # of loops: load that wanders on all time scales alike (1/f)
WARM_UP = 400  # scans before the record
FEWEST, MOST = 130, 3600  # stored samples
FEWEST_SLIPS = 2  # of a sticking stem in its record; one that never moved shows nothing
_TRIES = 50


@dataclass(frozen=True, kw_only=True)
class DrawnLoop:
    """One simulated loop: what the archive holds, (n,) each in percent, and the truth behind it.

    ``S`` is 0 for a stem that does not stick; ``stem_S`` is what the simulated stem has, which in a
    sound valve is up to 0.4 %.
    """

    op: Floats
    pv: Floats
    sp: Floats
    interval_s: float
    S: float
    J: float
    stem_S: float
    story: str

    @property
    def sticky(self) -> bool:
        """Whether the stem sticks."""
        return self.S > 0.0


@dataclass(frozen=True, kw_only=True)
class Wandering:
    """Gaussian load of standard deviation ``size``, percent, and correlation time ``time`` in
    scans; ``where`` (n,) is what it is multiplied by, or ``None`` where it never stops."""

    size: float
    time: float
    where: Floats | None = None


@dataclass(frozen=True, kw_only=True)
class Disturbances:
    """(n,) each, at every scan: the ``load`` at the process input, percent of travel, and the
    ``push`` on PV itself. ``shaped`` is the part of the load that is steps and waves; the rest is
    the sum of ``wandering``."""

    load: Floats
    push: Floats
    shaped: Floats
    wandering: tuple[Wandering, ...]


@dataclass(frozen=True, kw_only=True)
class LoopScans:
    """A loop at every scan, (n,) each, before anything is stored: signals, stem, and what acts.

    ``noise`` is that of the sensor, of standard deviation ``noise_size`` and correlation time
    ``noise_time`` in scans.
    """

    numbers: LoopNumbers
    op: Floats
    pv: Floats
    sp: Floats
    stem: Floats
    disturbances: Disturbances
    noise_size: float
    noise_time: float


def draw_loop(seed: int, index: int, story: str = "") -> DrawnLoop:
    """Loop number ``index`` of ``seed``; even places stick (S 1 to 8 %), odd ones do not.

    ``story`` is one of ``STORIES``, or drawn.
    """
    return draw_with_scans(seed, index, story)[0]


def draw_with_scans(seed: int, index: int, story: str = "") -> tuple[DrawnLoop, LoopScans]:
    """``draw_loop``, and the same loop before it was stored; its record begins at scan
    ``WARM_UP``."""
    rng = np.random.default_rng([seed, index])
    for _ in range(_TRIES):
        loop, scans = _draw(rng, story, index % 2 == 0)
        if not loop.sticky or _slips(scans) >= FEWEST_SLIPS:
            return loop, scans
    raise RuntimeError(f"no loop of seed {seed}, place {index} moved its stem {FEWEST_SLIPS} times")


def _slips(scans: LoopScans) -> int:
    """How often the stem broke away in the record."""
    moves = np.diff(scans.stem[WARM_UP:]) != 0.0
    return int(np.count_nonzero(moves[1:] & ~moves[:-1]))


def draw_recordings(seed: int, index: int, count: int) -> list[DrawnLoop]:
    """``count`` recordings of loop number ``index`` of ``seed``: process, tuning, stem, kind of
    disturbance, interval and length are the same, all else is drawn anew. Even places stick. A
    stem that sticks may stand still throughout a recording."""
    rng = np.random.default_rng([seed, index, 1])
    built = _build(rng, "", index % 2 == 0)
    return [_recorded(np.random.default_rng([seed, index, 2, k]), built)[0] for k in range(count)]


@dataclass(frozen=True, kw_only=True)
class _BuiltLoop:
    """What stays as it is from one recording of a loop to the next. ``period`` is 2 pi times the
    settling time; ``stride`` scans lie between stored samples, of which there are ``count``."""

    story: str
    S: float
    J: float
    stride: int
    count: int
    numbers: LoopNumbers
    period: float


def _draw(rng: np.random.Generator, story: str, sticks: bool) -> tuple[DrawnLoop, LoopScans]:
    return _recorded(rng, _build(rng, story, sticks))


def _build(rng: np.random.Generator, story: str, sticks: bool) -> _BuiltLoop:
    drawn_story = str(rng.choice(list(STORIES), p=list(STORIES.values())))
    story = story or drawn_story
    S = float(np.exp(rng.uniform(np.log(1.0), np.log(8.0)))) if sticks else 0.0
    J = S * float(rng.choice([0.0, rng.uniform(0.1, 0.9), 1.0, rng.uniform(1.0, 1.2)]))
    stride = int(rng.choice([1, 1, 1, 2, 3, 5, 10, 20]))
    count = int(np.exp(rng.uniform(np.log(FEWEST), np.log(MOST))))
    numbers, period = _draw_numbers(rng, story, S, J)
    return _BuiltLoop(
        story=story, S=S, J=J, stride=stride, count=count, numbers=numbers, period=period
    )


def _recorded(rng: np.random.Generator, built: _BuiltLoop) -> tuple[DrawnLoop, LoopScans]:
    scans = _run(rng, built)
    op, pv, sp = archived((scans.op, scans.pv, scans.sp), WARM_UP, built.stride, rng)
    loop = DrawnLoop(
        op=op,
        pv=pv,
        sp=sp,
        interval_s=float(built.stride),
        S=built.S,
        J=built.J,
        stem_S=built.numbers.S,
        story=built.story,
    )
    return loop, scans


def _run(rng: np.random.Generator, built: _BuiltLoop) -> LoopScans:
    story, numbers, period = built.story, built.numbers, built.period
    scans = WARM_UP + built.stride * built.count
    stories = {story}
    if rng.random() < _SECOND_STORY:
        stories.add(str(rng.choice(["load", "wave", "set points", "cascade", "neighbour"])))
    time = np.arange(scans, dtype=np.float64)
    sp = _set_points(rng, stories, numbers, time, period)
    acting = _disturbances(rng, stories, numbers, time, period)
    size = float(np.exp(rng.uniform(np.log(0.005), np.log(0.2))))
    if story == "noisy":
        size = float(rng.uniform(0.2, 0.6))
    size, noise_time = min(size, 1.5 / numbers.gain), float(rng.choice([0.0, 0.0, 2.0]))
    noise = size * coloured(scans, noise_time, rng)
    read, stem = run_scans(numbers, sp, acting.load, acting.push, noise, rng.standard_normal(2048))
    return LoopScans(
        numbers=numbers,
        op=read[0],
        pv=read[1],
        sp=sp,
        stem=stem,
        disturbances=acting,
        noise_size=size,
        noise_time=noise_time,
    )


def _draw_numbers(
    rng: np.random.Generator, story: str, S: float, J: float
) -> tuple[LoopNumbers, float]:
    """The loop, tuned by the lambda rule well or too tight, and 2 pi times its settling time."""
    integrating = bool(rng.random() < 0.25)
    lag = float(np.exp(rng.uniform(np.log(0.5), np.log(80.0))))
    delay = int(rng.integers(0, max(2, round(lag * rng.choice([0.2, 0.6, 1.2])))))
    second = float(rng.choice([0.0, rng.uniform(0.0, 0.9) * lag]))
    process_gain = float(np.exp(rng.uniform(np.log(0.4), np.log(2.5))))
    air = float(rng.uniform(0.1, 3.0))
    sensor = float(rng.choice([0.0, rng.uniform(0.0, 2.0), rng.uniform(0.0, 0.5) * lag]))
    seldom = int(rng.choice([1, 1, 1, 2, 4]))
    pv_filter = float(rng.choice([0.0, 0.0, rng.uniform(0.5, 4.0)]))
    settle = delay + 0.5 + 0.5 * seldom + air + 0.5 * (second + sensor) + 0.7 * pv_filter
    tight = story == "tight"
    closed = settle * float(rng.uniform(0.02, 0.35) if tight else np.exp(rng.uniform(-0.2, 2.5)))
    reset = 4.0 * (closed + settle) if integrating else min(lag + 0.5, 4.0 * (closed + settle))
    reset *= float(rng.uniform(0.7, 1.5))
    if integrating and tight:
        reset *= float(rng.uniform(0.15, 0.6))
    elif rng.random() < _LEFT_AS_BUILT:
        reset *= float(np.exp(rng.uniform(-0.3, 2.0)))
    output = float(rng.uniform(30.0, 70.0))
    low, high = 0.0, 100.0
    if story == "saturated":
        low, high = output - float(rng.uniform(0.5, 6.0)), output + float(rng.uniform(3.0, 20.0))
    numbers = LoopNumbers(
        gain=(lag + 0.5) / (process_gain * (closed + settle)),
        reset=reset,
        low=low,
        high=high,
        output=output,
        air_lag=air,
        S=S if S > 0.0 else float(rng.uniform(0.0, 0.4)),
        J=J,
        scatter=float(rng.uniform(0.02, 0.25)),
        process_gain=process_gain,
        lag=lag,
        second_lag=second,
        delay=delay,
        integrating=integrating,
        play=float(rng.uniform(0.5, 4.0)) * process_gain if story == "sensor" else 0.0,
        sensor_lag=sensor,
        op_step=float(rng.choice([0.0, 0.0, 0.0, 0.01, 0.1])),
        pv_step=float(rng.choice([0.0, 0.0, 0.0, 0.0, 0.02, 0.1, 0.3])) * process_gain,
        bend=float(rng.choice([0.0, rng.uniform(-0.5, 0.5)])),
        executes_every=seldom,
        pv_filter=pv_filter,
        gap=float(rng.uniform(0.05, 0.5)) if rng.random() < 0.1 else 0.0,
    )
    return numbers, 2.0 * np.pi * (closed + settle)


def _set_points(
    rng: np.random.Generator, stories: set[str], numbers: LoopNumbers, time: Floats, period: float
) -> Floats:
    """(n,) set point in percent: still, stepped or ramped, or led by another loop."""
    sp = np.full(time.size, float(rng.uniform(35.0, 65.0)))
    if "set points" in stories:
        height = float(rng.uniform(2.0, 10.0)) * numbers.process_gain
        height *= 0.4 if numbers.integrating else 1.0
        moves = height * stepped(time, rng.uniform(2.0, 12.0) * period, rng)
        sp += slewed(moves, float(rng.uniform(0.02, 0.3))) if rng.random() < 0.3 else moves
    if "cascade" in stories:
        led = float(rng.uniform(0.5, 5.0)) * numbers.process_gain
        if rng.random() < 0.5:
            sp += led * wave(time, 2.0 * period, rng)
        else:
            sp += led * coloured(time.size, period * rng.uniform(1.0, 4.0), rng)
    return sp


def _disturbances(
    rng: np.random.Generator, stories: set[str], numbers: LoopNumbers, time: Floats, period: float
) -> Disturbances:
    load, wandering = _wandering_load(rng, time.size, period)
    push, shaped = np.zeros(time.size), np.zeros(time.size)
    if rng.random() < 0.15:
        steps = rng.uniform(0.3, 3.0) * stepped(time, rng.uniform(5.0, 30.0) * period, rng)
        load, shaped = load + steps, shaped + steps
    if "load" in stories:
        size, correlated = rng.uniform(0.5, 3.0), period * rng.uniform(0.5, 6.0)
        values = size * coloured(time.size, correlated, rng)
        where = now_and_then(time.size, 30.0 * period, rng)
        load = load + values * where
        wandering += [Wandering(size=size, time=correlated, where=where)]
    if "saturated" in stories:
        swing = wave(time, period, rng) * float(rng.uniform(2.0, 6.0))
        load, shaped = load + swing, shaped + swing
    for wave_story in ("wave", "neighbour"):  # in this order: one seed, one loop
        if wave_story not in stories:
            continue
        amplitude = float(np.exp(rng.uniform(np.log(0.5), np.log(5.0))))
        shape = (
            wave(time, period, rng) if wave_story == "wave" else _neighbour(time.size, period, rng)
        )
        if rng.random() < 0.3:
            push += amplitude * numbers.process_gain * 0.5 * shape
        else:
            load, shaped = load + amplitude * shape, shaped + amplitude * shape
    return Disturbances(load=load, push=push, shaped=shaped, wandering=tuple(wandering))


def _wandering_load(
    rng: np.random.Generator, scans: int, period: float
) -> tuple[Floats, list[Wandering]]:
    """(scans,) load that wanders always, and of what it is the sum."""
    size = float(np.exp(rng.uniform(np.log(0.03), np.log(0.6))))
    if rng.random() < _MANY_SCALES:
        load = 2.0 * size * many_scales(scans, rng)
        times = times_of_many_scales(scans)
        wandering = [
            Wandering(size=2.0 * size / np.sqrt(times.size), time=float(time)) for time in times
        ]
    else:
        correlated = period * rng.uniform(0.2, 3.0)
        load = size * coloured(scans, correlated, rng)
        wandering = [Wandering(size=size, time=correlated)]
    if rng.random() < 0.3:  # drift over much of the record
        drift, correlated = rng.uniform(0.5, 4.0), scans * rng.uniform(0.1, 1.0)
        load += drift * coloured(scans, correlated, rng)
        wandering += [Wandering(size=drift, time=correlated)]
    return load, wandering


def _neighbour(scans: int, period: float, rng: np.random.Generator) -> Floats:
    """The disturbance from a neighbouring loop with a sticking valve: its PV's deviation, unit
    size.
    """
    lag = max(period * float(rng.uniform(0.1, 0.6)), 2.0)
    settle = 0.3 * lag + 2.0
    S = float(rng.uniform(2.0, 8.0))
    numbers = LoopNumbers(
        gain=lag / (2.0 * settle),
        reset=min(lag, 8.0 * settle),
        low=0.0,
        high=100.0,
        output=50.0,
        air_lag=0.5,
        S=S,
        J=S * float(rng.uniform(0.2, 1.0)),
        scatter=0.08,
        process_gain=1.0,
        lag=lag,
        second_lag=0.0,
        delay=int(0.3 * lag),
        integrating=False,
        play=0.0,
        sensor_lag=0.0,
        op_step=0.0,
        pv_step=0.0,
        bend=0.0,
        executes_every=1,
        pv_filter=0.0,
        gap=0.0,
    )
    zeros = np.zeros(scans)
    load = 0.5 * coloured(scans, 5.0 * lag, rng)
    start = np.full(scans, 50.0)
    start[: scans // 50 + 1] = 50.0 + S
    read, _ = run_scans(numbers, start, load, zeros, zeros, rng.standard_normal(2048))
    deviation = read[1] - np.mean(read[1])
    return np.asarray(deviation / max(float(np.std(deviation)), 1e-6))
