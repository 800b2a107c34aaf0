"""What the likelihood of the whole record gains by dwell alone, with and without a hidden one.

    python -m tests.benchmarks.bench_dwell [--seed S] [--cases N] [--hidden]

Valves with nothing hidden (``draw_nulls``), or with ``--hidden`` those of ``draw_hidden`` that hide
dwell alone and whose record shows it. Each is compared without and with dwell, beside S and J as
they are fitted to it. One line for each: the gain of the log likelihood, that beside what quick
loading does, its t over the blocks of time, the size, the score of the breakaways where they tell
of dwell, and S and J without and with it beside the true ones; then how many pass. Where a look
shows that dwell does not gain enough, these are of the look.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator

from stemwatch.models.mismatch.fit.base_coordinate import S_and_J
from stemwatch.models.mismatch.likelihood.maximum_likelihood import RecordLikelihood
from stemwatch.models.mismatch.measurement.record_effects import measured_record
from stemwatch.models.mismatch.prepared_recording import prepare, problem_of
from stemwatch.models.mismatch.search.breakaway_levels import DWELL, breakaway_evidence
from stemwatch.models.mismatch.search.breakaway_scatter import scatter_matters
from stemwatch.models.mismatch.search.dwell_by_likelihood import (
    CONTRADICTED_Z,
    LEAST_GAIN,
    compared_with_dwell,
    shows_dwell,
    with_quick_loading,
)
from stemwatch.models.mismatch.terms import catalogue
from stemwatch.models.preparation.own_clock import on_own_clock
from stemwatch.models.recording import Recording
from stemwatch.models.studies.simulator.hidden import (
    HiddenCase,
    draw_hidden,
    draw_nulls,
    simulate_hidden,
)
from tests.benchmarks.bench_ceiling import stored


def asked(case: HiddenCase, recording: Recording) -> tuple[bool, str] | None:
    """Whether dwell passes, and a line; ``None`` where it is not asked for."""
    recording = on_own_clock(recording)
    measured = measured_record(recording)
    prepared = prepare(recording, measured, None, problem_of(recording, measured))
    evaluator, fitted = prepared.base.evaluator, prepared.base.fitted
    if DWELL in prepared.refused or not scatter_matters(evaluator, fitted):
        return None
    likelihood = RecordLikelihood(evaluator)
    one = compared_with_dwell(likelihood, fitted, catalogue()[DWELL], LEAST_GAIN)
    beside = with_quick_loading(likelihood, one)
    scores = (seen.z for seen in breakaway_evidence(evaluator, fitted) if seen.slug == DWELL)
    z = next(scores, None)
    size = float(one.rich.candidate[one.rich.layout.places[DWELL]][0])
    before, after = S_and_J(one.simple.candidate), S_and_J(one.rich.candidate)
    valve = case.loop.valve
    contradicted = z is not None and z < CONTRADICTED_Z
    return shows_dwell(likelihood, one) and not contradicted, (
        f"gain {one.evidence.gain:.1f}, beside quick loading {beside.evidence.gain:.1f}, "
        f"t {one.evidence.t:.1f}, b {size:.2f}, breakaways "
        f"{'-' if z is None else format(z, '.1f')}; S, J {before[0]:.2f}, {before[1]:.2f} -> "
        f"{after[0]:.2f}, {after[1]:.2f}; true {valve.S_read:.2f}, {valve.J_read:.2f}"
    )


def drawn(cases: int, seed: int, *, hidden: bool) -> Iterator[tuple[str, HiddenCase, Recording]]:
    """The valves: a number, the case, and its recording as the proof's files have it."""
    if not hidden:
        for number, case in enumerate(draw_nulls(cases, seed)):
            yield str(number), case, stored(case.simulated().recording)
        return
    for number, one in enumerate(draw_hidden(cases, seed)):
        if one.hidden != (DWELL,):
            continue
        case, run = simulate_hidden(one)
        if case.excited:
            yield str(number), case, stored(run.recording)


def main() -> None:
    """One line for each valve, and the count."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=4063)
    parser.add_argument("--cases", type=int, default=96)
    parser.add_argument("--hidden", action="store_true")
    requested = parser.parse_args()
    many = passed = 0
    for number, case, recording in drawn(requested.cases, requested.seed, hidden=requested.hidden):
        answer = asked(case, recording)
        many += 1
        if answer is None:
            continue
        passed += answer[0]
        print(f"{number:>4s} {case.concealment}: {'dwell, ' * answer[0]}{answer[1]}", flush=True)
    print(f"{passed} of {many} pass")


if __name__ == "__main__":
    main()
