"""``fit_loop``: one loop as a model that can be simulated, from its recording and its valve.

    OP = law(SP, PV) + rest          the controller, by its own law
    x  = stick-slip(OP; S, J, lags)  the valve, as it was fitted
    PV = process(x) + disturbance    the process, with what else moved PV

Rest and disturbance are kept and replayed: the unchanged model reproduces the recording, and a
changed one predicts the loop's behaviour on the same day.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from stemwatch.models.closed_loop import kernel
from stemwatch.models.closed_loop.controller_law import ControllerLaw, controller_law
from stemwatch.models.closed_loop.process_model import ProcessModel, process_model
from stemwatch.models.estimate import Estimate
from stemwatch.models.recording import Floats, Recording, Role
from stemwatch.models.signals.holes import bridged, longest_stretch

FEWEST_SAMPLES = 300
MOST_SAMPLES = 7200  # the last ones of a longer stretch
BRIDGED = 3  # samples of a hole that a straight line fills
REPLAYED = (0.5, 2.0)  # the variance of the unchanged simulation, over the recorded one
FREE = 1e6  # percent a sample: no speed limit
USUAL_SCATTER = 0.06  # of breakaways, as a share of their level: 5 to 12 % is normal
LARGEST_SCATTER = 2.5  # standard deviations
# Time constant of the actuator where the fit found none, samples: a sticking stem hides it. 0.05 to
# 1.5 s are usual, with a sample a second; a controller that scans several times within a sample
# looks like a longer one.
HIDDEN_LAG = 1.0
HIDDEN_LAGS = (0.1, 5.0)
TRIES = 4  # to draw a process with which the loop reproduces its own variance


@dataclass(frozen=True, kw_only=True)
class FittedValve:
    """S and J in percent of OP with the standard deviations of their estimates; times in seconds,
    speeds in percent a second; ``slope`` the position's percent for a percent of OP; ``scatter`` of
    its breakaways as a share of their level, ``noise`` of the position's reading in percent.
    ``hidden_lag_s`` is a lag that would show only without friction, where the fit found none.
    """

    S: float
    J: float
    S_spread: float = 0.0
    J_spread: float = 0.0
    dead_time_s: float = 0.0
    lag_up_s: float = 0.0
    lag_down_s: float = 0.0
    speed_up: float = FREE
    speed_down: float = FREE
    slope: float = 1.0
    scatter: float = USUAL_SCATTER
    noise: float = 0.0
    hidden_lag_s: float = HIDDEN_LAG

    @classmethod
    def of(
        cls, S: Estimate, J: Estimate, numbers: Mapping[str, float | None], slope: float = 1.0
    ) -> FittedValve | str:
        """The valve from the results of a screening: S, J and its indicators by name; or why there
        is none.
        """
        if S.value is None:
            return f"S is not known: {S.reason}"
        slow = {
            field: numbers[name]
            for field, name in _INDICATORS.items()
            if numbers.get(name) is not None
        }
        scatter = numbers.get("breakaway_scatter_percent")
        return cls(
            S=S.value,
            J=J.value or 0.0,
            S_spread=_spread(S),
            J_spread=_spread(J),
            slope=slope,
            scatter=USUAL_SCATTER if scatter is None else scatter / 100.0,
            noise=numbers.get("position_noise_percent") or 0.0,
            **slow,  # type: ignore[arg-type]  # those that are known
        )


_INDICATORS = {
    "dead_time_s": "dead_time_s",
    "lag_up_s": "lag_rising_s",
    "lag_down_s": "lag_falling_s",
    "speed_up": "speed_rising_percent_per_s",
    "speed_down": "speed_falling_percent_per_s",
}


def _spread(estimate: Estimate) -> float:
    """The standard deviation of an estimate with a 95 % interval."""
    if estimate.low is None or estimate.high is None:
        return 0.0
    return (estimate.high - estimate.low) / 3.92


@dataclass(frozen=True, kw_only=True)
class Knocker:
    """Pulses on OP in the direction of its last change, after Hagglund (2002,
    doi:10.1016/S0959-1524(01)00051-5): height in percent of OP, period and width in seconds."""

    height: float
    every_s: float
    for_s: float


@dataclass(frozen=True, kw_only=True)
class LoopRun:
    """OP and stem in percent of OP's and the position's span, PV and SP in PV's unit, (n,)."""

    op: Floats
    x: Floats
    pv: Floats
    sp: Floats
    interval_s: float


def _alike() -> Floats:
    return np.ones(1)


@dataclass(frozen=True, kw_only=True)
class FittedLoop:
    """The recorded signals of the fitted stretch, and the three parts of the loop; the
    ``breakaways`` (m,) are used in turn, each a multiple of (S + J)/2.
    """

    recorded: LoopRun
    unit: str
    law: ControllerLaw
    process: ProcessModel
    valve: FittedValve
    breakaways: Floats = field(default_factory=_alike)

    def run(
        self,
        valve: FittedValve | None = None,
        *,
        gain_times: float = 1.0,
        reset_times: float = 1.0,
        knocker: Knocker | None = None,
    ) -> LoopRun:
        """Simulate the same stretch with another ``valve``, controller gain or reset time, or with
        a knocker; without any of these, unchanged.
        """
        recorded, law, process = self.recorded, self.law, self.process
        valve = self.valve if valve is None else valve
        step_s = recorded.interval_s
        q = np.zeros(kernel.N_NUMBERS)
        q[kernel.GAIN_PV], q[kernel.GAIN_SP] = law.gain * gain_times, law.gain_sp * gain_times
        q[kernel.PER_SAMPLE] = law.per_sample * gain_times / reset_times
        q[kernel.GAIN_CHANGE] = law.gain_change * gain_times
        q[kernel.OP_LOW] = min(0.0, float(recorded.op.min()))
        q[kernel.OP_HIGH] = max(100.0, float(recorded.op.max()))
        q[kernel.S], q[kernel.J] = valve.S, valve.J
        q[kernel.VALVE_DELAY] = valve.dead_time_s / step_s
        q[kernel.VALVE_LAG_UP] = valve.lag_up_s / step_s
        q[kernel.VALVE_LAG_DOWN] = valve.lag_down_s / step_s
        q[kernel.VALVE_SPEED_UP] = valve.speed_up * step_s
        q[kernel.VALVE_SPEED_DOWN] = valve.speed_down * step_s
        q[kernel.PROCESS_GAIN] = process.gain * self.valve.slope
        q[kernel.PROCESS_LAG], q[kernel.SECOND_LAG] = process.lag, process.second_lag
        q[kernel.PROCESS_DELAY], q[kernel.INTEGRATES] = process.delay, float(process.integrates)
        if knocker is not None:
            q[kernel.KNOCK] = knocker.height
            q[kernel.KNOCK_EVERY] = max(round(knocker.every_s / step_s), 1)
            q[kernel.KNOCK_FOR] = max(round(knocker.for_s / step_s), 1)
        op, x, pv = (np.empty_like(recorded.op) for _ in range(3))
        # Another gain acts about the loop's operating point, not about 0.
        stands = float(np.mean(law.gain_sp * recorded.sp - law.gain * recorded.pv))
        rest = law.rest + (1.0 - gain_times) * stands
        zero = self._zero()
        begin = np.array([recorded.op[0], (recorded.x[0] - zero) / self.valve.slope])
        kernel.run_loop(
            recorded.sp, process.disturbance, rest, q, begin, self.breakaways, op, x, pv
        )
        return replace(recorded, op=op, x=zero + self.valve.slope * x, pv=pv)

    def draw_alternative(self, rng: np.random.Generator) -> FittedLoop:
        """Draw a loop whose process and valve explain the recording about as well, with other
        breakaways, which differ from day to day. Unchanged, it must reproduce the recorded
        variance, as the fitted loop must.
        """
        valve, recorded = self.valve, self.recorded
        S = max(valve.S + valve.S_spread * float(rng.standard_normal()), 0.0)
        J = max(valve.J + valve.J_spread * float(rng.standard_normal()), 0.0)
        scatter = rng.standard_normal(recorded.op.size).clip(-LARGEST_SCATTER, LARGEST_SCATTER)
        levels = np.maximum(1.0 + valve.scatter * scatter, 0.0)
        samples = float(np.exp(rng.spawn(1)[0].uniform(*np.log(HIDDEN_LAGS))))
        lag = samples * recorded.interval_s
        loop = replace(self, valve=replace(valve, S=S, J=J, hidden_lag_s=lag), breakaways=levels)
        for _ in range(TRIES):
            process = self.process.draw_alternative(rng, recorded.x, recorded.pv)
            drawn = replace(loop, process=process)
            if REPLAYED[0] <= drawn.replayed <= REPLAYED[1]:
                return drawn
        return loop

    @property
    def replayed(self) -> float:
        """The variance of SP - PV of the unchanged simulation, over the recorded one."""
        recorded = self.recorded
        error, again = recorded.sp - recorded.pv, recorded.sp - self.run().pv
        return float(np.var(again)) / max(float(np.var(error)), 1e-30)

    def _zero(self) -> float:
        return float(np.mean(self.recorded.x) - self.valve.slope * np.mean(self.recorded.op))


def fit_loop(recording: Recording, valve: FittedValve) -> FittedLoop | str:
    """The loop of ``recording`` with a ``valve`` that was fitted to it; or, in one sentence, why it
    cannot be simulated.
    """
    pv, sp, mv = recording.get(Role.PV), recording.get(Role.SP), recording.mv
    missing = [name for name, signal in (("PV", pv), ("the position", mv)) if signal is None]
    if pv is None or mv is None:
        return f"{' and '.join(missing)} was not recorded"
    pv = pv.in_process_unit()
    sp = None if sp is None else sp.in_process_unit()
    if sp is not None and sp.unit != pv.unit:
        return f"the set point is in {sp.unit} and PV in {pv.unit}"
    signals = [recording.op, mv, pv, *([sp] if sp is not None else [])]
    known = np.all([signal.usable for signal in signals], axis=0)
    first, last = longest_stretch(known, BRIDGED)
    first = max(first, last - MOST_SAMPLES)
    if last - first < FEWEST_SAMPLES:
        return (
            f"the longest stretch in which OP, position and PV were recorded together has "
            f"{last - first} samples; {FEWEST_SAMPLES} are needed"
        )
    stretches = [signal.values[first:last] for signal in signals]
    op, x, y, *rest = (bridged(values, np.isfinite(values)) for values in stretches)
    target = rest[0] if rest else np.full(y.size, float(y.mean()))
    law = controller_law(op, y, target)
    if isinstance(law, str):
        return law
    process = process_model(x, y)
    if isinstance(process, str):
        return process
    step_s = recording.interval_s * recording.unit_s
    recorded = LoopRun(op=op, x=x, pv=y, sp=target, interval_s=step_s)
    valve = replace(valve, hidden_lag_s=HIDDEN_LAG * step_s)
    loop = FittedLoop(recorded=recorded, unit=pv.unit, law=law, process=process, valve=valve)
    if law.gain * process.gain * valve.slope <= 0.0:
        return "OP and PV do not answer each other as a controller and its process do"
    share = loop.replayed
    if not REPLAYED[0] <= share <= REPLAYED[1]:
        return (
            f"run again as it is, the fitted loop has {share:.2g} times the recorded variance; "
            f"{REPLAYED[0]:g} to {REPLAYED[1]:g} times is expected"
        )
    return loop
