"""What shows a late clock or a slow archive, on recordings that have neither and on those that do.

Sticking and healthy valves of `robustness` are simulated once. As they are, their clocks agree and
a sample is kept every second: the nulls, whose worst a limit must lie beyond. Stored late or more
slowly, they show how many lie beyond the limits. Healthy valves with a noisy PV are the nulls of
what must be evident before a quickly turning OP counts. Sticking valves of all kinds of loops, also
of limit cycles, kept every second, are the nulls of slips that contradict a fit: those of
`robustness` hardly ever answer a slip within two samples.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from stemwatch.models.mismatch import between_samples
from stemwatch.models.mismatch.between_samples import (
    Archive,
    SlipsAgainstFit,
    against_fit,
    even_archive,
)
from stemwatch.models.own_clock import on_own_clock
from stemwatch.models.recording import Recording, Role, Signal
from stemwatch.models.stickslip import clock_shift
from stemwatch.models.stickslip import parameters as coordinate
from stemwatch.models.stickslip.clock_shift import behind_controller, late_evidence
from stemwatch.models.stickslip.fit import StickSlipFit, fit_stickslip
from stemwatch.models.studies.simulator import PlantLoop, draw_sticky, simulate_loop
from stemwatch.service.executors import Executor, map_items
from stemwatch.service.studies.robustness import WAYS, StudiedValve, draw_valves

LATE = "OP stored 5 s late"
NOISY, NOISE = "noisy PV", 1.5  # percent
ALL_LOOPS = "all kinds of loops, as they are"
SLOW = ("stored every 5 s", "stored every 10 s", "averages of 10 s")


@dataclass(frozen=True)
class ArchiveEvidence:
    """What one recording shows; NaN where it shows nothing of the kind."""

    way: str
    sticking: bool
    late_mean: float
    late_t: float
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
class Limit:
    """A limit of the product: beyond ``limit`` (``above`` it or below) it believes in the archive.

    ``worst`` is the null that comes nearest, of ``nulls``, and ``nulls_beyond`` of them lie beyond
    it; ``beyond`` of ``of`` recordings that are late or slow lie beyond it.
    """

    name: str
    limit: float
    above: bool
    worst: float
    nulls: int
    nulls_beyond: int
    beyond: int
    of: int

    @property
    def holds(self) -> bool:
        """Whether no null lies beyond it."""
        return self.nulls_beyond == 0


def evidence_of_valve(valve: StudiedValve | tuple[PlantLoop, int]) -> list[ArchiveEvidence]:
    """One valve as it is, stored late, and stored slowly; a healthy one also with a noisy PV. A
    loop with its seed, whose valve sticks, as it is."""
    if isinstance(valve, tuple):
        recording = simulate_loop(*valve).recording
        return [_evidence(ALL_LOOPS, True, on_own_clock(recording))]
    loop, seed = valve.case.loop, valve.case.seed
    recording = simulate_loop(loop, seed).recording
    stored = {storage: WAYS[storage].change(recording) for storage in ("as it is", LATE, *SLOW)}
    if not valve.sticking:
        loud = replace(loop, transmitters=replace(loop.transmitters, pv_noise=NOISE))
        stored[NOISY] = simulate_loop(loud, seed).recording
    return [
        _evidence(storage, valve.sticking, on_own_clock(stored_recording))
        for storage, stored_recording in stored.items()
    ]


def _evidence(storage: str, sticking: bool, recording: Recording) -> ArchiveEvidence:
    # What the stem says where there is no PV, and what the controller does.
    without_pv: dict[Role, Signal] = {
        role: signal for role, signal in recording.signals.items() if role is not Role.PV
    }
    late = late_evidence(replace(recording, signals=without_pv)).gain
    archive, fit = even_archive(recording), fit_stickslip(recording)
    against = _against(fit, archive)
    return ArchiveEvidence(
        way=storage,
        sticking=sticking,
        late_mean=late.mean,
        late_t=late.t,
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
    """What the slips say against the fit; NaN where too few are seen."""
    c = fit.candidate
    gain, zero = 1.0 + float(c[coordinate.GAIN]), float(c[coordinate.ZERO])
    slips = None if archive is None else archive.slips(fit.evaluator.problem, gain, zero)
    return SlipsAgainstFit(*[np.nan] * 5) if slips is None else against_fit(fit, slips)


def run_archive_limits(
    valves_each: int, seed: int, executor: Executor, on_progress: Callable[[int], None]
) -> list[ArchiveEvidence]:
    """``valves_each`` sticking and as many healthy valves, in all ways, and twice as many sticking
    ones of all kinds of loops as they are."""
    evidence_at: dict[int, list[ArchiveEvidence]] = {}
    items: list[StudiedValve | tuple[PlantLoop, int]] = [*draw_valves(valves_each, seed)]
    items += [
        (loop, 1000 * seed + index) for index, loop in enumerate(draw_sticky(2 * valves_each, seed))
    ]
    for index, evidence in map_items(executor, evidence_of_valve, items):
        evidence_at[index] = evidence
        on_progress(len(evidence_at))
    return [evidence for index in sorted(evidence_at) for evidence in evidence_at[index]]


def limits(evidence: Sequence[ArchiveEvidence]) -> Iterator[Limit]:
    """Each limit with the nulls and the recordings that it tells apart."""
    nulls = [case for case in evidence if case.way == "as it is"]
    late = [case for case in evidence if case.way == LATE]
    slow = [case for case in evidence if case.way in SLOW and case.sticking]
    all_loops = [case for case in evidence if case.way == ALL_LOOPS]
    sticking = [case for case in nulls if case.sticking]
    noisy = [case for case in evidence if case.way == NOISY]
    b = between_samples
    agree = [*nulls, *noisy, *all_loops]
    yield _limit(
        "late clock, by the controller: left of that at once",
        clock_shift.LEFT_AT_ONCE,
        agree,
        late,
        "late_left",
        from_above=False,
    )
    yield _limit(
        "late clock, by the stem: mean gain", clock_shift.LEAST_MEAN, agree, late, "late_mean"
    )
    nulls, others = _split_where(agree, late, lambda case: case.late_mean >= clock_shift.LEAST_MEAN)
    yield _limit("late clock, by the stem: t", clock_shift.LEAST_T, nulls, others, "late_t")
    yield _limit(
        "slow archive: samples to a turn",
        b.FEW,
        sticking,
        slow,
        "samples_per_turn",
        from_above=False,
    )
    yield _limit("friction evident: mean", b.EVIDENT_MEAN, noisy, slow, "friction_mean")
    evident = _split_where(noisy, slow, lambda case: case.friction_mean >= b.EVIDENT_MEAN)
    yield _limit("friction evident: t", b.EVIDENT_T, evident[0], evident[1], "friction_t")
    sticking += all_loops
    nulls, others = _split_where(
        sticking, slow, partial(ArchiveEvidence.against_the_fit, but="apart")
    )
    yield _limit("slips against the fit: S", b.S_APART, nulls, others, "S_apart")
    yield _limit("slips against the fit: J", b.J_APART, nulls, others, "J_apart")
    for name, limit, field, from_above in (
        ("slips against the fit: answered", b.ANSWERED, "answered", False),
        ("slips against the fit: jump", b.CLEAR, "jump", True),
        ("slips against the fit: bounds", b.WIDEST, "bounds", False),
        ("slips against the fit: samples to a turn", b.RESOLVED, "samples_per_turn", False),
    ):
        nulls, others = _split_where(
            sticking, slow, partial(ArchiveEvidence.against_the_fit, but=field)
        )
        yield _limit(name, limit, nulls, others, field, from_above=from_above)


def _split_where(
    nulls: Sequence[ArchiveEvidence],
    others: Sequence[ArchiveEvidence],
    condition: Callable[[ArchiveEvidence], bool],
) -> tuple[list[ArchiveEvidence], list[ArchiveEvidence]]:
    """Those of either group that meet the other limits."""
    return [case for case in nulls if condition(case)], [case for case in others if condition(case)]


def _limit(
    name: str,
    limit: float,
    nulls: Sequence[ArchiveEvidence],
    others: Sequence[ArchiveEvidence],
    field: str,
    *,
    from_above: bool = True,
) -> Limit:
    of_nulls, of_others = (
        np.array([value for case in group if np.isfinite(value := float(getattr(case, field)))])
        for group in (nulls, others)
    )
    worst = np.nan
    if of_nulls.size:
        worst = float(of_nulls.max() if from_above else of_nulls.min())
    nulls_beyond, others_beyond = (
        int(np.count_nonzero(values >= limit if from_above else values <= limit))
        for values in (of_nulls, of_others)
    )
    return Limit(
        name, limit, from_above, worst, of_nulls.size, nulls_beyond, others_beyond, of_others.size
    )
