"""How often the look at breakaways (``integral_at_breakaways``) sends a valve on to the search for
a positioner that integrates: of valves by another hand with and without one, and of the product's
own, of which none has one.

    python -m tests.benchmarks.bench_integrating_positioner [--draws 1 2] [--valves 4] [--seed 4064]
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator

from stemwatch.models.mismatch.evidence.integral_at_breakaways import INTEGRATING
from stemwatch.models.mismatch.measurement.record_effects import measured_record
from stemwatch.models.mismatch.prepared_recording import prepare, problem_of, why_not
from stemwatch.models.preparation.own_clock import on_own_clock
from stemwatch.models.recording import Recording
from stemwatch.models.studies.simulator.hidden import draw_hidden, draw_nulls, simulate_hidden
from stemwatch.models.studies.simulator.hidden.draws import draw_unknown
from tests.benchmarks.another_hand import EFFECTS, NOTHING, draw_hand_valve


def shows(recording: Recording) -> bool:
    """Whether a positioner that integrates would be searched for."""
    recording = on_own_clock(recording)
    measured = measured_record(recording)
    if why_not(recording, measured) is not None:
        return False
    case = prepare(recording, measured, None, problem_of(recording, measured))
    return INTEGRATING not in case.refused


def valves(draws: list[int], count: int, seed: int) -> Iterator[tuple[str, Recording]]:
    """What each valve is, and its recording."""
    for draw in draws:
        for hidden in (NOTHING, *EFFECTS):
            for number in range(6 * count if hidden == NOTHING else count):
                valve = draw_hand_valve(hidden, 1000 * draw + number)
                kind = "nothing" if hidden == NOTHING else "an effect"
                beside = " beside integral action" if valve.positioner else ""
                yield f"another hand, {kind}{beside}", valve.recording
    for kind, cases in (
        ("nothing hidden", draw_nulls(60, seed)),
        ("an effect hidden", draw_hidden(60, seed)),
        ("physics outside the catalogue", draw_unknown(60, seed)),
    ):
        for case in cases:
            yield kind, simulate_hidden(case)[1].recording


def main() -> None:
    """Draw, look, count."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, nargs="*", default=[1, 2, 3, 4])
    parser.add_argument("--valves", type=int, default=4)
    parser.add_argument("--seed", type=int, default=4064)
    options = parser.parse_args()
    counts: dict[str, list[int]] = {}
    for kind, recording in valves(options.draws, options.valves, options.seed):
        row = counts.setdefault(kind, [0, 0])
        row[0] += shows(recording)
        row[1] += 1
    for kind, (seen, of) in counts.items():
        print(f"{kind:48s}{seen:4d} of {of}")


if __name__ == "__main__":
    main()
