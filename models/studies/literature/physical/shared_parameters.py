"""The parameters and the force balance that the physical models share."""

from __future__ import annotations

from stemwatch.models.recording import Floats
from stemwatch.models.studies.literature.model import Parameter
from stemwatch.models.studies.literature.physical.body import Packing, ValveBody
from stemwatch.models.studies.literature.physical.published import SET_B, ParameterSet

# Set b on the valve whose pressures fit its stroke, so that MV is OP where there is no friction.
USUAL = ParameterSet(
    name="b, bench set",
    body=SET_B.body.bench_set(),
    packing=SET_B.packing,
    provenance=SET_B.provenance,
    assumed="The pressures at 0 and 100 % of OP are those that carry the stem over its stroke.",
)
# Local error of one step of the integration. Errors grow where a stem creeps on the falling part of
# the friction curve: 0.04 % was the most that a finer tolerance changed on the valves tested.
TOLERANCE_PERCENT = 1e-3
LEAST_N = 1.0  # with a friction level of 0 the bristles would have no length

BALANCE = "m x'' = Sa P - k x - Finit - Ff. "
STRIBECK = "[Fc + (Fs - Fc) exp(-(v/vs)^2)] sign(v) + Fv v"
SECTION = "force balance and friction law"


def friction_parameters(valve: ParameterSet) -> tuple[Parameter, Parameter, Parameter]:
    """Fs, Fc in N and Fv in N s/m, with the packing's own as defaults."""
    span, packing = valve.body.pressure_span_n, valve.packing
    return (
        _force("static_n", packing.static_n, span, "Fs: force at which a resting stem lets go"),
        _force("kinetic_n", packing.kinetic_n, span, "Fc: friction of a stem that slides fast"),
        viscous(valve),
    )


def coulomb_level(valve: ParameterSet) -> Parameter:
    """Fc alone, for a model without static friction."""
    meaning = "Fc: friction of a stem that slides"
    return _force("kinetic_n", valve.packing.kinetic_n, valve.body.pressure_span_n, meaning)


def viscous(valve: ParameterSet) -> Parameter:
    """Fv, N s/m."""
    return Parameter(
        name="viscous_ns_per_m",
        unit="N s/m",
        lower=100.0,
        upper=1e6,
        default=valve.packing.viscous_ns_per_m,
        meaning="Fv: viscous coefficient; Fv/k is the time constant of a slip",
        logarithmic=True,
    )


def _force(name: str, default: float, span_n: float, meaning: str) -> Parameter:
    # fs = Fs/span and S is up to 2 fs, so a percent of OP's swing is worth half a percent of span.
    return Parameter(
        name=name,
        unit="N",
        lower=LEAST_N,
        upper=span_n,
        default=default,
        meaning=meaning,
        per_percent=span_n / 200.0,
    )


def kinetic_not_above_static(parameters: Floats) -> str | None:
    """The objection of a model whose first two parameters are Fs and Fc."""
    static, kinetic = parameters[:2].tolist()
    if kinetic <= static:
        return None
    return f"expected kinetic_n <= static_n, received {kinetic:g} and {static:g} N"


def actuator_force(body: ValveBody) -> tuple[float, float]:
    """(N at OP = 0, N per percent of OP): the diaphragm's force less the preload."""
    at_zero = body.area_m2 * body.pressure_low_pa - body.preload_n
    return at_zero, body.pressure_span_n / 100.0


def packing_of(parameters: Floats, packing: Packing) -> Packing:
    """``packing`` with Fs, Fc and Fv replaced."""
    static, kinetic, drag = parameters[:3].tolist()
    return Packing(
        static_n=static,
        kinetic_n=kinetic,
        viscous_ns_per_m=drag,
        stribeck_m_per_s=packing.stribeck_m_per_s,
        bristle_n_per_m=packing.bristle_n_per_m,
        bristle_ns_per_m=packing.bristle_ns_per_m,
    )
