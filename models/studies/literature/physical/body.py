"""The body of a valve and the friction of its packing, in SI units.

The force balance of a pneumatic spring-and-diaphragm valve (quoted from memory)::

    m x'' = Sa P - k x - Finit - Ff - Fflow

with the stem position ``x`` in m (0 at the closed end, ``stroke_m`` at the open one), the pressure
``P`` in Pa, the diaphragm area ``Sa`` in m², the spring rate ``k`` in N/m, the preload ``Finit``
in N, the friction ``Ff`` and the flow force ``Fflow`` in N.
"""

from __future__ import annotations

from dataclasses import dataclass, replace


@dataclass(frozen=True, kw_only=True)
class ValveBody:
    """Moving mass, spring, diaphragm, and the pressures at 0 and 100 % of OP.

    Raises ``ValueError`` on a mass, spring, area, stroke or pressure range that is not positive.
    """

    name: str
    mass_kg: float
    spring_n_per_m: float
    area_m2: float
    stroke_m: float
    preload_n: float
    pressure_low_pa: float
    pressure_high_pa: float

    def __post_init__(self) -> None:
        for name in ("mass_kg", "spring_n_per_m", "area_m2", "stroke_m"):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"{self.name}: {name} must be positive: {getattr(self, name)}")
        if not self.pressure_high_pa > self.pressure_low_pa:
            raise ValueError(
                f"{self.name}: expected pressure_low_pa < pressure_high_pa, received "
                f"{self.pressure_low_pa} and {self.pressure_high_pa}"
            )

    @property
    def spring_span_n(self) -> float:
        """k stroke: the spring's force over the whole stroke."""
        return self.spring_n_per_m * self.stroke_m

    @property
    def pressure_span_n(self) -> float:
        """Sa (Pmax - Pmin): the diaphragm's force over the whole of OP."""
        return self.area_m2 * (self.pressure_high_pa - self.pressure_low_pa)

    @property
    def preload_percent(self) -> float:
        """D = 100 (Finit - Sa Pmin) / (Sa (Pmax - Pmin)): OP at which a frictionless stem lifts."""
        excess = self.preload_n - self.area_m2 * self.pressure_low_pa
        return 100.0 * excess / self.pressure_span_n

    def bench_set(self) -> ValveBody:
        """This valve with the pressures that carry it over its stroke: MV = OP without friction."""
        low = self.preload_n / self.area_m2
        high = low + self.spring_span_n / self.area_m2
        name = f"{self.name}, bench set to its stroke"
        return replace(self, name=name, pressure_low_pa=low, pressure_high_pa=high)


@dataclass(frozen=True, kw_only=True)
class Packing:
    """Friction of a packing: levels in N, viscous coefficient in N s/m, Stribeck speed in m/s.

    ``bristle_n_per_m`` and ``bristle_ns_per_m`` are LuGre's stiffness and damping (s0, s1). Raises
    ``ValueError`` on negative levels, a kinetic level above the static one, or speeds and
    stiffness that are not positive.
    """

    static_n: float
    kinetic_n: float
    viscous_ns_per_m: float
    stribeck_m_per_s: float
    bristle_n_per_m: float = 2.6e7
    bristle_ns_per_m: float = 2.04e4

    def __post_init__(self) -> None:
        if not 0.0 <= self.kinetic_n <= self.static_n:
            raise ValueError(
                "expected 0 <= kinetic_n <= static_n, received "
                f"{self.kinetic_n:g} and {self.static_n:g} N"
            )
        if self.viscous_ns_per_m < 0.0 or self.bristle_ns_per_m < 0.0:
            raise ValueError("viscous_ns_per_m and bristle_ns_per_m must not be negative")
        if not (self.stribeck_m_per_s > 0.0 and self.bristle_n_per_m > 0.0):
            raise ValueError("stribeck_m_per_s and bristle_n_per_m must be positive")
