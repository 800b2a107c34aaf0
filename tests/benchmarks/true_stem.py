"""The likelihood of a position reading by the simulated plant's own equations.

An observer who knows the valve's nameplate, its OP at every scan and how its position is read, but
not where the stem is nor how high its levels are. He follows the courses that the stem may have
taken: a stem at rest lets go where the force reaches the level that was drawn when it stopped,
``fs (1 + s e)`` with a normal ``e``, at least ``fd``, plus what dwell adds, and slides until the
force has fallen to ``fd``; play hides the first way after a turn. The readings decide between the
courses. What he cannot see in a record no method can.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import NamedTuple, Self

import numpy as np
from scipy.optimize import minimize

from stemwatch.models.compiled import compiled
from stemwatch.models.recording import Floats
from stemwatch.models.studies.simulator.hidden import HiddenCase
from stemwatch.models.studies.simulator.loop import PlantLoop
from stemwatch.models.studies.simulator.simulate import simulate_loop

FINE_S = 0.05  # seconds between two looks at the force; half a scan of the controllers
COURSES = 40
FS, FD, SCATTER, PLAY, DWELL, ZERO, NOISE = range(7)  # of the numbers that are sought
NUMBERS = 7
_X, _Z, _GOING, _RESTED, _ASKED, _WEIGHT = range(6)  # of a course
_POSITIVE = (FS, FD, SCATTER, NOISE)
_NEVER, _LEAST_ASKED, _HARDLY = -30.0, -6.0, -2.5  # deviations from the level
_SMALLEST, _IMPOSSIBLE = 1e-300, -1e9
_ALIKE_PLACE, _ALIKE_ASKED, _ALIKE_REST_S = 0.2, 0.1, 1.0  # of the noise, deviations, seconds
_LEAST_SHARE = 1e-7  # of the heaviest course
_OUTLIERS, _OUTLIER_PERCENT = 1e-4, 2.0
# A search: its scales (logarithms of levels, scatter and noise; percent), its reach and its length.
_SCALES = np.array([0.05, 0.05, 0.3, 0.1, 0.1, 0.1, 0.3])
_LEAST_SCATTER, _MOST_SCATTER = 0.005, 0.15  # of real stems, as ``explain`` has them
_LOOKS, _BEGUN_FROM = 150, 2
# With its breakaway level above the kinetic one a stem that is slower than some of its Stribeck
# speeds cannot slide: exp(-9) of J is left at three.
_SLOWEST_STRIBECK = 3.0
_SLOW, _MAY_STICK, _EVERY = 0.5, 0.05, 5  # percent/s, a probability, and in how many steps


@dataclass(frozen=True, kw_only=True)
class SeenValve:
    """What the observer is told of a valve: ``force`` (m,) of air against spring every ``FINE_S``,
    percent, the ``reading`` (n,) every ``fine_per_sample`` of these, NaN where none is, its coarse
    ``step`` (0 of a fine one), and the constants of the stem."""

    force: Floats
    reading: Floats
    start: float
    fine_per_sample: int
    step: float
    slide_s: float
    slowest: float  # percent/s
    dwell_s: float
    settles: bool

    @classmethod
    def of(cls, case: HiddenCase) -> Self:
        """The valve of a ``case``, read before an archive thins its readings."""
        loop = case.loop
        plain = replace(loop.archive, compression=())
        run = simulate_loop(replace(loop, archive=plain), case.seed)
        fine = replace(plain, interval_s=FINE_S, phase_s=0.0, frozen=(), gaps=(), bad=())
        output = simulate_loop(replace(loop, archive=fine), case.seed).output
        mv, actuator = run.recording.mv, loop.valve.actuator
        assert mv is not None
        return cls(
            force=_air(output, actuator.air_lag_s, actuator.dead_time_s),
            reading=np.asarray(mv.values, dtype=np.float64),
            start=float(run.reading[0]),
            fine_per_sample=round(loop.archive.interval_s / FINE_S),
            step=loop.transmitters.position_step,
            slide_s=actuator.viscous_s,
            slowest=_SLOWEST_STRIBECK * actuator.stribeck_percent_per_s,
            dwell_s=loop.valve.packing.dwell_s,
            settles=loop.valve.packing.dwell_settles,
        )

    def log_likelihood(self, numbers: Floats) -> float:
        """Of the readings, where the stem's ``numbers`` (7,) are these: both levels in percent of
        span, the scatter of the upper one as a share of it, play in percent of travel, dwell in
        percent, the reading's zero error and its noise in percent."""
        slide = self.slide_s
        stem = _Stem(
            *(float(number) for number in numbers[[FS, FD, SCATTER]]),
            0.5 * float(numbers[PLAY]),
            float(numbers[DWELL]),
            self.dwell_s,
            self.settles,
            1.0 - math.exp(-FINE_S / slide),
            self.slowest * slide,
            _SLOW * slide,
        )
        return float(
            _log_likelihood(
                stem,
                float(numbers[ZERO]),
                float(numbers[NOISE]),
                self.force,
                self.reading,
                self.start,
                self.fine_per_sample,
                self.step,
            )
        )

    def most_likely(self, starts: Iterable[Floats], free: Sequence[int]) -> tuple[float, Floats]:
        """The largest log likelihood that is found from ``starts`` with some numbers ``free``, and
        the numbers (7,) there (Nelder and Mead)."""
        begun = sorted(map(_within, starts), key=lambda at: -self.log_likelihood(at))[:_BEGUN_FROM]
        return max((self._climbed(at, free) for at in begun), key=lambda found: found[0])

    def _climbed(self, begun: Floats, free: Sequence[int]) -> tuple[float, Floats]:
        def moved(by: Floats) -> Floats:
            at = begun.copy()
            for place, step in zip(free, by, strict=True):
                scaled = _SCALES[place] * step
                at[place] = (
                    at[place] * math.exp(scaled) if place in _POSITIVE else at[place] + scaled
                )
            return _within(at)

        first = np.vstack((np.zeros(len(free)), np.eye(len(free))))
        options = {"maxfev": _LOOKS, "xatol": 0.02, "fatol": 0.2, "initial_simplex": first}
        found = minimize(
            lambda by: -self.log_likelihood(moved(by)),
            first[0],
            method="Nelder-Mead",
            options=options,
        )
        return -float(found.fun), moved(found.x)


def _within(numbers: Floats) -> Floats:
    """Numbers (7,) that a stem can have."""
    at = numbers.copy()
    at[SCATTER] = min(max(at[SCATTER], _LEAST_SCATTER), _MOST_SCATTER)
    at[[PLAY, DWELL]] = np.maximum(at[[PLAY, DWELL]], 0.0)
    at[FD] = min(max(at[FD], 0.02), at[FS])
    return at


def gain_of(case: HiddenCase, place: int) -> float:
    """By how much the record of a ``case`` is more likely with its play or dwell (``place`` among
    the numbers), begun at the truth, than at the best that is found without."""
    valve, truth = SeenValve.of(case), true_numbers(case.loop)
    free = (FS, FD, SCATTER, ZERO)
    return (
        valve.most_likely([truth], (*free, place))[0]
        - valve.most_likely(_without(truth, place, valve.settles), free)[0]
    )


def _without(truth: Floats, place: int, settles: bool) -> list[Floats]:
    """Numbers (7,) that make up for what they lack: without play both levels are higher and the
    breakaways scatter; without dwell the breakaway level is as high as after the usual rest."""
    size, starts = float(truth[place]), []
    of_levels = (
        product((-1.0, -0.5, 0.0, 0.5, 1.0, 1.5, 2.0), (0.0, 0.5, 1.0))
        if place == PLAY
        else product((0.25, 0.5, 0.75) if settles else (0.5, 1.0, 1.5, 2.0, 3.0), (0.0,))
    )
    for (of_fs, of_fd), wider in product(of_levels, (1.0, 2.5)):
        at = truth.copy()
        at[place] = 0.0
        at[FS] += of_fs * size
        at[FD] += of_fd * size
        at[SCATTER] *= wider
        if at[FS] > at[FD]:
            starts.append(at)
    return starts


def true_numbers(loop: PlantLoop) -> Floats:
    """(7,) the numbers of a simulated valve."""
    valve = loop.valve
    return np.array(
        [
            0.5 * (valve.S + valve.J),
            0.5 * (valve.S - valve.J),
            valve.scatter,
            loop.transmitters.position_play,
            valve.packing.dwell_percent,
            loop.transmitters.position_zero,
            loop.transmitters.position_noise,
        ]
    )


def _air(output: Floats, lag_s: float, dead_time_s: float) -> Floats:
    """(m,) what the chamber's pressure asks for, percent: OP (m,) later and through a lag."""
    late = round(dead_time_s / FINE_S)
    command = np.concatenate((np.full(late + 1, output[0]), output))[: output.size]
    return np.asarray(_lagged(command, 1.0 - math.exp(-FINE_S / max(lag_s, 1e-6))))


@compiled()
def _lagged(command: Floats, share: float) -> Floats:
    lagged, pressure = np.empty_like(command), command[0]
    for i in range(command.size):
        pressure += share * (command[i] - pressure)
        lagged[i] = pressure
    return lagged


@compiled()
def _above(z: float) -> float:
    return 0.5 * math.erfc(z / 1.4142135623730951)


@compiled()
def _density(off: float, step: float, noise: float) -> float:
    """Of a reading that is ``off``, or its probability where readings come in a ``step``."""
    if step > 0.0:
        near, far = (off - 0.5 * step) / noise, (off + 0.5 * step) / noise
        within, wide = _above(near) - _above(far), step / (2.0 * _OUTLIER_PERCENT)
    else:
        u = off / noise
        within = math.exp(-0.5 * u * u) / (noise * math.sqrt(2.0 * math.pi))
        wide = 1.0 / (2.0 * _OUTLIER_PERCENT)
    return (1.0 - _OUTLIERS) * within + _OUTLIERS * wide


@compiled()
def _grown(dwell: float, rested: float, dwell_s: float, settles: bool) -> float:
    """What a rest of ``rested`` seconds has added to the level."""
    if dwell == 0.0:
        return 0.0
    if settles:
        return dwell * (1.0 - math.exp(-rested / dwell_s))
    return dwell * math.log(1.0 + rested / dwell_s)


@compiled(inline="always")
def _copy(courses: Floats, to: int, c: int, share: float) -> None:
    """Copy course ``c`` with a ``share`` of its weight."""
    for k in range(_WEIGHT):
        courses[to, k] = courses[c, k]
    courses[to, _WEIGHT] = share * courses[c, _WEIGHT]


@compiled(inline="always")
def _stop(courses: Floats, c: int) -> None:
    """Let a course come to rest, at a level that is drawn anew."""
    courses[c, _GOING], courses[c, _RESTED], courses[c, _ASKED] = 0.0, 0.0, _NEVER


@compiled(inline="always")
def _read(courses: Floats, c: int, half: float) -> None:
    """Let the reading of a course follow its stem, by ``half`` the play behind it."""
    x = courses[c, _X]
    courses[c, _Z] = min(max(courses[c, _Z], x - half), x + half)


@compiled(inline="always")
def _alike(courses: Floats, c: int, j: int, place: float, rest_s: float) -> bool:
    """Whether two courses have become one, within a ``place`` and ``rest_s`` of rest."""
    return (
        courses[c, _GOING] == courses[j, _GOING]
        and abs(courses[c, _X] - courses[j, _X]) < place
        and abs(courses[c, _Z] - courses[j, _Z]) < place
        and abs(max(courses[c, _ASKED], _HARDLY) - max(courses[j, _ASKED], _HARDLY)) < _ALIKE_ASKED
        and abs(courses[c, _RESTED] - courses[j, _RESTED]) < rest_s
    )


@compiled()
def _joined(courses: Floats, count: int, place: float, rest_s: float) -> int:
    """Join courses that have become alike to the heavier one, and keep the heaviest, whose weights
    then sum to one; returns how many there are."""
    heaviest = 0.0
    for j in range(count):
        heaviest = max(heaviest, courses[j, _WEIGHT])
    kept = 0
    for j in range(count):
        weight = courses[j, _WEIGHT]
        if weight <= _LEAST_SHARE * heaviest:
            continue
        c = 0
        while c < kept and not _alike(courses, c, j, place, rest_s):
            c += 1
        if c == kept:
            _copy(courses, c, j, 1.0)
            kept += 1
            continue
        weight += courses[c, _WEIGHT]
        if courses[j, _WEIGHT] > courses[c, _WEIGHT]:
            _copy(courses, c, j, 1.0)
        courses[c, _WEIGHT] = weight
    while kept > COURSES:
        lightest = 0
        for c in range(kept):
            lightest = c if courses[c, _WEIGHT] < courses[lightest, _WEIGHT] else lightest
        kept -= 1
        _copy(courses, lightest, kept, 1.0)
    return kept


class _Stem(NamedTuple):
    """A stem as the courses need it: levels and play in percent, the share of its gap that it
    covers in ``FINE_S``, and the gaps at which it sticks and may stick."""

    fs: float
    fd: float
    scatter: float
    half_play: float
    dwell: float
    dwell_s: float
    settles: bool
    share: float
    sticks_at: float
    may_stick_at: float


@compiled(inline="always")
def _slid(courses: Floats, c: int, count: int, p: float, stem: _Stem, may_stick: bool) -> int:
    """Move course ``c``, which slides; returns how many there are then."""
    x, going = courses[c, _X], courses[c, _GOING]
    gap = going * (p - x) - stem.fd
    if gap <= stem.sticks_at:
        _stop(courses, c)
        return count
    if may_stick and gap < stem.may_stick_at:
        # Within a step of this grid OP may have turned for a moment.
        _copy(courses, count, c, _MAY_STICK)
        _stop(courses, count)
        courses[c, _WEIGHT] *= 1.0 - _MAY_STICK
        count += 1
    courses[c, _X] = x + going * stem.share * gap
    _read(courses, c, stem.half_play)
    return count


@compiled(inline="always")
def _held(courses: Floats, c: int, count: int, p: float, stem: _Stem) -> int:
    """Let course ``c``, which rests, hold or let go; returns how many there are then."""
    courses[c, _RESTED] += FINE_S
    f, before = p - courses[c, _X], courses[c, _ASKED]
    asked = abs(f) - _grown(stem.dwell, courses[c, _RESTED], stem.dwell_s, stem.settles)
    u = (asked / stem.fs - 1.0) / stem.scatter
    if asked <= stem.fd or u <= max(before, _LEAST_ASKED):
        return count
    holds = _above(u) / max(_above(before), _SMALLEST)
    courses[c, _ASKED] = u
    _copy(courses, count, c, 1.0 - holds)
    side = 1.0 if f > 0.0 else -1.0
    courses[count, _GOING] = side
    courses[count, _X] += side * stem.share * (abs(f) - stem.fd)
    _read(courses, count, stem.half_play)
    courses[c, _WEIGHT] *= holds
    return count + 1


@compiled(inline="always")
def _weighed(courses: Floats, count: int, read: float, step: float, noise: float) -> float:
    """Weigh the courses by what was ``read``, NaN where nothing was; returns by how much less they
    weigh, and makes their weights sum to one."""
    summed = 0.0
    for c in range(count):
        if not np.isnan(read):
            courses[c, _WEIGHT] *= _density(abs(read - courses[c, _Z]), step, noise)
        summed += courses[c, _WEIGHT]
    for c in range(count):
        courses[c, _WEIGHT] /= max(summed, _SMALLEST)
    return summed


@compiled()
def _log_likelihood(
    stem: _Stem,
    zero: float,
    noise: float,
    force: Floats,
    reading: Floats,
    start: float,
    fine_per_sample: int,
    step: float,
) -> float:
    rest_s = _ALIKE_REST_S if stem.dwell != 0.0 else 1e9
    courses, count, total, at = np.zeros((8 * COURSES, 6)), 5, 0.0, 0
    for k in range(count):
        x = start - zero + 0.5 * (k - 2) * stem.half_play
        courses[k, _X] = min(max(x, force[0] - stem.fs), force[0] + stem.fs)
        courses[k, _Z], courses[k, _ASKED], courses[k, _WEIGHT] = start - zero, _NEVER, 0.2
    for i in range(reading.size):
        for j in range(fine_per_sample if i > 0 else 1):
            before = count
            for c in range(before):
                if courses[c, _GOING] != 0.0:
                    count = _slid(courses, c, count, force[at], stem, j % _EVERY == 0)
                else:
                    count = _held(courses, c, count, force[at], stem)
            at += 1
            if count > 2 * COURSES:
                count = _joined(courses, count, _ALIKE_PLACE * noise, rest_s)
        weight = _weighed(courses, count, reading[i] - zero, step, noise)
        if weight <= 0.0:
            return _IMPOSSIBLE
        total += math.log(weight)
        if count > 1:
            count = _joined(courses, count, _ALIKE_PLACE * noise, rest_s)
    return total
