"""A pneumatic spring-and-diaphragm control valve by its nameplate, in SI units."""

from __future__ import annotations

import cmath
from dataclasses import dataclass, field

from stemwatch.models.studies.simulator.defects import AirLine, BodyDefects, PackingDefects
from stemwatch.models.verdict import Shape

# A valve whose S and J, as read, are below this is healthy, percent of span: above every dead band
# drawn for a healthy valve (0.6 %) and below that of every sticky one (1.5 %).
HEALTHY_BELOW_PERCENT = 1.0
# S and J closer to each other than this, relative to S, are drawn and read as "no offset".
_NO_OFFSET_WITHIN = 0.02


@dataclass(frozen=True, kw_only=True)
class Actuator:
    """Diaphragm, spring and moving parts.

    The spring range ``area_m2 (bench_high_pa - bench_low_pa)`` in newton is what friction is
    compared with; it equals spring rate times stroke. The default area, stroke, mass and bench set
    are those of a common mid-size globe valve; published nameplates lie between 0.03 and 0.07 m²,
    15 and 102 mm, 1 and 2 kg. ``viscous_s`` is the viscous drag divided by the spring rate: the
    time constant of the slip itself. ``stribeck_percent_per_s`` is the stem speed at which the
    breakaway level has fallen to 37 % of its excess over the kinetic level.
    """

    mass_kg: float = 1.6
    area_m2: float = 0.0445
    stroke_m: float = 0.029
    bench_low_pa: float = 41_000.0
    bench_high_pa: float = 180_000.0
    supply_pa: float = 240_000.0
    viscous_s: float = 0.02
    stribeck_percent_per_s: float = 0.03
    air_lag_s: float = 0.3
    dead_time_s: float = 0.0

    @property
    def spring_range_n(self) -> float:
        """The spring's force over the whole stroke, newton."""
        return self.area_m2 * (self.bench_high_pa - self.bench_low_pa)

    @property
    def spring_n_per_m(self) -> float:
        """The spring rate, newton per metre."""
        return self.spring_range_n / self.stroke_m


@dataclass(frozen=True, kw_only=True)
class SimulatedValve:
    """An actuator, its packing and, where ``positioner_gain`` is above zero, a positioner.

    ``S`` and ``J`` are the packing's own, percent of the spring range: the friction levels are
    ``(S + J)/2`` at breakaway and ``(S - J)/2`` while the stem slides. ``scatter`` is the standard
    deviation of the breakaway level as a share of itself, drawn anew every time the stem stops;
    the level never falls below the kinetic one.

    Friction cannot give ``S < J``: it would have to push. Two mechanisms give the overshoot shape.

    * Physical: a proportional positioner of gain G on a packing that lets go suddenly. The slip is
      quicker than the air, so the stem jumps nearly its full J before the positioner responds, and
      ends beyond its command. It then stands still until the command has moved on by J, or back by
      S, so that a turn which does not follow a slip at once needs up to S + J.
    * Phenomenological: ``S < J`` on the packing itself, that is, a negative kinetic level. The
      moving stem is pushed ahead of its command by ``(J - S)/2`` all the while it slides.

    ``packing``, ``body`` and ``air_line`` hold what a valve may have beyond that, by default none.

    Raises ``ValueError`` where S, J, scatter or gain is negative.
    """

    S: float = 0.3
    J: float = 0.0
    scatter: float = 0.04
    positioner_gain: float = 0.0
    actuator: Actuator = field(default_factory=Actuator)
    packing: PackingDefects = field(default_factory=PackingDefects)
    body: BodyDefects = field(default_factory=BodyDefects)
    air_line: AirLine = field(default_factory=AirLine)

    def __post_init__(self) -> None:
        for name in ("S", "J", "scatter", "positioner_gain"):
            if getattr(self, name) < 0.0:
                raise ValueError(f"Valve.{name} must not be negative: {getattr(self, name)}")

    @classmethod
    def showing(
        cls,
        S: float,
        J: float,
        *,
        positioner_gain: float = 0.0,
        scatter: float = 0.04,
        actuator: Actuator | None = None,
    ) -> SimulatedValve:
        """The valve whose OP-MV loop reads ``S`` and ``J`` with this positioner."""
        actuator = actuator or Actuator()
        jump = J / slip_share(positioner_gain, actuator.air_lag_s, actuator.viscous_s)
        return cls(
            S=(S + J) * (1.0 + positioner_gain) - jump,
            J=jump,
            positioner_gain=positioner_gain,
            scatter=scatter,
            actuator=actuator,
        )

    @property
    def S_read(self) -> float:
        """S that a person reads off the OP-MV loop: ``(S + J)/(1 + G) - J_read``, percent of span.

        At breakaway ``(1 + G)(OP - x) = (S + J)/2``. The slip moves x by ``J_read`` while OP stands
        still. The reversal then has to bring ``(1 + G)(OP - x)`` to ``-(S + J)/2``. Without
        positioner this is S, and for J = 0 it is the dead band ``S/(1 + G)``.
        """
        total = (self.S + self.J) / (1.0 + self.positioner_gain)
        return max(total - self.J_read, 0.0)

    @property
    def J_read(self) -> float:
        """Height of the slip, percent of travel: J less what the positioner takes back in time."""
        actuator = self.actuator
        share = slip_share(self.positioner_gain, actuator.air_lag_s, actuator.viscous_s)
        return self.J * share

    @property
    def healthy(self) -> bool:
        """Whether S and J, as read, are no more than a good valve may have."""
        return max(self.S_read, self.J_read) < HEALTHY_BELOW_PERCENT

    @property
    def shape(self) -> Shape:
        """The shape of the OP-MV loop that S and J, as read, make."""
        return shape_of(self.S_read, self.J_read)


def shape_of(S: float, J: float) -> Shape:
    """Deadband where J = 0, undershoot S > J > 0, no offset S = J (within 2 %), overshoot S < J."""
    if J <= 0.0:
        return Shape.DEADBAND
    if abs(S - J) <= _NO_OFFSET_WITHIN * S:
        return Shape.NO_OFFSET
    return Shape.UNDERSHOOT if S > J else Shape.OVERSHOOT


def slip_share(positioner_gain: float, air_lag_s: float, viscous_s: float) -> float:
    """How much of the packing's J a slip covers before the positioner has let the force go, 0 to 1.

    With y the way slipped, G the gain, T the air lag and c the drag's time, and stem mass left out:
    ``c T y'' + (c + T) y' + (1 + G) y = J`` from ``y = 0, y' = J/c``; the stem stops where y' = 0.
    1 without positioner, ``1/(1 + G)`` where the air is quicker than the slip. Slips
    simulated for gains of 1 to 2 and lags of 0.5 to 1.5 s agree within 2 %.
    """
    if positioner_gain == 0.0:
        return 1.0
    if air_lag_s <= 0.0:
        return 1.0 / (1.0 + positioner_gain)
    product, total = viscous_s * air_lag_s, viscous_s + air_lag_s
    root = cmath.sqrt(total**2 - 4.0 * product * (1.0 + positioner_gain))
    if abs(root) < 1e-6 * total:
        root = complex(1e-6 * total)  # a double root has another form; this one is near enough
    slow, fast = (-total + root) / (2.0 * product), (-total - root) / (2.0 * product)
    # y'/J = a exp(slow t) + b exp(fast t), from y'(0) = J/c and y''(0) = -J/c².
    a = (-1.0 / viscous_s**2 - fast / viscous_s) / (slow - fast)
    b = 1.0 / viscous_s - a
    if root.imag == 0.0 and a.real >= 0.0:
        return 1.0 / (1.0 + positioner_gain)  # air quicker than the slip: no jump past, no turn
    stop = cmath.log(-b / a)
    if abs(root.imag) > 0.0 and stop.imag <= 0.0:
        stop += 2j * cmath.pi
    stop /= slow - fast
    travel = a / slow * (cmath.exp(slow * stop) - 1.0) + b / fast * (cmath.exp(fast * stop) - 1.0)
    return float(travel.real)
