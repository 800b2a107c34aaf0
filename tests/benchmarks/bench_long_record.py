"""Eight hours explained in one piece and as windows: names, S, J and processor time.

    python tests/benchmarks/bench_long_record.py [--seed S] [--nulls N] [--hours H] [EFFECT ...]

Valves of the proof's simulator with one effect each (by default seven that are often missed), and
valves with nothing hidden, every second one with 12 % breakaway scatter. Each is recorded for eight
hours at 1 s, and explained twice: by one search over all of it, and by ``explain_windows`` as
``stemwatch explain`` does.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from stemwatch.models.estimate import Estimate
from stemwatch.models.history.explained_windows import explain_windows
from stemwatch.models.limits import Limits
from stemwatch.models.mismatch.explain import explain
from stemwatch.models.mismatch.findings import Mismatch
from stemwatch.models.recording import Recording
from stemwatch.models.studies.simulator.hidden import (
    HiddenCase,
    draw_effect,
    draw_nulls,
    simulate_hidden,
)
from stemwatch.models.studies.simulator.hidden.catalogue import with_effect
from stemwatch.models.studies.simulator.hidden.loops import moved_anew

MISSED_OFTEN = (
    "dwell_dependent_breakaway",
    "lost_motion",
    "flow_force",
    "position_dependent_friction",
    "asymmetric_rate_limit",
    "asymmetric_slip",
    "viscous_drag",
)


@dataclass(frozen=True)
class Judged:
    """The result of one method for one recording: the names, how far S and J are off, seconds."""

    names: tuple[tuple[str, ...], ...]
    S_off: float
    J_off: float
    seconds: float

    def right(self, hidden: tuple[str, ...]) -> bool:
        """Whether the hidden effect is in the class of a named one."""
        return any(set(members) & set(hidden) for members in self.names)


def for_hours(case: HiddenCase, hours: float) -> HiddenCase:
    """The case, recorded for so long; set points drawn anew."""
    rng = np.random.default_rng([case.seed, 8, 8])
    loop = plain = moved_anew(replace(case.plain, duration_s=3600.0 * hours), rng)
    for name in case.hidden:
        loop = with_effect(loop, name, case.sizes)
    return replace(case, loop=loop, plain=plain, excitation={})


def judged(case: HiddenCase, recording: Recording, ask: Callable[[Recording], Mismatch]) -> Judged:
    """The result of ``ask`` for the recording, compared with the truth."""
    started = time.process_time()
    mismatch = ask(recording)
    seconds = time.process_time() - started
    valve = case.loop.valve

    def off(estimate: Estimate, truth: float) -> float:
        return float("nan") if estimate.value is None else abs(estimate.value - truth)

    return Judged(
        names=tuple(effect.members for effect in mismatch.effects),
        S_off=off(mismatch.restated.S, valve.S_read),
        J_off=off(mismatch.restated.J, valve.J_read),
        seconds=seconds,
    )


def as_windows(recording: Recording) -> Mismatch:
    """As ``stemwatch explain`` does."""
    in_windows = explain_windows(recording, round(Limits().fitted_samples), explain)
    return explain(recording) if in_windows is None else in_windows.mismatch


def main() -> None:
    """Judge the valves and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("effects", nargs="*", default=list(MISSED_OFTEN))
    parser.add_argument("--seed", type=int, default=8181)
    parser.add_argument("--nulls", type=int, default=6)
    parser.add_argument("--hours", type=float, default=8.0)
    requested = parser.parse_args()
    cases = [draw_effect(slug, 1, requested.seed)[0] for slug in requested.effects]
    cases += draw_nulls(requested.nulls, requested.seed, "routine")
    rows = []
    for drawn in cases:
        case, run = simulate_hidden(for_hours(drawn, requested.hours))
        explain(run.recording.part(0, 400))  # kernels are compiled before the clock runs
        ways = [
            judged(case, run.recording, explain),
            judged(case, run.recording, as_windows),
        ]
        rows.append((case, ways))
        text = "; ".join(
            f"{' + '.join('|'.join(name) for name in way.names) or 'nothing'} "
            f"(S off {way.S_off:.2f}, J off {way.J_off:.2f}, {way.seconds:.1f} s)"
            for way in ways
        )
        shows = "" if case.excited else ", not excited"
        print(f"{' + '.join(case.hidden) or 'nothing hidden'}{shows}: {text}", flush=True)
    for index, name in enumerate(("one piece", "windows")):
        some = [(case, ways[index]) for case, ways in rows if case.hidden]
        nulls = [ways[index] for case, ways in rows if not case.hidden]
        every = [ways[index] for _, ways in rows]
        print(
            f"{name}: found {sum(way.right(case.hidden) for case, way in some)} of {len(some)}, "
            f"false {sum(bool(way.names) for way in nulls)} of {len(nulls)}; with nothing hidden S "
            f"off {np.nanmedian([way.S_off for way in nulls] or [np.nan]):.2f}, J "
            f"{np.nanmedian([way.J_off for way in nulls] or [np.nan]):.2f} % (median); "
            f"{np.median([way.seconds for way in every]):.1f} s (median)"
        )


if __name__ == "__main__":
    main()
