"""``HiddenCase``: a loop with its hidden effects, and whether its record shows them."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from stemwatch.models.recording import Floats
from stemwatch.models.studies.simulator.hidden.catalogue import RECORD, with_effect
from stemwatch.models.studies.simulator.loop import ManualSpan, PlantLoop
from stemwatch.models.studies.simulator.simulate import SimulatedLoop, simulate_loop

# An effect that moves the reading by less than this (RMS) is not in the record, percent of span.
EXCITED_PERCENT = 0.15
# Record effects show in the values themselves, so smaller ones count too.
EXCITED_RECORD_PERCENT = 0.03
_SETTLE_S = 5.0


@dataclass(frozen=True, kw_only=True)
class HiddenCase:
    """One loop of the population, and what is hidden in it.

    ``plain`` is the same loop with nothing hidden. ``hidden`` are the names of what ``loop`` has
    beyond it, ``effects`` the correct answer: the same as slugs of the catalogue, or "unknown".
    ``sizes`` are the drawn numbers as ``name.size``; ``simulate_hidden`` fills in ``excitation``,
    by how much each hidden effect moves the reading (RMS, percent of span).
    """

    loop: PlantLoop
    plain: PlantLoop
    seed: int
    hidden: tuple[str, ...]
    effects: tuple[str, ...]
    concealment: str
    sizes: dict[str, float]
    excitation: dict[str, float] = field(default_factory=dict)

    @property
    def excited(self) -> bool:
        """Whether the record can show every hidden effect; False before it was simulated."""
        return all(self.shows(name) for name in self.hidden)

    def shows(self, name: str) -> bool:
        """Whether the record can show the hidden effect ``name``."""
        limit = EXCITED_RECORD_PERCENT if name in RECORD else EXCITED_PERCENT
        return self.excitation.get(name, 0.0) >= limit

    def simulated(self) -> SimulatedLoop:
        """The simulated loop, which takes half the time of ``simulate_hidden`` or less."""
        return simulate_loop(self.loop, self.seed)


def simulate_hidden(case: HiddenCase) -> tuple[HiddenCase, SimulatedLoop]:
    """The simulated loop, and the case with its ``excitation`` filled in."""
    run = case.simulated()
    in_reading = [name for name in case.hidden if name not in RECORD]
    with_all = _replayed(case.loop, run.output, case.seed) if in_reading else run.reading
    excitation = {name: _excitation(case, name, run, with_all) for name in case.hidden}
    return replace(case, excitation=excitation), run


def _excitation(case: HiddenCase, name: str, run: SimulatedLoop, with_all: Floats) -> float:
    """RMS difference that effect ``name`` makes to the reading, percent of span.

    The valve is simulated on the same commands without the effect, and ``with_all`` (n,) with all
    that are hidden. There is no scatter, because another draw of breakaways would make the two runs
    differ too.
    """
    other_loop = case.plain
    for other in case.hidden:
        if other != name:
            other_loop = with_effect(other_loop, other, case.sizes)
    if name in RECORD:
        other_run = simulate_loop(other_loop, case.seed)
        true_mv, others = run.recording.mv, other_run.recording.mv
        assert true_mv is not None
        assert others is not None
        return _rms(true_mv.values - others.values)
    return _rms(with_all - _replayed(other_loop, run.output, case.seed))


def _rms(difference: Floats) -> float:
    return float(np.sqrt(np.nanmean(difference**2)))


def _replayed(loop: PlantLoop, output: Floats, seed: int) -> Floats:
    """(n,) noise-free reading of the valve alone on the OP that was recorded."""
    interval_s = loop.archive.interval_s
    times = np.arange(output.size) * interval_s
    lead = ((-loop.warmup_s, loop.controller.output), (-_SETTLE_S, float(output[0])))
    knots = (*lead, *zip(times.tolist(), output.tolist(), strict=True))
    span = ManualSpan(start_s=-loop.warmup_s, stop_s=loop.duration_s + interval_s, knots=knots)
    quiet = replace(loop.transmitters, position_noise=0.0, position_step=0.0)
    # Bristles take ten times as long to simulate and hardly affect the difference.
    packing = replace(loop.valve.packing, presliding_percent=0.0)
    replay = replace(
        loop,
        valve=replace(loop.valve, scatter=0.0, packing=packing),
        manual=(span,),
        loads=(),
        transmitters=quiet,
        archive=replace(loop.archive, compression=(), frozen=(), gaps=(), bad=()),
    )
    mv = simulate_loop(replay, seed).recording.mv
    assert mv is not None
    return mv.values
