"""The likelihood of a recording is a probability, and is largest where the stem really was."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import t as student

from stemwatch.models.mismatch.likelihood.breakaway_filter import (
    GIVEN_UP,
    log_likelihood,
    log_likelihoods,
)
from stemwatch.models.mismatch.likelihood.stem_courses import above
from stemwatch.models.mismatch.stem_model import stem as stem_number
from stemwatch.models.mismatch.stem_model.kernel import Record
from stemwatch.models.mismatch.stem_model.stem import Stem, Tables

COURSES = 48


def stem_of(samples, S=4.0, J=1.2, **numbers):
    """Numbers and tables of one stem."""
    stem = Stem.neutral(samples, 1.0)
    q = stem.numbers.copy()
    q[stem_number.S], q[stem_number.J] = S, J
    for name, value in numbers.items():
        q[getattr(stem_number, name)] = value
    tables = stem.friction, stem.force, stem.breakaway, stem.wander
    return q, Tables(*(table[None].copy() for table in tables))


def likelihood(
    force, mv, q, tables, *, step=0.0, sigma=0.1, scatter=0.08, slack=None, block=None, least=None
):
    """The logarithms of the likelihood of every block."""
    n, none = force.size, np.empty(0, dtype=np.int64)
    marks = np.zeros(n, dtype=np.uint8)
    marks[0] = 1
    block = np.zeros(n, dtype=np.int64) if block is None else block
    by_block = np.empty(max(int(block.max()) + 1, 1))
    log_likelihood(
        force,
        q,
        tables,
        Record(mv, marks, none, none, 1.0, 0.0),
        block,
        np.zeros(n) if slack is None else slack,
        step,
        sigma,
        scatter,
        COURSES,
        np.full(by_block.size, -np.inf) if least is None else least,
        by_block,
    )
    return by_block


def test_the_tail_is_that_of_students_distribution() -> None:
    """Of four degrees of freedom; values of printed tables."""
    for z, probability in ((0.0, 0.5), (1.533, 0.1), (2.132, 0.05), (3.747, 0.01)):
        assert above(z) == pytest.approx(probability, abs=2e-4)
        assert above(-z) == pytest.approx(1.0 - probability, abs=2e-4)


@given(st.floats(-1e6, 1e6))
def test_the_tail_keeps_its_digits_however_small(z: float) -> None:
    """A probability of 1e-20 is told from 0 and from one of 2e-20."""
    assert above(z) == pytest.approx(float(student.sf(z, 4)), rel=1e-9, abs=0.0)


@given(st.floats(0.005, 0.3), st.floats(0.02, 2.0), st.floats(-90.0, 90.0))
def test_a_reading_that_is_far_off_in_coarse_steps_has_a_likelihood(
    sigma: float, step: float, off: float
) -> None:
    """It is that of Student's tail, however far the reading is off."""
    q, tables = stem_of(40)
    force, mv = np.full(40, 50.0), np.full(40, 50.0)
    alone = float(likelihood(force, mv, q, tables, step=step, sigma=sigma)[0])
    mv[20] += off
    lost = alone - float(likelihood(force, mv, q, tables, step=step, sigma=sigma)[0])
    ends = (abs(off) - 0.5 * step) / sigma, (abs(off) + 0.5 * step) / sigma
    there = student.sf(ends[0], 4) - student.sf(ends[1], 4)
    of_none = 2.0 * student.cdf(0.5 * step / sigma, 4) - 1.0
    assert lost == pytest.approx(float(np.log(of_none / there)), abs=0.02)


@pytest.mark.parametrize(
    "numbers",
    [
        {},
        {"RESTICK": 0.6},
        {"PLAY": 1.0},
        {"ASYMMETRY": 0.4},
        {"CREEP": 0.2},
        {"GIVES": 0.05},
        {"DRAG_S": 2.0},
        {"HYSTERESIS": 1.5, "WAY": 3.0, "BY_PLACE": 1.0},
        {"SOONER": 0.5},
    ],
    ids=str,
)
def test_the_probabilities_of_all_readings_sum_to_one(numbers) -> None:
    """Of three readings in steps, whatever the stem does: up, down, or nothing."""
    q, tables = stem_of(4, **numbers)
    force = np.array([50.0, 52.4, 52.9, 49.0])
    values = np.arange(40.0, 60.5, 1.0)
    total = 0.0
    for readings in product(values, repeat=3):
        mv = np.array([50.0, *readings])
        total += float(np.exp(likelihood(force, mv, q, tables, step=1.0, sigma=0.3)[0]))
    assert total == pytest.approx(1.0, abs=0.02)


def slipping(samples=1200, S=4.0, J=1.2, noise=0.1, scatter=0.06, seed=3, sooner=0.0):
    """OP and MV of a stem whose breakaways scatter, written anew: levels by Choudhury's element; it
    may let go ``sooner``, percent at 1 %/s, as bristles do."""
    rng = np.random.default_rng(seed)
    op = 50.0 + 8.0 * np.sin(2.0 * np.pi * np.arange(samples) / 170.0)
    op += 3.0 * np.sin(2.0 * np.pi * np.arange(samples) / 53.0)
    x, side, moving, share = op[0], 0.0, False, 1.0
    stem = np.empty(samples)
    for k, command in enumerate(op):
        f = command - x
        if moving and side * f - 0.5 * (S - J) <= 1e-9:
            moving, share = False, 1.0 + scatter * rng.standard_normal()
        less = min(sooner * abs(command - op[max(k - 1, 0)]) ** (2.0 / 3.0), J)
        if not moving and abs(f) > (0.5 * (S + J) - less) * share:
            moving, side = True, np.sign(f)
        if moving:
            x += side * max(side * f - 0.5 * (S - J), 0.0)
        stem[k] = x
    return op, stem + noise * rng.standard_normal(samples)


def test_s_and_j_are_the_most_likely_where_they_are_true() -> None:
    """Each against its neighbours, with breakaways that scatter and noise."""
    op, mv = slipping()

    def total(S, J):
        return float(likelihood(op, mv, *stem_of(op.size, S, J))[0])

    best = total(4.0, 1.2)
    for S, J in ((3.6, 1.2), (4.4, 1.2), (4.0, 0.6), (4.0, 1.8)):
        assert best > total(S, J) + 10.0, (S, J)


@pytest.mark.parametrize("sooner", [0.0, 0.3])
def test_how_much_sooner_a_quick_force_lets_the_stem_go_is_most_likely_where_it_is_true(
    sooner: float,
) -> None:
    """Against letting go at the same level however quick, and as much sooner again."""
    op, mv = slipping(samples=2400, scatter=0.03, sooner=sooner)
    likely = {
        size: float(likelihood(op, mv, *stem_of(op.size, SOONER=size), scatter=0.03)[0])
        for size in (0.0, 0.3, 0.6)
    }
    others = [total for size, total in likely.items() if size != sooner]
    assert likely[sooner] > max(others) + 10.0


def test_no_stem_lets_go_below_its_kinetic_level() -> None:
    """However quick the force is: twice as much sooner is the same then."""
    op, mv = slipping(samples=600)
    much, more = (likelihood(op, mv, *stem_of(op.size, SOONER=size))[0] for size in (1e3, 2e3))
    assert much == pytest.approx(more, rel=1e-12)


def test_the_scatter_is_found() -> None:
    """A scatter that is far too small or too large is less likely than the true one."""
    op, mv = slipping(samples=3000, scatter=0.08)
    q, tables = stem_of(op.size)
    likely = {s: float(likelihood(op, mv, q, tables, scatter=s)[0]) for s in (0.01, 0.06, 0.3)}
    assert likely[0.06] > max(likely[0.01], likely[0.3]) + 3.0


def test_what_is_not_scored_counts_nothing_and_blocks_add_up() -> None:
    """The parts of a record are the parts of its likelihood."""
    op, mv = slipping(samples=400)
    q, tables = stem_of(op.size)
    whole = likelihood(op, mv, q, tables)[0]
    parts = likelihood(op, mv, q, tables, block=np.arange(op.size) // 100)
    assert parts.size == 4
    assert parts.sum() == pytest.approx(whole, rel=1e-9)
    block = np.where(np.arange(op.size) < 200, 0, -1)
    spoiled = mv.copy()
    spoiled[200:] += 30.0
    # What comes later cannot change what is scored.
    assert likelihood(op, spoiled, q, tables, block=block)[0] == pytest.approx(parts[:2].sum())


def test_a_value_within_its_slack_costs_nothing() -> None:
    """What an archive drew is as likely anywhere within its deviation."""
    op, mv = slipping(samples=300, noise=0.0, scatter=0.0)
    q, tables = stem_of(op.size)
    slack = np.full(op.size, 0.5)
    exact = likelihood(op, mv, q, tables, slack=slack)[0]
    off = likelihood(op, mv + 0.4, q, tables, slack=slack)[0]
    far = likelihood(op, mv + 0.9, q, tables, slack=slack)[0]
    assert off == pytest.approx(exact, abs=1.0)
    assert far < exact - 100.0


def test_tables_say_what_numbers_say() -> None:
    """The same friction, force and reading, told by place, along the record or by one number."""
    op, mv = slipping()
    plain = likelihood(op, mv, *stem_of(op.size))[0]
    q, tables = stem_of(op.size, S=3.4, BY_PLACE=1.0)
    tables.friction[:], tables.force[:] = 0.3, 0.5
    assert likelihood(op + 0.5, mv, q, tables)[0] == pytest.approx(plain, rel=1e-9)
    time = np.arange(op.size) / op.size - 0.5
    q, tables = stem_of(op.size, DRIFT=2.0, BY_TIME=1.0)
    wander = np.sin(9.0 * time)
    tables.wander[0, :-1] = wander
    drifting = mv + 2.0 * time + wander
    assert likelihood(op, drifting, q, tables)[0] == pytest.approx(plain, rel=1e-9)


def test_a_run_that_has_fallen_behind_is_given_up() -> None:
    """After the block in which its sum is below the limit; above it nothing changes."""
    op, mv = slipping()
    block = np.arange(op.size) * 6 // op.size
    q, tables = stem_of(op.size)
    whole = likelihood(op, mv, q, tables, block=block)
    ahead = np.cumsum(whole)
    assert likelihood(op, mv, q, tables, block=block, least=ahead - 1.0) == pytest.approx(whole)
    limits = np.where(np.arange(6) == 2, ahead + 1.0, -np.inf)
    left = likelihood(op, mv, q, tables, block=block, least=limits)
    assert left[:3] == pytest.approx(whole[:3])
    assert np.all(left[3:] == GIVEN_UP)


@pytest.mark.parametrize("behind", [np.inf, 30.0])
def test_several_stems_are_as_likely_as_each_alone(behind: float) -> None:
    """One after the other, each over its own force; what falls far behind the best is given up."""
    force = 50.0 + 8.0 * np.sin(np.arange(600) / 40.0)
    forces = np.stack((force, force + 0.5))
    block, none, marks = np.arange(600) // 100, np.empty(0, dtype=np.int64), np.zeros(600, np.uint8)
    marks[0] = 1
    stems = [stem_of(600, S=S) for S in (4.0, 4.2, 12.0)]
    numbers = np.stack([q for q, _ in stems])
    tables = Tables(*(np.concatenate(each) for each in zip(*(t for _, t in stems), strict=True)))
    mv = force + 0.05 * np.random.default_rng(5).standard_normal(600)
    rows, scales = np.array([0, 1, 0]), np.array([[0.1, 0.08], [0.2, 0.08], [0.1, 0.05]])
    by_block = np.empty((3, 6))
    best = log_likelihoods(
        forces,
        rows,
        numbers,
        tables,
        Record(mv, marks, none, none, 1.0, 0.0),
        block,
        np.zeros(600),
        0.0,
        scales,
        COURSES,
        behind,
        -np.inf,
        np.full(6, -np.inf),
        by_block,
    )
    alone = [
        likelihood(forces[row], mv, *stem, sigma=sigma, scatter=scatter, block=block)
        for stem, row, (sigma, scatter) in zip(stems, rows, scales, strict=True)
    ]
    assert np.array_equal(by_block[0], alone[0])
    given_up = by_block[2, -1] == GIVEN_UP
    assert given_up == (behind < np.inf)
    assert given_up or np.array_equal(by_block[2], alone[2])
    assert alone[2].sum() < alone[0].sum() - 30.0
    assert behind == np.inf or best == pytest.approx(max(one.sum() for one in alone))
