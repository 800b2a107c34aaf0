"""The loops by another hand: repeatable, and their stems move as they say."""

from __future__ import annotations

import re

import numpy as np
import pytest

from stemwatch.models.recording import Role
from stemwatch.models.without_position.no_sign import MOSTLY
from stemwatch.models.without_position.suspicion import trained_judge
from stemwatch.service.studies.without_position.draw import LoopToDraw
from tests.benchmarks.bench_other_loops import FAMILY, Judged, judged, look_at, report
from tests.benchmarks.other_loops import HE, KANO, SLIP, Numbers, _dry_stem, _stem_of_he, draw


def test_a_seed_gives_the_same_loop_and_every_other_one_sticks() -> None:
    """To the bit; another number gives another loop."""
    first, again, other = draw(3, 4), draw(3, 4), draw(3, 5)
    np.testing.assert_array_equal(first.recording.op.values, again.recording.op.values)
    assert first.S == again.S > 0.0 == other.S
    assert first.recording.get(Role.PV) is not None
    assert len(first.recording) != len(other.recording)


@pytest.mark.parametrize("stem", [SLIP, KANO, HE])
@pytest.mark.parametrize("J", [0.0, 2.0, 3.0])
def test_a_stem_that_is_turned_stays_for_S_and_jumps_by_J(stem: int, J: float) -> None:
    """A slow sawtooth of 10 % around a stem with S = 4 %, after its first slope."""
    S = 4.0
    numbers = Numbers(*[0.0] * len(Numbers._fields))._replace(
        stem=stem, static=0.5 * (S + J), sliding=0.5 * (S - J), step=0.01, slip=0.05
    )
    air = 0.01 * np.concatenate([np.arange(1000), np.arange(1000, 0, -1)])
    stems, x, side, left = [], 0.0, 0.0, 0.0
    for rise, value in zip(np.diff(air, prepend=0.0), air, strict=True):
        if stem == HE:
            x, left, _ = _stem_of_he(numbers, value, rise, x, left)
        else:
            x, side, _ = _dry_stem(numbers, value, rise, x, side)
        stems.append(x)
    down = np.array(stems[1000:])
    moved = int(np.argmax(np.abs(down - down[0]) > 0.02))
    # That of He may have been pushed on since its last jump, by less than another jump takes.
    assert S - 0.1 <= 0.01 * moved <= S + 0.2 + (J if stem == HE else 0.0)
    if stem == KANO:
        assert down[moved - 1] - down[moved] == pytest.approx(max(J, 0.01), abs=0.02)


def judged_loops(seed: int, loops: range) -> list[Judged]:
    """These loops of a seed, judged as screening does."""
    judge = trained_judge()
    drawn = [found for place in loops for found in look_at(LoopToDraw(seed, place, FAMILY))]
    return [judged(judge, kind, seen_draw) for kind, seen_draw in drawn]


def test_the_report_counts_every_loop_by_cause_and_by_kind() -> None:
    """The counts of the causes add up to those of all, and so do those of the kinds."""
    loops = judged_loops(4075, range(6))
    lines = list(report(loops))
    counts = [[int(n) for n in re.findall(r"\d+", line.partition(": ")[2])] for line in lines]
    of_causes = len({loop.said.story for loop in loops})
    first = lines.index(next(line for line in lines if line.startswith(loops[0].said.story)))
    for of_group in (counts[first : first + of_causes], counts[first + of_causes :]):
        assert np.sum(of_group, axis=0).tolist() == counts[0]
    assert sum(counts[0][:-1]) == len(loops)


@pytest.mark.long
@pytest.mark.study
def test_no_more_than_one_sticking_valve_of_five_is_told_that_its_S_would_have_shown() -> None:
    """Among loops that gave no limit. The sentence promises this and no more."""
    assert MOSTLY == "in four cases of five"
    loops = judged_loops(4076, range(0, 320, 2))
    assert sum(loop.said.should_have_shown for loop in loops) <= len(loops) / 5
