"""The limits that detect a late clock or a slow archive, on recordings with and without them.

Sticking and healthy valves of `robustness` are simulated once. As they are, their clocks agree and
a sample is kept every second: the nulls. Stored late or more slowly, they show how many lie beyond
the limits. Each limit has nulls that come near it:

- pieces of five minutes, the shortest that get a verdict: of few blocks chance makes most;
- healthy valves with a noisy PV, and pieces of them: a quickly turning OP without friction;
- sticking valves of all kinds of loops, also of limit cycles, and quick ones among as many again:
  their slips contradict a fit though nothing was lost (those of `robustness` hardly ever answer a
  slip within two samples).

At most one null of twenty may meet all limits that belong together (``limit_beside_nulls``).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from itertools import chain

import numpy as np

from stemwatch.models.mismatch.measurement import between_samples
from stemwatch.models.mismatch.measurement.between_samples import (
    Archive,
    SlipsAgainstFit,
    against_fit,
    even_archive,
)
from stemwatch.models.preparation.own_clock import on_own_clock
from stemwatch.models.recording import Recording, Role, Signal
from stemwatch.models.stickslip import clock_shift
from stemwatch.models.stickslip import parameters as coordinate
from stemwatch.models.stickslip.clock_shift import behind_controller, late_evidence
from stemwatch.models.stickslip.fit import StickSlipFit, fit_stickslip
from stemwatch.models.studies.simulator import PlantLoop, draw_sticky, simulate_loop
from stemwatch.service.executors import Executor, results_in_order
from stemwatch.service.studies.limit_beside_nulls import (
    JointCondition,
    Limit,
    Tested,
    every_second_piece,
)
from stemwatch.service.studies.robustness import WAYS, StudiedValve, draw_valves

LATE = "OP stored 5 s late"
NOISY, NOISE = "noisy PV", 1.5  # percent
ALL_LOOPS, SELDOM = "all kinds of loops, as they are", "turns too seldom"
PIECE, NOISY_PIECE, PIECE_SAMPLES = "five minutes", "noisy PV, five minutes", 300
LOOPS_EACH, QUICK_AMONG = 2, 4  # of all kinds of loops, for each sticking valve
SLOW = ("stored every 5 s", "stored every 10 s", "averages of 10 s")


@dataclass(frozen=True)
class ArchiveEvidence:
    """What one recording shows; NaN where it shows nothing of the kind."""

    way: str
    sticking: bool
    late_mean: float
    late_t: float
    late_samples: float
    late_left: float
    samples_per_turn: float
    friction_mean: float
    friction_t: float
    S_apart: float
    J_apart: float
    answered: float
    jump: float
    bounds: float

    def against_the_fit(self, but: str = "") -> bool:
        """Whether its slips contradict the fit of a loop that answers them between samples, by all
        limits ``but`` one."""
        b = between_samples
        asked = {
            "apart": self.S_apart > b.S_APART or self.J_apart > b.J_APART,
            "answered": self.answered < b.ANSWERED,
            "jump": self.jump >= b.CLEAR,
            "bounds": self.bounds <= b.WIDEST,
            "samples_per_turn": self.samples_per_turn <= b.RESOLVED,
        }
        return all(met for name, met in asked.items() if name != but)


@dataclass(frozen=True)
class LoopOfAnyKind:
    """A loop of any kind, whose valve sticks; a ``quick`` one counts only where it turns often."""

    loop: PlantLoop
    seed: int
    quick: bool


def evidence_of_valve(valve: StudiedValve | LoopOfAnyKind) -> list[ArchiveEvidence]:
    """One valve as it is, stored late, stored slowly, and in pieces; a healthy one also with a
    noisy PV. A drawn loop as it is; a quick one only where it turns so often that it may count."""
    if isinstance(valve, LoopOfAnyKind):
        recording = on_own_clock(simulate_loop(valve.loop, valve.seed).recording)
        archive = even_archive(recording)
        per_turn = np.nan if archive is None else archive.per_turn
        if valve.quick and not per_turn <= between_samples.RESOLVED:
            return [_not_looked_at(per_turn)]
        return [_evidence(ALL_LOOPS, True, recording)]
    loop, seed = valve.case.loop, valve.case.seed
    recording = simulate_loop(loop, seed).recording
    stored = [(way, WAYS[way].change(recording)) for way in ("as it is", LATE, *SLOW)]
    stored += [(PIECE, piece) for piece in every_second_piece(recording, PIECE_SAMPLES)]
    if not valve.sticking:
        loud = replace(loop, transmitters=replace(loop.transmitters, pv_noise=NOISE))
        noisy = simulate_loop(loud, seed).recording
        stored += [
            (NOISY, noisy),
            *((NOISY_PIECE, piece) for piece in every_second_piece(noisy, PIECE_SAMPLES)),
        ]
    return [_evidence(way, valve.sticking, on_own_clock(kept)) for way, kept in stored]


def _not_looked_at(per_turn: float) -> ArchiveEvidence:
    """Of a loop that turns too seldom for its slips to count against a fit."""
    unknown = dict.fromkeys([field.name for field in fields(ArchiveEvidence)[2:]], np.nan)
    return ArchiveEvidence(way=SELDOM, sticking=True, **{**unknown, "samples_per_turn": per_turn})


def _evidence(storage: str, sticking: bool, recording: Recording) -> ArchiveEvidence:
    # The evidence from the stem where there is no PV, and that from the controller.
    without_pv: dict[Role, Signal] = {
        role: signal for role, signal in recording.signals.items() if role is not Role.PV
    }
    late = late_evidence(replace(recording, signals=without_pv))
    archive, fit = even_archive(recording), fit_stickslip(recording)
    against = _against(fit, archive)
    return ArchiveEvidence(
        way=storage,
        sticking=sticking,
        late_mean=late.gain.mean,
        late_t=late.gain.t,
        late_samples=late.samples,
        late_left=behind_controller(recording).of_at_once,
        samples_per_turn=np.nan if archive is None else archive.per_turn,
        friction_mean=fit.of_sticking.mean,
        friction_t=fit.of_sticking.t,
        S_apart=against.S,
        J_apart=against.J,
        answered=against.answered,
        jump=against.jump,
        bounds=against.bounds,
    )


def _against(fit: StickSlipFit, archive: Archive | None) -> SlipsAgainstFit:
    """How strongly the slips contradict the fit; NaN where there are too few."""
    c = fit.candidate
    gain, zero = 1.0 + float(c[coordinate.GAIN]), float(c[coordinate.ZERO])
    slips = None if archive is None else archive.slips(fit.evaluator.problem, gain, zero)
    return SlipsAgainstFit(*[np.nan] * 5) if slips is None else against_fit(fit, slips)


def run_archive_limits(
    valves_each: int, seed: int, executor: Executor, on_progress: Callable[[int], None]
) -> list[ArchiveEvidence]:
    """``valves_each`` sticking and as many healthy valves in all ways, ``LOOPS_EACH`` times as many
    sticking ones of all kinds of loops as they are, and the quick ones of ``QUICK_AMONG`` times as
    many."""
    items: list[StudiedValve | LoopOfAnyKind] = [*draw_valves(valves_each, seed)]
    plain = LOOPS_EACH * valves_each
    loops = draw_sticky(plain + QUICK_AMONG * valves_each, seed)
    items += [
        LoopOfAnyKind(loop, 1000 * seed + index, index >= plain) for index, loop in enumerate(loops)
    ]
    return list(chain(*results_in_order(executor, evidence_of_valve, items, on_progress)))


def limits(evidence: Sequence[ArchiveEvidence]) -> Iterator[Limit]:
    """Each limit with the nulls and the recordings that it tells apart."""
    b, c = between_samples, clock_shift
    of = _by_way(evidence)
    sticking = [case for case in of("as it is") if case.sticking]
    slow = [case for case in of(*SLOW) if case.sticking]
    agree = of("as it is", PIECE, NOISY, NOISY_PIECE, ALL_LOOPS)
    clocks, friction = Tested(agree, of(LATE)), Tested(of(NOISY, NOISY_PIECE), slow)
    slips = Tested([*sticking, *of(ALL_LOOPS, SELDOM)], slow)
    name = "late clock, by the controller: left of that at once"
    yield clocks.limit(name, "late_left", c.LEFT_AT_ONCE, above=False)
    stem = [
        JointCondition("mean gain", "late_mean", c.LEAST_MEAN),
        JointCondition("t", "late_t", c.LEAST_T),
        JointCondition("samples", "late_samples", c.LEAST),
    ]
    yield from clocks.together("late clock, by the stem", stem)
    name = "slow archive: samples to a turn"
    yield Tested(sticking, slow).limit(name, "samples_per_turn", b.FEW, above=False)
    evident = [
        JointCondition("mean", "friction_mean", b.EVIDENT_MEAN),
        JointCondition("t", "friction_t", b.EVIDENT_T),
    ]
    yield from friction.together("friction evident", evident)
    for field, limit, but, above in (
        ("S_apart", b.S_APART, "apart", True),
        ("J_apart", b.J_APART, "apart", True),
        ("answered", b.ANSWERED, "answered", False),
        ("jump", b.CLEAR, "jump", True),
        ("bounds", b.WIDEST, "bounds", False),
        ("samples_per_turn", b.RESOLVED, "samples_per_turn", False),
    ):
        word = {"samples_per_turn": "samples to a turn"}.get(field, field.removesuffix("_apart"))
        others = partial(ArchiveEvidence.against_the_fit, but=but)
        yield slips.limit(f"slips against the fit: {word}", field, limit, others, above=above)


def _by_way(evidence: Sequence[ArchiveEvidence]) -> Callable[..., list[ArchiveEvidence]]:
    """The evidence of some ways."""
    return lambda *ways: [case for case in evidence if case.way in ways]
