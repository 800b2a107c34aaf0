"""The right name before and after a planned test, on concealed valves of the proof's simulator.

    python tests/benchmarks/bench_plan_test.py [--cases N] [--seed S] [--amplitude A] [--minutes M]
        [--most K] [--json FILE]

Draws the proof's mixed cases of a seed, explains each, and takes those that leave something open:
rivals named together, or suspected and not named. For each it plans the test within the limits,
sets OP accordingly on the concealed valve at the end of the very same recording, and explains the
recording with the test in it. The same is done with a fixed staircase of the same length. The plant
is the proof's simulator, which shares no code with what is fitted.

A name is right where the first effect named is hidden in the valve and nothing is named that it
cannot be told from; on a valve with nothing hidden, where nothing is named and nothing open; on one
outside the catalogue, where it is said to be unknown.
"""

from __future__ import annotations

import argparse
import json
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from stemwatch.models.field_test.judgement import TestOutcome, judge_test
from stemwatch.models.field_test.plan import plan_test
from stemwatch.models.field_test.programme import LEAD_S, SetValue, TestLimits
from stemwatch.models.mismatch.explain import explain
from stemwatch.models.mismatch.findings import Finding, Mismatch
from stemwatch.models.recording import Recording
from stemwatch.models.studies.simulator.hidden import HiddenCase, draw_hidden, simulate_hidden
from stemwatch.models.studies.simulator.hidden.catalogue import RECORD
from stemwatch.models.studies.simulator.loop import ManualSpan, PlantLoop
from stemwatch.models.studies.simulator.simulate import simulate_loop

QUICK_S = 0.5  # duration of a step by hand
STAIRS = 20  # of the fixed staircase, both ways


@dataclass(frozen=True)
class Played:
    """One ambiguous case: what was right before, after the plan, after the staircase.

    ``in_rivals``: whether the truth (``wanted``) was among the rivals; ``outcome`` the result of
    ``judge_test`` for the recorded test, ``best`` the rival that fits it best.
    """

    place: int
    hidden: tuple[str, ...]
    concealment: str
    rivals: tuple[str, ...]
    kind: str
    promised: float | None
    minutes: float
    before: str
    planned: str
    staircase: str
    right_before: bool
    right_planned: bool
    right_staircase: bool
    in_rivals: bool
    wanted: str | None
    outcome: str
    best: str | None
    as_far: tuple[float, ...]
    leaves: float

    @property
    def followed(self) -> bool | None:
        """Whether the rival that fits best is the truth; ``None`` where the truth is not among the
        rivals.
        """
        return self.best == self.wanted if self.in_rivals and self.best is not None else None


def said(mismatch: Mismatch) -> str:
    """The finding in a few words."""
    names = " + ".join("|".join(effect.members) for effect in mismatch.effects)
    return names or mismatch.finding.value


def is_right(case: HiddenCase, mismatch: Mismatch) -> bool:
    """Whether the first name is the truth, and it alone."""
    physics = [slug for slug in case.effects if slug not in RECORD]
    if "unknown" in physics:
        return mismatch.finding is Finding.UNKNOWN
    if not physics:
        return mismatch.finding is Finding.NONE
    if not mismatch.effects:
        return False
    first = mismatch.effects[0]
    return first.slug in physics and first.members == (first.slug,)


def knots(values: Sequence[SetValue], begin_s: float, op: float) -> tuple[tuple[float, float], ...]:
    """OP by hand through ``values``, as the simulator wants it."""
    result, last = [(begin_s, op)], op
    for value in values[1:]:
        at, here = begin_s + value.at_s, op + value.change
        result += [(at, last), (at + QUICK_S, here)]
        last = here
    return tuple(result)


def fixed_staircase(minutes: float, amplitude: float) -> tuple[SetValue, ...]:
    """Up, down and back in even steps over the whole time."""
    every = (60.0 * minutes - 2.0 * LEAD_S) / (STAIRS + 1)
    quarter = STAIRS // 4
    up = [amplitude * k / quarter for k in range(1, quarter + 1)]
    way = [*up, *up[-2::-1], 0.0, *[-x for x in up], *[-x for x in up[-2::-1]], 0.0]
    values = [SetValue(at_s=LEAD_S + k * every, change=change) for k, change in enumerate(way)]
    return (SetValue(at_s=0.0, change=0.0), *values)


def with_time(case: HiddenCase, seconds: float) -> PlantLoop:
    """The loop with ``seconds`` more at its end; one in manual goes back to automatic for them."""
    loop, end = case.loop, case.loop.duration_s
    manual = tuple(replace(span, stop_s=min(span.stop_s, end)) for span in loop.manual)
    moves = tuple(move for move in loop.setpoints if move[0] < end)
    return replace(loop, duration_s=end + seconds, manual=manual, setpoints=moves)


def played(case: HiddenCase, values: Sequence[SetValue], op: float, seconds: float) -> Recording:
    """The recording with the test at its end; the part before the test does not depend on the
    test.
    """
    loop, begin = with_time(case, seconds), case.loop.duration_s
    hand = ManualSpan(start_s=begin, stop_s=loop.duration_s + 60.0, knots=knots(values, begin, op))
    return simulate_loop(replace(loop, manual=(*loop.manual, hand)), case.seed).recording


def judge(place: int, case: HiddenCase, limits: TestLimits) -> Played | None:
    """One case, or ``None`` where nothing is open."""
    # The noise before the test is the same for every test only if the length is the same.
    complete = with_time(case, limits.duration_s)
    samples = round(case.loop.duration_s / case.loop.archive.interval_s)
    recording = simulate_loop(complete, case.seed).recording.part(0, samples)
    before = explain(recording)
    question = before.open_question
    if question is None or len(question.models) < 2:
        return None
    plan = plan_test(question, limits)
    test, op = plan.test, plan.op
    minutes = limits.duration_s / 60.0
    truth = [slug for slug in case.effects if slug not in RECORD]
    expected = truth[0] if len(truth) == 1 else "" if not truth else None
    inside = expected in question.rivals
    after, judged = before, None
    if test is not None:
        minutes = test.programme.duration_s / 60.0
        with_plan = played(case, test.programme.values(), op, limits.duration_s)
        part = samples + round(test.programme.duration_s / case.loop.archive.interval_s)
        with_plan = with_plan.part(0, part)
        after = explain(with_plan)
        judged = judge_test(question, with_plan.part(samples, part))
    stairs = played(case, fixed_staircase(minutes, limits.amplitude), op, limits.duration_s)
    part = samples + round(60.0 * minutes / case.loop.archive.interval_s)
    by_stairs = explain(stairs.part(0, part))
    return Played(
        place=place,
        hidden=case.hidden,
        concealment=case.concealment,
        rivals=question.rivals,
        kind=plan.kind.value,
        promised=None if test is None else test.probability,
        minutes=round(minutes, 1),
        before=said(before),
        planned=said(after),
        staircase=said(by_stairs),
        right_before=is_right(case, before),
        right_planned=is_right(case, after),
        right_staircase=is_right(case, by_stairs),
        in_rivals=inside,
        wanted=expected,
        best=None if judged is None else judged.models[judged.best].slug,
        outcome="-" if judged is None else judged.outcome.value,
        as_far=() if judged is None else judged.as_far,
        leaves=0.0 if judged is None else judged.leaves,
    )


def main() -> None:
    """Play the cases and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=100)
    parser.add_argument("--seed", type=int, default=9393)
    parser.add_argument("--amplitude", type=float, default=10.0)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--first", type=int, default=0, help="Place of the first case.")
    parser.add_argument("--most", type=int, default=1000, help="Ambiguous cases at most.")
    parser.add_argument("--json", type=Path)
    requested = parser.parse_args()
    limits = TestLimits(amplitude=requested.amplitude, duration_s=60.0 * requested.minutes)
    started, rows = time.perf_counter(), []
    for index, drawn in enumerate(draw_hidden(requested.cases, requested.seed)):
        if index < requested.first:
            continue
        case, _ = simulate_hidden(drawn)
        row = judge(index, case, limits)
        if row is not None:
            rows.append(row)
            print(line(row), flush=True)
        if len(rows) >= requested.most:
            break
    print(summary(rows))
    print(f"{time.perf_counter() - started:.0f} s")
    if requested.json:
        requested.json.write_text(json.dumps([asdict(row) for row in rows], indent=1))


def line(row: Played) -> str:
    """One case in one line."""
    promised = "-" if row.promised is None else f"{row.promised:.2f}"
    marks = "".join(
        "+" if right else "-"
        for right in (row.right_before, row.right_planned, row.right_staircase)
    )
    return (
        f"{row.place:4d} {marks} {'+'.join(row.hidden) or 'nothing'} ({row.concealment}) rivals "
        f"{'|'.join(slug or 'S and J' for slug in row.rivals)}: {row.kind} {promised}, "
        f"{row.minutes} min; {row.before} -> {row.planned}; staircase {row.staircase}; "
        f"{row.outcome} {'S and J' if row.best == '' else row.best}, "
        f"as far {[round(far, 3) for far in row.as_far]}, leaves {row.leaves:.2f}"
    )


def summary(rows: Sequence[Played]) -> str:
    """The table."""
    lines = ["", "cases               n   before  plan  staircase"]
    groups: list[tuple[str, Sequence[Played]]] = [("all", rows)]
    kinds = Counter(row.kind for row in rows)
    groups.extend((kind, [row for row in rows if row.kind == kind]) for kind in kinds)
    groups.append(("one effect hidden", [r for r in rows if r.in_rivals and r.hidden]))
    groups.append(("nothing hidden", [r for r in rows if not r.hidden]))
    for name, group in groups:
        counts = (
            sum(r.right_before for r in group),
            sum(r.right_planned for r in group),
            sum(r.right_staircase for r in group),
        )
        lines.append(f"{name:18} {len(group):3}  {counts[0]:6} {counts[1]:5} {counts[2]:10}")
    for name, group in (
        ("truth among the rivals", [row for row in rows if row.in_rivals]),
        ("truth not among them", [row for row in rows if not row.in_rivals]),
    ):
        named = [row for row in group if row.outcome == TestOutcome.FOLLOWS]
        counted = Counter(row.outcome for row in group)
        lines.append(
            f"judged, {name}: {len(group)}; named right {sum(r.followed is True for r in named)}, "
            f"wrong {sum(r.followed is not True for r in named)}, cannot tell "
            f"{counted[TestOutcome.CANNOT_TELL]}, follows none {counted[TestOutcome.NONE_FOLLOWS]}"
        )
    judged = [row for row in rows if row.followed is not None]
    if judged:
        promised = float(np.mean([row.promised for row in judged]))
        right = sum(bool(row.followed) for row in judged)
        lines.append(
            f"truth among the rivals: {len(judged)}; it followed the test best in {right} "
            f"({100.0 * right / len(judged):.0f} %, promised {100.0 * promised:.0f} %)"
        )
    return "\n".join(lines)


if __name__ == "__main__":
    main()
