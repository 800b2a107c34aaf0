"""``ValveModel``, the protocol of stiction models: parameters, simulation, equation, limits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from stemwatch.models.recording import Floats

Run = Callable[[Floats, Floats, float, float, Floats], None]


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """One number of a model, with its unit and what it means.

    ``per_percent`` is set for a friction level: the number of its units in one percent of OP. A fit
    then searches up to the command's own swing only. ``logarithmic``: its decade is unknown, and a
    fit searches its logarithm.
    """

    name: str
    unit: str
    lower: float
    upper: float
    default: float
    meaning: str
    per_percent: float | None = None
    logarithmic: bool = False

    def __post_init__(self) -> None:
        if not self.lower <= self.default <= self.upper:
            raise ValueError(
                f"{self.name}: expected lower <= default <= upper, received {self.lower}, "
                f"{self.default}, {self.upper}"
            )
        if self.logarithmic and not self.lower > 0.0:
            raise ValueError(f"{self.name}: a logarithmic parameter needs lower above 0")


class DescribedModel(Protocol):
    """The description that stiction models and networks give of themselves."""

    @property
    def name(self) -> str:
        """The name used to select it in a comparison."""
        ...

    @property
    def source(self) -> str:
        """Authors and publication, and how certain the reconstruction is."""
        ...

    @property
    def limits(self) -> tuple[str, ...]:
        """The known faults of the model, a sentence each."""
        ...

    def equation(self) -> str:
        """The model in a few lines."""
        ...


class ValveModel(DescribedModel, Protocol):
    """A stiction model, from command to stem position, both in percent.

    An implementation must
    1. give every parameter bounds within which ``simulate`` works,
    2. start at ``y0`` and depend on nothing before its first sample,
    3. leave a resting stem where it is for as long as OP stands still,
    4. return finite numbers for every finite OP and every admissible parameter,
    5. name in ``source`` the authors and how certain the reconstruction is, and in ``limits`` the
       known faults of the model.
    """

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The parameters (k,), with units, bounds and meaning."""
        ...

    @property
    def slow(self) -> bool:
        """Whether a simulation takes milliseconds; a fit then tries fewer candidates."""
        ...

    def objection(self, parameters: Floats) -> str | None:
        """Why these parameters (k,) cannot be simulated, in a sentence, or ``None``."""
        ...

    def simulate(self, op: Floats, parameters: Floats, interval_s: float, y0: float) -> Floats:
        """(n,) stem position in percent for ``op`` (n,) in percent, one sample per interval.

        ``parameters`` (k,) in the order of ``parameters``; the first value returned is ``y0``.
        Raises ``ValueError`` on an OP that is not one-dimensional and finite, on an interval that
        is not positive, and on parameters that meet an objection.
        """
        ...


def _no_objection(parameters: Floats) -> str | None:
    return None


@dataclass(frozen=True, kw_only=True)
class KernelModel:
    """A ``ValveModel`` made of a description and a compiled kernel.

    ``run(op, parameters, interval_s, y0, out)`` fills ``out`` (n,). ``relation`` is the objection
    to parameters that are each within their bounds but inconsistent together.
    """

    name: str
    source: str
    parameters: tuple[Parameter, ...]
    text: str
    limits: tuple[str, ...]
    run: Run
    relation: Callable[[Floats], str | None] = _no_objection
    slow: bool = False

    def equation(self) -> str:
        """The model in a few lines."""
        return self.text

    def objection(self, parameters: Floats) -> str | None:
        """A wrong number of parameters, one outside its bounds, or what ``relation`` objects to."""
        if parameters.shape != (len(self.parameters),):
            names = ", ".join(p.name for p in self.parameters)
            return f"expected {len(self.parameters)} parameters ({names}), received {parameters}"
        for parameter, value in zip(self.parameters, parameters.tolist(), strict=True):
            if not parameter.lower <= value <= parameter.upper:
                return (
                    f"{parameter.name} = {value:g} {parameter.unit} is outside "
                    f"{parameter.lower:g} to {parameter.upper:g}"
                )
        return self.relation(parameters)

    def simulate(self, op: Floats, parameters: Floats, interval_s: float, y0: float) -> Floats:
        # Copies: a compiled kernel would be compiled again for arrays that are read-only.
        """(n,) stem position in percent, by the kernel; see ``ValveModel.simulate``."""
        command, chosen = np.array(op, np.float64), np.array(parameters, np.float64)
        problem = self.objection(chosen) or _unusable(command, interval_s, y0)
        if problem is not None:
            raise ValueError(f"{self.name}: {problem}")
        out = np.empty(command.size)
        self.run(command, chosen, float(interval_s), float(y0), out)
        return out


def _unusable(op: Floats, interval_s: float, y0: float) -> str | None:
    if op.ndim != 1 or not op.size:
        return f"op (n,) with at least one sample expected, received shape {op.shape}"
    bad = int(np.count_nonzero(~np.isfinite(op)))
    if bad:
        return f"{bad} of {op.size} samples of op are not finite; cut or bridge the holes first"
    if not (np.isfinite(interval_s) and interval_s > 0.0):
        return f"interval_s must be positive, received {interval_s}"
    if not np.isfinite(y0):
        return f"y0 must be finite, received {y0}"
    return None


def values_of(model: ValveModel, **named: float) -> Floats:
    """(k,) parameters of ``model``: its defaults, but for those named.

    Raises ``ValueError`` on a name that the model does not have.
    """
    names = [parameter.name for parameter in model.parameters]
    unknown = sorted(set(named) - set(names))
    if unknown:
        raise ValueError(f"{model.name} has no {', '.join(unknown)}; it has {', '.join(names)}")
    return np.array([named.get(p.name, p.default) for p in model.parameters], dtype=np.float64)
