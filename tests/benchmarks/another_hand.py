"""Valves by other equations than those that are fitted, for ``bench_another_hand.py``.

A mass on a spring, moved by air through orifices, held by LuGre's or Karnopp's friction, in a loop.
Places are percent of travel, forces percent of the spring's range, pressures kPa. With place ``x``,
pressure ``P`` and sliding direction ``s``:

    m x'' = (P - 20)/0.8 - x - push(x) - inner(x) - drag x' - friction
    P' = (flow(u, P) - (P + 100) x'/100) / (V + x/100)        flow ~ u sqrt(P_supply - P), u sqrt(P)
    friction (LuGre): z' = x' - |x'| z/z_max(x'), F (z + ...)  (Canudas de Wit et al. 1995,
    doi:10.1109/9.376053); Karnopp: all of the force at rest up to the static level (1985)

The static level is (S + J)/2, the sliding one (S - J)/2, as S and J are defined.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit

from stemwatch.models.recording import PERCENT, Floats, Recording, Role, Signal

STEP_S = 5e-4  # of the equations
ZERO_KPA, SPAN_KPA, SUPPLY_KPA, AIR_KPA = 20.0, 80.0, 140.0, 100.0
PILOT_KPA = 8.0  # error of the pressure at which the pilot is wide open
MOST_KP = 2.0


class Valve(NamedTuple):
    """The numbers of one valve: percent of travel, percent of spring force, seconds."""

    static: float
    sliding: float
    mass: float
    drag: float
    stribeck: float  # %/s
    bristle: float  # deflection at the static level; 0: Karnopp's friction
    fill_s: float
    vent_s: float
    volume: float  # dead volume over that of the stroke
    dead_s: float = 0.0
    zero: float = 0.0
    span: float = 1.0
    bow: float = 0.0
    push: float = 0.0
    push_at: float = 50.0
    push_wide: float = 20.0
    tight: float = 0.0
    tight_at: float = 50.0
    tight_wide: float = 7.0
    stop: float = 100.0
    uneven: float = 0.0
    grows: float = 0.0
    dwell: float = 0.0
    dwell_s: float = 5.0
    drift: float = 0.0
    play: float = 0.0
    inner: float = 0.0  # stiffness of a spring's inner friction, a share of the spring's
    inner_most: float = 1.0
    positioner_s: float = 0.0  # integral time of the positioner; 0: none
    positioner_band: float = 0.0


class Loop(NamedTuple):
    """The loop about the valve: a PI controller, its process, and a master where it has one."""

    gain: float
    reset_s: float
    process: float
    lag_s: float
    dead_s: float
    is_manual: bool
    is_cascade: bool


@njit(cache=True, fastmath=True)
def _flow(valve: Valve, asked: float, pressure: float) -> float:
    """Air through the pilot's orifices, kPa/s, by the command and the pressure behind them."""
    wide = PILOT_KPA / np.sqrt(80.0)
    wanted = min(max(ZERO_KPA + 0.01 * SPAN_KPA * asked, 0.0), SUPPLY_KPA)
    u = min(max((wanted - pressure) / PILOT_KPA, -1.0), 1.0)
    if u > 0.0:
        return u * wide / valve.fill_s * np.sqrt(max(SUPPLY_KPA - pressure, 0.0))
    return u * wide / valve.vent_s * np.sqrt(max(pressure, 0.0))


@njit(cache=True, fastmath=True)
def _levels(valve: Valve, x: float, part: float, rises: bool, rested: float) -> tuple[float, float]:
    """The static and the sliding level at a place, after a ``part`` of the record and a rest."""
    level = 1.0 + valve.grows * part
    if valve.tight != 0.0:
        level *= 1.0 + valve.tight * np.exp(-(((x - valve.tight_at) / valve.tight_wide) ** 2))
    level *= 1.0 + valve.uneven if rises else 1.0 - valve.uneven
    held = 1.0 + valve.dwell * np.log1p(rested / valve.dwell_s)
    return valve.static * level * held, valve.sliding * level


@njit(cache=True, fastmath=True)
def _friction(
    valve: Valve, levels: tuple[float, float], net: float, v: float, z: float
) -> tuple[float, float]:
    """Friction, and how far the bristles bend, by LuGre; or Karnopp's friction, without any."""
    static, sliding = levels
    level = static
    if abs(v) > 0.01 * valve.stribeck:
        level = sliding + (static - sliding) * np.exp(-((v / valve.stribeck) ** 2))
    if valve.bristle > 0.0:
        stiff = valve.static / valve.bristle
        damped = 0.6 * np.sqrt(stiff * valve.mass)
        bent = (z + STEP_S * v) / (1.0 + STEP_S * stiff * abs(v) / level)
        return stiff * bent + damped * (bent - z) / STEP_S, bent
    if v != 0.0:
        return (level if v > 0.0 else -level), z
    return min(max(net, -static), static), z


@njit(cache=True, fastmath=True)
def _reading(valve: Valve, lever: float, part: float) -> float:
    """What the transmitter reads of its lever, without noise."""
    reading = valve.zero + 50.0 + valve.span * (lever - 50.0)
    reading += valve.bow * (1.0 - (lever / 50.0 - 1.0) ** 2)
    return reading + valve.drift * np.sin(1.2 * np.pi * part)


@njit(cache=True, fastmath=True)
def _run(
    valve: Valve, loop: Loop, wanted: Floats, load: Floats, noise: Floats, interval_s: float
) -> Floats:
    """(n, 4) OP, reading, PV and place at every sample; ``wanted`` (n,) is the set point, or OP in
    manual.
    """
    n, steps = wanted.size, round(interval_s / STEP_S)
    out = np.empty((n, 4))
    x, v, z, pressure, op, integral, y = 50.0, 0.0, 0.0, 60.0, 50.0, 50.0, 50.0
    lever, rested, inner, reset, master = 50.0, 0.0, 0.0, 0.0, 50.0
    late = np.full(int(valve.dead_s / STEP_S) + 1, 50.0)
    behind = np.full(int(loop.dead_s / interval_s) + 1, 50.0)
    clock, swept = 0, 0.01 / (valve.volume + 0.5)
    for k in range(n):
        asked = wanted[k]
        if loop.is_cascade:
            master += 0.15 * interval_s / loop.reset_s * (wanted[k] - y - noise[k, 1])
            asked = master = min(max(master, 0.0), 100.0)
        op = wanted[k]
        if not loop.is_manual:
            error = asked - y - noise[k, 1]
            integral += loop.gain / loop.reset_s * error * interval_s
            integral = min(max(integral, 0.0), 100.0)
            op = min(max(loop.gain * error + integral, 0.0), 100.0)
        for _ in range(steps):
            late[clock] = op
            clock = clock + 1 if clock + 1 < late.size else 0
            asked = late[clock]
            if valve.positioner_s > 0.0:
                if abs(asked - x) > valve.positioner_band:
                    reset += STEP_S / valve.positioner_s * (asked - x)
                    reset = min(max(reset, -40.0), 40.0)
                asked = asked + reset
            gains = _flow(valve, asked, pressure) - (pressure + AIR_KPA) * swept * v
            pressure += STEP_S * gains / (1.0 + swept * (x - 50.0))
            inner += valve.inner * v * STEP_S
            inner = min(max(inner, -valve.inner_most), valve.inner_most)
            push = valve.push * np.exp(-(((x - valve.push_at) / valve.push_wide) ** 2))
            net = (pressure - ZERO_KPA) / (0.01 * SPAN_KPA) - x - push - inner
            levels = _levels(valve, x, k / n, v > 0.0 or (v == 0.0 and net > 0.0), rested)
            friction, z = _friction(valve, levels, net, v, z)
            went = v
            v += STEP_S * (net - friction) / valve.mass
            v /= 1.0 + STEP_S * valve.drag / valve.mass
            if valve.bristle == 0.0 and went * v < 0.0:
                v = 0.0
            x += STEP_S * v
            if x > valve.stop or x < 0.0:
                x, v = min(max(x, 0.0), valve.stop), 0.0
            rested = rested + STEP_S if abs(v) < 0.02 else 0.0
            lever = min(max(lever, x - 0.5 * valve.play), x + 0.5 * valve.play)
        behind[k % behind.size] = x
        delayed = behind[(k + 1) % behind.size]
        y += (1.0 - np.exp(-interval_s / loop.lag_s)) * (
            loop.process * (delayed - 50.0) + 50.0 + load[k] - y
        )
        out[k] = op, _reading(valve, lever, k / n) + noise[k, 0], y + noise[k, 1], x
    return out


Draw = Callable[[np.random.Generator], dict[str, float]]


def _either(rng: np.random.Generator, low: float, high: float) -> float:
    return float(rng.choice((-1.0, 1.0)) * rng.uniform(low, high))


# What is hidden, by the name of the catalogue, and how large it is.
EFFECTS: dict[str, Draw] = {
    "actuator_lag": lambda rng: dict.fromkeys(("fill_s", "vent_s"), rng.uniform(2.0, 6.0)),
    "asymmetric_lag": lambda rng: {"fill_s": 0.3, "vent_s": rng.uniform(4.0, 9.0)},
    "dead_time": lambda rng: {"dead_s": rng.uniform(3.0, 8.0)},
    "zero_shift": lambda rng: {"zero": _either(rng, 2.0, 5.0)},
    "span_error": lambda rng: {"span": 1.0 + _either(rng, 0.06, 0.15)},
    "flow_force": lambda rng: {
        "push": _either(rng, 3.0, 7.0),
        "push_at": rng.uniform(35.0, 65.0),
        "push_wide": rng.uniform(12.0, 25.0),
    },
    "position_dependent_friction": lambda rng: {
        "tight": rng.uniform(0.6, 1.5),
        "tight_at": rng.uniform(40.0, 60.0),
        "tight_wide": rng.uniform(5.0, 10.0),
    },
    "travel_stop": lambda rng: {"stop": rng.uniform(56.0, 64.0)},
    "sensor_drift": lambda rng: {"drift": _either(rng, 1.5, 4.0)},
    "growing_stiction": lambda rng: {"grows": rng.uniform(0.6, 1.2)},
    "dwell_dependent_breakaway": lambda rng: {"dwell": rng.uniform(0.1, 0.25)},
    "viscous_drag": lambda rng: {"drag": rng.uniform(2.5, 7.0)},
    "lost_motion": lambda rng: {"play": rng.uniform(1.0, 2.5)},
    "asymmetric_slip": lambda rng: {"uneven": _either(rng, 0.25, 0.5)},
    "bowed_linkage": lambda rng: {"bow": _either(rng, 4.0, 8.0)},
    "spring_hysteresis": lambda rng: {
        "inner": rng.uniform(0.15, 0.35),
        "inner_most": rng.uniform(1.0, 2.5),
    },
}
NOTHING, UNKNOWN = "nothing", "unknown"
INTERVALS_S = (0.5, 1.0, 1.0, 2.0, 5.0)


@dataclass(frozen=True)
class HandValve:
    """One simulated recording and the truth about it; ``S`` and ``J`` in percent of travel."""

    recording: Recording
    hidden: str
    S: float
    J: float
    bristles: bool
    positioner: bool
    loop: str
    interval_s: float
    noise: float
    step: float
    place: Floats


def draw_hand_valve(hidden: str, seed: int) -> HandValve:
    """A valve with one effect of ``EFFECTS``, or ``nothing``, with everything else drawn."""
    rng = np.random.default_rng((seed, sorted((*EFFECTS, NOTHING)).index(hidden)))
    S = rng.uniform(2.0, 6.5)
    J = S * rng.uniform(0.15, 0.6)
    bristles = bool(rng.random() < 0.5)
    valve = Valve(
        static=0.5 * (S + J),
        sliding=0.5 * (S - J),
        mass=rng.uniform(0.5, 1.5) / 100.0**2,
        drag=rng.uniform(0.012, 0.03),
        stribeck=10.0 ** rng.uniform(-0.7, 0.0),
        bristle=rng.uniform(0.03, 0.1) if bristles else 0.0,
        fill_s=0.15,
        vent_s=0.15,
        volume=rng.uniform(0.5, 1.2),
    )
    if rng.random() < 0.25:
        valve = valve._replace(positioner_s=rng.uniform(15.0, 60.0), positioner_band=0.6 * S)
    if hidden != NOTHING:
        valve = valve._replace(**EFFECTS[hidden](rng))
    interval_s = float(rng.choice(INTERVALS_S))
    n = int(3600.0 * (1.0 if interval_s <= 1.0 else 1.5 if interval_s <= 2.0 else 2.0) / interval_s)
    kind = str(rng.choice(("closed", "closed", "manual", "cascade")))
    loop = _loop(rng, valve, interval_s, kind)
    if kind == "manual":
        wanted = _by_hand(rng, n, interval_s)
    else:
        wanted = _set_points(rng, n, interval_s, 600.0 if kind == "cascade" else 250.0)
    noise = np.column_stack(
        (rng.normal(size=n) * 10.0 ** rng.uniform(-1.7, -0.7), rng.normal(size=n))
    )
    noise[:, 1] *= rng.uniform(0.02, 0.2)
    run = _run(valve, loop, wanted, _load(rng, n, interval_s), noise, interval_s)
    step = float(rng.choice((0.0, 0.05, 0.1)))
    reading = np.round(run[:, 1] / step) * step if step else run[:, 1]
    signals = {
        Role.OP: np.round(run[:, 0], 2),
        Role.MV: np.round(reading, 3),
        Role.PV: np.round(run[:, 2], 3),
    }
    if kind == "closed":
        signals[Role.SP] = np.round(wanted, 3)
    return HandValve(
        recording=Recording(
            valve=hidden,
            signals={
                role: Signal.good(values, role.value, unit=PERCENT)
                for role, values in signals.items()
            },
            interval_s=interval_s,
        ),
        hidden=hidden,
        S=S,
        J=J,
        bristles=bristles,
        positioner=valve.positioner_s > 0.0,
        loop=kind,
        interval_s=interval_s,
        noise=float(np.std(noise[:, 0])),
        step=step,
        place=run[:, 3],
    )


def _loop(rng: np.random.Generator, valve: Valve, interval_s: float, kind: str) -> Loop:
    """A process and a controller that is tuned to it and to the valve (SIMC, Skogestad 2003)."""
    lag_s, dead_s, process = rng.uniform(5.0, 25.0), rng.uniform(1.0, 4.0), rng.uniform(0.7, 1.4)
    slow = dead_s + valve.dead_s + max(valve.fill_s, valve.vent_s) + 0.5 * interval_s
    softness = rng.uniform(1.5, 3.0)
    return Loop(
        gain=min(lag_s / (process * (softness + 1.0) * slow), MOST_KP),
        reset_s=max(min(lag_s, 4.0 * (softness + 1.0) * slow), 5.0),
        process=process,
        lag_s=lag_s,
        dead_s=dead_s,
        is_manual=kind == "manual",
        is_cascade=kind == "cascade",
    )


def _set_points(rng: np.random.Generator, n: int, interval_s: float, apart_s: float) -> Floats:
    """Set points of 100 s and more, within 18 % of mid-range."""
    wanted, k = np.full(n, 50.0), 0
    while k < n:
        end = k + int(rng.uniform(0.4, 1.6) * apart_s / interval_s)
        wanted[k:end] = 50.0 + rng.uniform(-18.0, 18.0)
        k = end
    return wanted


def _by_hand(rng: np.random.Generator, n: int, interval_s: float) -> Floats:
    """OP by hand: steps, ramps and holds."""
    wanted, k, last = np.full(n, 50.0), 0, 50.0
    while k < n:
        end = min(k + int(rng.uniform(40.0, 200.0) / interval_s), n)
        kind, to = rng.integers(3), rng.uniform(20.0, 80.0)
        wanted[k:end] = np.linspace(last, to, end - k) if kind == 0 else to if kind == 1 else last
        last, k = wanted[end - 1], end
    return wanted


def _load(rng: np.random.Generator, n: int, interval_s: float) -> Floats:
    """A load that wanders with a memory of 200 s, by 0.4 to 1.8 % of PV."""
    keep, size = np.exp(-interval_s / 200.0), 1.2 * rng.uniform(0.3, 1.5)
    kicks, load = rng.normal(size=n) * size * np.sqrt(1.0 - keep**2), np.zeros(n)
    for k in range(1, n):
        load[k] = keep * load[k - 1] + kicks[k]
    return load
