"""Control loops with a valve that sticks or does not, by another hand than `models.studies.loops`.

Loops of seven kinds in seconds and percent, each with its own lags, samples and controller: flow
with a noisy sensor, pressure, level held tight or loosely, temperature, concentration with a long
delay, pH with a bent gain. The controller is of one of three vendors' forms. The stem that sticks
is one of three: dry friction with a slip that takes time, Kano's element of 2004 (docs/models.md),
and that of He, Wang, Pottmann and Qin (2007), doi:10.1021/ie0609280. Sound loops swing by tight
tuning, outer waves, a sensor with play, loads and set points. One record of four is centred, half
of these scaled, as in the stiction data base. No code is shared with what the networks were
trained on.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.signal import lfilter

from stemwatch.models.recording import PERCENT, Floats, Recording, Role, Signal

SLIP, KANO, HE = 0, 1, 2  # kinds of stem
PARALLEL, RESET_FEEDBACK, VELOCITY = 0, 1, 2  # forms of controller
FEWEST_BREAKAWAYS = 4
CAUSES = {  # why a loop swings, and its share: of loops that stick, of sound ones
    True: {"nothing else": 0.36, "wave": 0.16, "load": 0.16, "set point": 0.14, "wandering": 0.18},
    False: {
        "tight": 0.18,
        "wave": 0.25,
        "sensor with play": 0.08,
        "coarse PV": 0.06,
        "noise": 0.09,
        "load": 0.11,
        "set point": 0.10,
        "wandering": 0.13,
    },
}


@dataclass(frozen=True, kw_only=True)
class Loop:
    """A recording and what is hidden: ``S`` in the record's unit of OP, 0 for a sound stem."""

    kind: str
    cause: str
    S: float
    recording: Recording


class Kind(NamedTuple):
    """Ranges of one kind of loop, in seconds: lag or integration time, second lag, delay, air lag,
    sensor lag; the archive's intervals; shares of integrating and of bent (pH) ones."""

    share: float
    lag: tuple[float, float]
    second: tuple[float, float]
    delay: tuple[float, float]
    air: tuple[float, float]
    sensor: tuple[float, float]
    intervals: tuple[float, ...]
    integrating: float = 0.0
    bent: float = 0.0


KINDS = {
    "flow": Kind(0.28, (0.4, 6), (0.1, 1), (0.2, 2.5), (0.3, 4), (0.1, 2), (1, 1, 1, 2, 5, 10, 12)),
    "pressure": Kind(0.14, (5, 80), (0.5, 6), (0.5, 6), (0.5, 5), (0.1, 2), (1, 1, 2, 5, 10), 0.3),
    "tight level": Kind(
        0.12, (20, 300), (1, 10), (0.5, 10), (0.5, 5), (0.5, 15), (1, 2, 5, 10, 20), 1.0
    ),
    "loose level": Kind(
        0.10, (100, 1500), (2, 30), (1, 20), (0.5, 8), (0.5, 15), (5, 10, 12, 30, 60), 1.0
    ),
    "temperature": Kind(
        0.16, (60, 900), (10, 300), (8, 120), (1, 8), (0.5, 15), (10, 10, 20, 30, 60)
    ),
    "concentration": Kind(
        0.12, (3, 30), (0.5, 5), (3, 40), (0.5, 4), (0.5, 15), (0.2, 1, 1, 5, 12)
    ),
    "pH": Kind(0.08, (15, 150), (2, 20), (2, 25), (0.5, 4), (0.5, 15), (1, 2, 5, 10), 0.0, 1.0),
}


class Numbers(NamedTuple):
    """What the kernel needs: times in seconds, all else in percent. ``step`` is its step, of which
    ``steps`` make a sample and ``scan`` a scan of the controller; ``delay`` in steps."""

    step: float
    steps: int
    scan: int
    gain: float  # of the process
    lag: float
    second: float
    sensor: float
    air: float
    delay: int
    integrating: bool
    most: float  # deviation of PV that a bent process tends to, 0: not bent
    opening: float  # how the flow bends with travel
    start: float  # OP at rest
    stem: int
    static: float
    sliding: float
    slip: float
    form: int
    gain_of_controller: float
    reset: float
    filtered: float
    gap: float
    rate: float  # most change of OP, percent per second
    op_step: float
    half_play: float


@njit(cache=True)
def _acted(numbers, error, rise, op, integral, slot):
    """OP and the integral part after a scan of ``slot`` seconds, at this error and this rise of PV
    since the last scan."""
    if abs(error) < numbers.gap:
        error = 0.0
    pushed = numbers.gain_of_controller * error
    if numbers.form == PARALLEL:
        integral += pushed * slot / numbers.reset
        wanted = integral + pushed
        integral += min(max(wanted, 0.0), 100.0) - wanted
    elif numbers.form == RESET_FEEDBACK:
        wanted = min(max(integral + pushed, 0.0), 100.0)
        integral += min(slot / numbers.reset, 1.0) * (wanted - integral)
    else:  # of changes, proportional to PV alone
        wanted = op + pushed * slot / numbers.reset - numbers.gain_of_controller * rise
    most = numbers.rate * slot
    return op + min(max(min(max(wanted, 0.0), 100.0) - op, -most), most), integral


@njit(cache=True)
def _stem_of_he(numbers, air, rise, x, left):
    """Stem, what is left of the force, and whether it moved: it stops after every move."""
    pressed = left + rise
    if abs(pressed) <= numbers.static:
        return x, pressed, False
    side = np.sign(pressed)
    return air - side * numbers.sliding, side * numbers.sliding, True


@njit(cache=True)
def _dry_stem(numbers, air, rise, x, side):
    """Stem, the side to which it moves (0 where it is stuck), and whether it broke away."""
    if numbers.stem == KANO and side * rise <= 0.0:
        side = 0.0
    broke = side == 0.0 and abs(air - x) > numbers.static
    if broke:
        side = np.sign(air - x)
    if side == 0.0:
        return x, side, broke
    beyond = side * (air - x) - numbers.sliding
    if numbers.stem == KANO:
        return x + side * beyond, side, broke
    if beyond <= 0.02 * max(numbers.sliding, 0.05):  # dry friction has brought it to rest
        return x, 0.0, broke
    return x + side * beyond * min(numbers.step / numbers.slip, 1.0), side, broke


@njit(cache=True)
def simulate(numbers, set_point, load, push, noise):
    """(n,) OP and PV at each sample and (n,) how often the stem had broken away. ``noise`` is that
    of each scan."""
    n, step, slot = set_point.size, numbers.step, numbers.scan * numbers.step
    op_read, pv_read, broken = np.empty(n), np.empty(n), np.empty(n)
    late, at = np.zeros(numbers.delay + 1), 0
    inner = second = sensed = indicated = heard = side = left = breakaways = 0.0
    op = air = x = integral = numbers.start
    a_filter = slot / max(numbers.filtered, slot)
    for i in range(n * numbers.steps):
        k, scan = i // numbers.steps, i // numbers.scan
        if i % numbers.scan == 0:
            rise = a_filter * (indicated + noise[scan] - heard)
            heard += rise
            op, integral = _acted(numbers, set_point[k] - heard, rise, op, integral, slot)
        command = op
        if numbers.op_step > 0.0:
            command = round(op / numbers.op_step) * numbers.op_step
        rise = step / max(numbers.air, step) * (command - air)
        air += rise
        if numbers.stem == HE:
            x, left, broke = _stem_of_he(numbers, air, rise, x, left)
        else:
            x, side, broke = _dry_stem(numbers, air, rise, x, side)
        breakaways += broke
        flow = x - numbers.start
        if numbers.opening != 0.0:
            flow = 100.0 / numbers.opening * (np.exp(numbers.opening * flow / 100.0) - 1.0)
        late[at] = flow
        at = (at + 1) % late.size
        entering = late[at] + load[k]
        if numbers.integrating:
            inner += step / numbers.lag * (entering - 0.02 * inner)
        else:
            inner += step / max(numbers.lag, step) * (entering - inner)
        second += step / max(numbers.second, step) * (inner - second)
        true = numbers.gain * second
        if numbers.most > 0.0:
            true = numbers.most * np.tanh(true / numbers.most)
        sensed += step / max(numbers.sensor, step) * (true + push[k] - sensed)
        indicated = min(max(indicated, sensed - numbers.half_play), sensed + numbers.half_play)
        if (i + 1) % numbers.steps == 0:
            op_read[k], pv_read[k], broken[k] = command, indicated + noise[scan], breakaways
    return op_read, pv_read, broken


def draw(seed: int, number: int) -> Loop:
    """Loop ``number`` of a seed; every other one sticks."""
    rng = np.random.default_rng([seed, number])
    for _ in range(60):
        loop = _Draw(rng, sticks=number % 2 == 0).loop()
        if loop is not None:
            return loop
    raise RuntimeError(f"no loop {number} of seed {seed} that can be recorded")


class _Draw:
    """One loop as it is drawn, step by step."""

    def __init__(self, rng: np.random.Generator, *, sticks: bool) -> None:
        self.rng, self.sticks = rng, sticks
        self.name = str(rng.choice(list(KINDS), p=[kind.share for kind in KINDS.values()]))
        self.kind = KINDS[self.name]
        causes = CAUSES[sticks]
        self.cause = str(rng.choice(list(causes), p=list(causes.values())))
        self.interval = float(rng.choice(self.kind.intervals))
        self.samples = int(self.between(350.0, 3000.0))
        self.size = self.between(0.15, 4.0)  # of what disturbs, percent of OP

    def between(self, low: float, high: float) -> float:
        return float(np.exp(self.rng.uniform(np.log(low), np.log(high))))

    def happens(self, share: float) -> bool:
        return bool(self.rng.random() < share)

    def loop(self) -> Loop | None:
        """The loop; ``None`` where nobody would record it: OP at its limits or still, PV without
        bounds, or a stem that hardly ever breaks away."""
        numbers, swing = self._numbers()
        set_point, load, push = self._outside(numbers, swing)
        noise = self._noise(numbers)
        op, pv, broken = simulate(numbers, set_point, load, push, noise)
        start = self.samples // 10
        op, pv, set_point, broken = (a[start:] for a in (op, pv, set_point, broken))
        at_limit = max(np.mean(op <= 0.0), np.mean(op >= 100.0))
        if not np.isfinite(pv).all() or at_limit > 0.1 or np.ptp(op) < 0.3 or np.std(op) > 25.0:
            return None
        if self.sticks and broken[-1] - broken[0] < FEWEST_BREAKAWAYS:
            return None
        S = numbers.static + numbers.sliding if self.sticks else 0.0
        return self._recorded(op, self._stored(pv), set_point, S)

    def _numbers(self) -> tuple[Numbers, float]:
        """The numbers of the loop, and its own period in seconds."""
        between, kind, rng = self.between, self.kind, self.rng
        lag, second, delay = between(*kind.lag), between(*kind.second), between(*kind.delay)
        air, sensor = between(*kind.air), between(*kind.sensor)
        second = min(second, 0.6 * lag)
        gain, integrating = between(0.3, 2.5), self.happens(kind.integrating)
        filtered = 0.2 * (second + delay) * between(0.3, 3.0) if self.happens(0.5) else 0.0

        def process(w: Floats) -> Floats:
            lags = np.prod(
                [1.0 + 1j * w * each for each in (air, second, sensor, filtered)], axis=0
            )
            last = 1j * w * lag + (0.02 if integrating else 1.0)
            return np.asarray(gain * np.exp(-1j * w * delay) / lags / last)

        tuned_as = (
            "tight"
            if self.cause == "tight"
            else rng.choice(["usual", "sluggish", "tight"], p=[0.55, 0.25, 0.2])
        )
        if self.name == "loose level" and self.happens(0.7):
            tuned_as = "sluggish"
        quickest = delay + air + second
        w = np.geomspace(0.01 / (lag + quickest), 60.0 / quickest, 3000)
        _, own = _at_the_edge(process, w)
        reset = own * between(0.5, 3.0)
        if self.name == "loose level":
            reset = own * between(3.0, 20.0)
        elif self.happens(0.4):
            reset = own * between(1.0, 8.0) if integrating else lag * between(0.5, 1.5)
        edge, swing = _at_the_edge(lambda w: process(w) * (1.0 + 1.0 / (1j * w * reset)), w)
        margins = {"usual": (2.0, 4.5), "sluggish": (4.0, 12.0), "tight": (1.02, 1.6)}
        margin = rng.uniform(*margins[str(tuned_as)])

        finest = min(0.08 * swing, self.interval, 0.5 * max(air, 0.2))
        steps = int(min(np.ceil(self.interval / finest), 120.0))
        step = self.interval / steps
        scan_s = min(float(rng.choice([0.25, 0.5, 1.0, 2.0, 5.0])), 0.12 * swing)
        S = between(1.0, 8.0) if self.sticks else between(0.03, 0.6)
        J = S * float(rng.choice([rng.uniform(0.0, 0.3), rng.uniform(0.3, 1.0), 0.95]))
        has_play = self.cause == "sensor with play"
        numbers = Numbers(
            step=step,
            steps=steps,
            scan=max(1, round(scan_s / step)),
            gain=gain,
            lag=lag,
            second=second,
            sensor=sensor,
            air=air,
            delay=round(delay / step),
            integrating=integrating,
            most=between(1.5, 8.0) if self.happens(kind.bent) else 0.0,
            opening=float(rng.uniform(-2.0, 3.0)) if self.happens(0.5) else 0.0,
            start=float(rng.uniform(20.0, 80.0)),
            stem=int(rng.choice([SLIP, SLIP, KANO, HE])),
            static=0.5 * (S + J),
            sliding=0.5 * (S - J),
            slip=between(0.05, 1.5),
            form=int(rng.integers(3)),
            gain_of_controller=edge / margin,
            reset=reset,
            filtered=filtered,
            gap=gain * between(0.05, 0.4) if self.happens(0.12) else 0.0,
            rate=between(0.5, 5.0) if self.name != "flow" and self.happens(0.25) else 1e9,
            op_step=float(rng.choice([0.0, 0.0, 0.0, 0.1, 0.025])),
            half_play=0.5 * gain * between(0.3, 2.5) if has_play else 0.0,
        )
        return numbers, swing * (1.0 if tuned_as == "tight" else 1.6)

    def _outside(self, numbers: Numbers, swing: float) -> tuple[Floats, Floats, Floats]:
        """(n,) set point, load at the process's input, and push on PV itself."""
        n, size = self.samples, self.size
        time = self.interval * np.arange(n)
        set_point, push = np.zeros(n), np.zeros(n)
        wandering = {"wandering": 1.0, "noise": 0.1}.get(self.cause, 0.25)
        load = wandering * size * self._wandering(swing)
        if self.cause == "load" or self.happens(0.12):
            load += 1.5 * size * self._steps(time, swing * self.between(2.0, 10.0), swing)
            load = np.clip(load, -25.0, 25.0)
        period = max(swing * self.between(0.6, 6.0), 5.0 * self.interval)
        if (self.cause == "wave" or self.happens(0.05)) and 5.0 * period < time[-1]:
            wave = 1.5 * size * self._wave(period)
            load, push = (load + wave, push) if self.happens(0.7) else (load, push + wave)
        moved = numbers.gain * size
        if self.cause == "set point" or (
            self.name in ("flow", "temperature") and self.happens(0.2)
        ):
            if self.name != "flow" or self.happens(0.5):
                set_point += 1.7 * moved * self._steps(time, swing * self.between(3.0, 12.0), swing)
            else:  # by an outer controller, which acts at every third sample
                led = 1.2 * moved * self._coloured(swing * self.between(2.0, 8.0))
                set_point += np.repeat(led[::3], 3)[:n]
        return set_point, load, push

    def _coloured(self, time: float) -> Floats:
        """(n,) noise of unit variance with this correlation time."""
        pole = float(np.exp(-self.interval / max(time, 0.3 * self.interval)))
        drawn = self.rng.standard_normal(self.samples) * np.sqrt(1.0 - pole**2)
        return np.asarray(lfilter([1.0], [1.0, -pole], drawn))

    def _wandering(self, swing: float) -> Floats:
        """(n,) about unit size: slow, without bounds, within a band, or fast and slow."""
        colour = self.rng.integers(4)
        if colour == 0:
            return self._coloured(swing * self.between(0.3, 4.0))
        if colour == 1:
            walk = np.cumsum(self.rng.standard_normal(self.samples))
            first = walk[: max(int(4.0 * swing / self.interval), 20)]
            return np.asarray(np.clip(walk / max(float(np.std(first)), 1e-9), -6.0, 6.0))
        if colour == 2:
            return self._coloured(0.3 * swing) - self._coloured(5.0 * swing)
        return 0.7 * (self._coloured(0.5 * swing) + self._coloured(6.0 * swing))

    def _steps(self, time: Floats, mean_gap: float, least_gap: float) -> Floats:
        """(n,) the sum of steps of unit size at random times."""
        values, at = np.zeros(time.size), 0.0
        while (at := at + self.rng.exponential(mean_gap) + 0.5 * least_gap) < time[-1]:
            values[time >= at] += self.rng.standard_normal()
        return values

    def _wave(self, period: float) -> Floats:
        """(n,) a sine, one with overtones, nearly a square, a triangle, or a relay's swing."""
        rng = self.rng
        pace = 1.0 + float(rng.choice([0.0, 0.03, 0.1])) * self._coloured(3.0 * period)
        phase = 2.0 * np.pi * np.cumsum(self.interval / period * pace) + rng.uniform(0.0, 6.0)
        sine = np.sin(phase)
        shape = rng.integers(5)
        if shape == 1:
            sine = (
                sine + 0.3 * np.sin(2.0 * phase + rng.uniform(0.0, 6.0)) + 0.2 * np.sin(3 * phase)
            )
        elif shape == 2:
            sine = np.tanh(4.0 * sine)
        elif shape == 3:
            sine = 2.4 / np.pi * np.arcsin(sine)
        elif shape == 4:
            quarter = 0.25 * period / self.interval
            sine = 1.5 * _lagged(np.sign(sine), quarter)
        if self.happens(0.3):
            sine = sine * np.clip(0.5 + self._coloured(6.0 * period), 0.0, 2.0)
        return np.asarray(sine)

    def _noise(self, numbers: Numbers) -> Floats:
        """(scans,) noise of the sensor; of half of the flow loops that of turbulence."""
        scans = self.samples * numbers.steps // numbers.scan + 2
        values = self.rng.standard_normal(scans)
        if self.name == "flow" and self.happens(0.5):
            values = lfilter([1.0], [1.0, -1.2, 0.5], values)
            values /= np.std(values)
        size = numbers.gain * max(self.size, 0.3) * self.between(0.01, 0.5)
        size *= 1.5 if self.name == "flow" else 0.6
        size *= {"noise": 3.0, "nothing else": 0.5, "tight": 0.5}.get(self.cause, 1.0)
        if numbers.filtered == 0.0:  # nobody leaves a loop in which noise moves OP that much
            size = min(size, 6.0 / numbers.gain_of_controller)
        return np.asarray(size * values)

    def _stored(self, pv: Floats) -> Floats:
        """PV as an archive keeps it: in steps, and now and then only what differs enough."""
        span = max(float(np.ptp(pv)), 1e-6)
        levels = self.rng.integers(4, 14) if self.cause == "coarse PV" else self.between(40, 2000)
        stored = np.round(pv / span * levels) * span / levels
        if self.happens(0.08):
            deviation, kept = 0.1 * float(np.std(stored)), stored[0]
            for k, value in enumerate(stored):
                kept = value if abs(value - kept) > deviation else kept
                stored[k] = kept
        return np.asarray(stored)

    def _recorded(self, op: Floats, pv: Floats, set_point: Floats, S: float) -> Loop:
        """In the plant's units, PV rising or falling with OP; or centred, of which half are scaled
        to unit size."""
        at, scale = self.rng.uniform(20.0, 80.0), self.between(0.05, 50.0)
        scale *= -1.0 if self.happens(0.3) else 1.0
        pv, set_point = scale * (at + pv), scale * (at + set_point)
        unit = PERCENT
        if self.happens(0.25):
            unit, middle = "", float(np.mean(pv))
            op, pv, set_point = op - np.mean(op), pv - middle, set_point - middle
            if self.happens(0.5):
                size_op, size_pv = float(np.std(op)), max(float(np.std(pv)), 1e-9)
                op, S = op / size_op, S / size_op
                pv, set_point = pv / size_pv, set_point / size_pv
        signals = {
            Role.OP: Signal.good(op, "OP", unit),
            Role.PV: Signal.good(pv, "PV"),
            Role.SP: Signal.good(set_point, "SP"),
        }
        recording = Recording(valve="LOOP", signals=signals, interval_s=self.interval)
        return Loop(kind=self.name, cause=self.cause, S=S, recording=recording)


def _lagged(values: Floats, lag: float) -> Floats:
    """(n,) ``values`` behind a first-order lag of so many samples."""
    pole = float(np.exp(-1.0 / lag))
    return np.asarray(lfilter([1.0 - pole], [1.0, -pole], values))


def _at_the_edge(response: Callable[[Floats], Floats], w: Floats) -> tuple[float, float]:
    """The controller's gain at which the loop just swings on, and its period in seconds."""
    answer = response(w)
    behind = np.unwrap(np.angle(answer)) <= -np.pi
    at = int(np.argmax(behind)) if behind.any() else w.size - 1
    return float(1.0 / abs(answer[at])), float(2.0 * np.pi / w[at])
