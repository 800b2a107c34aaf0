"""The published parameter sets a, b and c, with their origin and what had to be assumed.

The catalogue's force balances use set b. Sets a and c serve to build one for another valve, such as
``karnopp(SET_C)``.
"""

from __future__ import annotations

from dataclasses import dataclass

from stemwatch.models.studies.literature.physical.body import Packing, ValveBody


@dataclass(frozen=True, kw_only=True)
class ParameterSet:
    """A valve, its packing, where the numbers come from, and what had to be assumed.

    ``published_S_percent`` and the rest are the data-driven numbers that came with the set.
    """

    name: str
    body: ValveBody
    packing: Packing
    provenance: str
    assumed: str
    published_S_percent: float | None = None
    published_J_percent: float | None = None
    published_D_percent: float | None = None


SET_A = ParameterSet(
    name="a",
    # Without preload the spring range fixes the pressures: 0 to k stroke / Sa.
    body=ValveBody(
        name="set a",
        mass_kg=1.36,
        spring_n_per_m=52_500.0,
        area_m2=0.0645,
        stroke_m=0.1016,
        preload_n=0.0,
        pressure_low_pa=0.0,
        pressure_high_pa=52_500.0 * 0.1016 / 0.0645,
    ),
    packing=Packing(
        static_n=1707.7, kinetic_n=1423.0, viscous_ns_per_m=612.0, stribeck_m_per_s=2.54e-4
    ),
    provenance=(
        "The nominal valve of Choudhury and of Kayihan; from memory, to be verified before it is "
        "quoted. It describes very strong friction (S of 58.7 %)."
    ),
    assumed="Preload and pressures are not given: no preload, pressures to fit the stroke.",
)

SET_B = ParameterSet(
    name="b",
    body=ValveBody(
        name="set b",
        mass_kg=1.6,
        spring_n_per_m=210_490.0,
        area_m2=0.0445,
        stroke_m=0.029,
        preload_n=2550.0,
        pressure_low_pa=41_368.0,
        pressure_high_pa=180_000.0,
    ),
    packing=Packing(
        static_n=780.0, kinetic_n=700.0, viscous_ns_per_m=125_000.0, stribeck_m_per_s=5e-4
    ),
    provenance=(
        "Defaults of the group at the University of Sao Paulo (Garcia), read in published code. "
        "Inconsistent within itself: its S is 2 Fs, its J is Fs - Fc."
    ),
    assumed="Nothing.",
    published_S_percent=25.2872,
    published_J_percent=1.29678,
    published_D_percent=11.4947,
)

SET_C = ParameterSet(
    name="c",
    body=ValveBody(
        name="set c",
        mass_kg=1.6,
        spring_n_per_m=206_900.0,
        area_m2=0.0445,
        stroke_m=0.029,
        preload_n=2571.4,
        pressure_low_pa=41_368.0,
        pressure_high_pa=180_000.0,
    ),
    packing=Packing(
        static_n=942.4, kinetic_n=665.4, viscous_ns_per_m=70_501.0, stribeck_m_per_s=3.26e-3
    ),
    provenance="The same group's fit to a valve with graphite packing, read in published code.",
    assumed="Mass, area, stroke and pressures are those of set b; so are the bristles.",
    published_S_percent=26.42,
    published_J_percent=0.086,
    published_D_percent=14.54,
)

PUBLISHED = (SET_A, SET_B, SET_C)
