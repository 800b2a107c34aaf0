"""`explain` on simulated motors of many kinds: how many are named as drives, how far S is off.

    python tests/benchmarks/bench_other_motors.py [--motors N] [--seed N] [--json FILE]

Each recording is another motor that lifts a weight on an arm, recorded as in
`bench_servo_ladder.py`: sines, a sine of growing frequency, a slow rise and fall, a lift, 6 s each
with holes between. Gain, friction, lag, inertia, load, voltage limit, encoder, delay and sampling
are drawn anew for each. The simulator takes short steps of voltage, back EMF, gear friction that
drops with speed (Stribeck) and grows with the load; it shares no code with what is fitted.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numba import njit

from stemwatch.models.mismatch.explain import explain
from stemwatch.models.recording import Floats, Recording, Role, Signal

STEP_S = 0.0005
RUN_S, HOLE_S = 6.0, (2.0, 6.0)
GRAVITY = 9.81
TURN = 2.0 * np.pi
CLEAR_LOAD, NO_LOAD = 2.0, 0.5  # percent of a turn
LOADS = {"load_by_position", "flow_force", "span_error"}


@dataclass(frozen=True)
class Motor:
    """What is hidden. ``S`` and ``load`` in percent of a turn, S with the arm level on average."""

    S: float
    load: float
    lag_s: float
    run_up_s: float
    most_error: float  # percent of a turn, at which the voltage meets its limit
    per_second: float  # samples
    encoder: float  # percent of a turn


@dataclass(frozen=True)
class Found:
    """A motor, and what `explain` says of it."""

    motor: Motor
    finding: str
    names: tuple[str, ...]
    S: float | None
    low: float | None
    high: float | None


@njit(cache=True)
def _angle(command, steps, numbers, out):
    """The angle in rad at each sample; ``numbers``: stiffness in Nm/rad, most error in rad, damping
    in Nms/rad, inertia in kgm2, load, friction in Nm, its share of the load, its drop, delay in
    steps."""
    stiffness, most, damping, inertia, load, friction, of_load, drop, delay = numbers
    late = np.full(int(delay) + 1, command[0])
    x, v = command[0], 0.0
    for k in range(command.size):
        out[k] = x
        for _ in range(steps):
            late[:-1] = late[1:]
            late[-1] = x
            push = stiffness * min(max(command[k] - late[0], -most), most)
            pull = load * np.sin(x)
            dry = friction + of_load * abs(pull)
            dry *= 1.0 + drop * np.exp(-((v / 0.1) ** 2))
            net = push - pull - damping * v
            if v == 0.0 and abs(net) <= dry:
                continue
            way = np.sign(v) if v != 0.0 else np.sign(net)
            faster = v + STEP_S * (net - dry * way) / inertia
            v = 0.0 if v * faster < 0.0 else faster
            x += STEP_S * v


def draw(seed: int, number: int) -> tuple[Motor, Recording]:
    """Motor ``number`` of a seed, and its recording."""
    rng = np.random.default_rng([seed, number])

    def between(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    S, load, lag_s = between(0.08, 2.0), between(0.25, 7.0), between(0.03, 0.35)
    loaded = rng.random() >= 0.2
    arm_m, stiffness = float(rng.choice([0.1, 0.15, 0.2, 0.3])), rng.uniform(2.0, 40.0)
    inertia = load / 100.0 * TURN * stiffness * arm_m / GRAVITY * rng.uniform(1.0, 1.5)
    of_load = float(rng.choice([0.0, 0.0, 0.1, 0.2])) if loaded else 0.0
    pull = load / 100.0 * TURN * stiffness if loaded else 0.0
    dry = S / 200.0 * TURN * stiffness
    friction = max(dry - 0.5 * of_load * pull, 0.3 * dry)
    most = between(0.2, 2.0)
    damping = lag_s * stiffness
    per_second = float(rng.choice([50.0, 100.0, 100.0, 100.0, 200.0]))
    encoder = float(rng.choice([1024, 4096, 65536]))
    drop, delay = rng.uniform(0.0, 0.3), float(rng.integers(0, 20))
    numbers = np.array([stiffness, most, damping, inertia, pull, friction, of_load, drop, delay])
    recording = _recording(rng, numbers, per_second, encoder)
    motor = Motor(
        S=100.0 * 2.0 * (friction + 0.5 * of_load * pull) / stiffness / TURN,
        load=100.0 * pull / stiffness / TURN,
        lag_s=lag_s,
        run_up_s=inertia / damping,
        most_error=100.0 * most / TURN,
        per_second=per_second,
        encoder=100.0 / encoder,
    )
    return motor, recording


def _recording(
    rng: np.random.Generator, numbers: Floats, per_second: float, encoder: float
) -> Recording:
    """The runs one after the other, with holes; percent of a turn around 50 %."""
    t = np.arange(0.0, RUN_S, 1.0 / per_second)
    op, mv = [], []
    for command in _commands(rng, t):
        angle = np.empty(t.size)
        _angle(command, round(1.0 / per_second / STEP_S), numbers, angle)
        read = np.round(angle * encoder / TURN) * TURN / encoder
        hole = np.full(int(rng.uniform(*HOLE_S) * per_second), np.nan)
        op += [50.0 + 100.0 * command / TURN, hole]
        mv += [50.0 + 100.0 * read / TURN, hole]
    signals = {
        Role.OP: Signal.good(np.concatenate(op[:-1]), "M.OP"),
        Role.MV: Signal.good(np.concatenate(mv[:-1]), "M.ZT"),
    }
    return Recording(valve="M", signals=signals, interval_s=1.0 / per_second)


def _commands(rng: np.random.Generator, t: Floats) -> list[Floats]:
    """Two sines, a sine of growing frequency, a slow rise and fall, and a lift, in rad."""
    share = t / t[-1]
    quick = rng.uniform(0.2, 0.8) * np.sin(rng.uniform(2.0, 4.0) * t) * np.sin(t)
    sines = rng.uniform(0.5, 1.5) * np.sin(rng.uniform(0.8, 1.6) * t) + quick
    growing = rng.uniform(0.3, 1.0) * np.sin(rng.uniform(0.3, 0.9) * t**2)
    slow = 0.5 * rng.uniform(0.6, 1.6) * rng.choice([-1.0, 1.0]) * (1.0 - np.cos(TURN * share))
    lift = -0.5 * np.pi * np.minimum(share / 0.3, 1.0)
    return [sines, growing, slow, lift]


def found(seed: int, number: int) -> Found:
    """One motor, explained."""
    motor, recording = draw(seed, number)
    result = explain(recording)
    S = result.restated.S
    names = tuple(sorted("/".join(effect.members) for effect in result.effects))
    return Found(motor, result.finding.value, names, S.value, S.low, S.high)


def summary(rows: list[Found]) -> list[str]:
    """What is said of all motors, a line each."""
    drives = [row for row in rows if "motor_drive" in row.names]
    others = [row for row in rows if row not in drives]
    clear = [row for row in rows if row.motor.load >= CLEAR_LOAD]
    none = [row for row in rows if row.motor.load < NO_LOAD]

    def off(some: list[Found]) -> str:
        errors = [abs(row.S - row.motor.S) for row in some if row.S is not None]
        return f"{np.median(errors):.2f}" if errors else "-"

    def loaded(some: list[Found]) -> str:
        named = sum(any(LOADS & set(name.split("/")) for name in row.names) for row in some)
        return f"{named} of {len(some)}"

    held = sum(
        row.low is not None and row.high is not None and row.low <= row.motor.S <= row.high
        for row in rows
    )
    return [
        f"- {len(rows)} motors: {len(drives)} named as a drive, "
        f"{sum(row.finding == 'unknown' for row in rows)} unknown",
        f"- S off by {off(drives)} % of a turn (median) where a drive is named, {off(others)} "
        f"where none is; the interval holds it in {held} of {len(rows)}, "
        f"{sum(row.S is None for row in rows)} have no S but a reason",
        f"- a load of {CLEAR_LOAD:g} % and more is named in {loaded(clear)}, one below {NO_LOAD:g} "
        f"% in {loaded(none)}",
    ]


def main() -> None:
    """Draw, explain, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--motors", type=int, default=60)
    parser.add_argument("--seed", type=int, default=15)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    rows = [found(options.seed, number) for number in range(options.motors)]
    for row in rows:
        motor = row.motor
        at = f"{row.S:.2f} ({row.low:.2f} to {row.high:.2f})" if row.S is not None else "-"
        print(
            f"S {motor.S:.2f} load {motor.load:.2f} lag {motor.lag_s:.2f} s, run-up "
            f"{motor.run_up_s * motor.per_second:.1f} samples, limit {motor.most_error:.0f} %: "
            f"S {at}; {', '.join(row.names) or row.finding}"
        )
    print("\n".join(summary(rows)))
    if options.json:
        options.json.write_text(json.dumps([asdict(row) for row in rows], indent=1))


if __name__ == "__main__":
    main()
