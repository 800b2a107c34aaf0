"""A few true sentences say where a residual is large, and noise gets none."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.signal import lfilter

from stemwatch.models.mismatch.evidence.locate import MOST_HOT, locate
from stemwatch.models.stickslip import kernel
from stemwatch.models.stickslip.problem import FitProblem, make_problem
from stemwatch.models.studies.simulator import PlantLoop, SimulatedValve, simulate_loop
from stemwatch.models.studies.simulator.loop import Load, LoadKind

S, J, SIGMA = 4.0, 1.5, 0.05
FACETS = {"phase", "direction", "rest", "travel", "speed", "time"}


@cache
def problem(seed: int = 11) -> FitProblem:
    """An hour of a flow loop with set-point steps."""
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.uniform(150.0, 500.0, 9))
    loop = PlantLoop(
        valve=SimulatedValve(S=S, J=J),
        setpoints=tuple((float(t), float(rng.uniform(35.0, 65.0))) for t in times),
        loads=(Load(kind=LoadKind.COLOURED, size=1.0, time_s=20.0),),
    )
    return make_problem(simulate_loop(loop, seed).recording)


def run(seed=11, **changes):
    """A free run of the kernel on the hour's OP: S and J, and what ``changes`` add."""
    q = np.zeros(kernel.N_PARAMETERS)
    q[[kernel.S, kernel.J, kernel.GAIN]] = S, J, 1.0
    q[[kernel.RATE_UP, kernel.RATE_DOWN]] = np.inf
    for name, value in changes.items():
        q[getattr(kernel, name)] = value
    return problem(seed).simulate(q)


def noise(seed=1, phi=0.0, size=SIGMA):
    """An hour of noise of the first order, standard deviation ``size``."""
    white = np.random.default_rng(seed).standard_normal(problem().op.size + 500)
    return size * lfilter([np.sqrt(1.0 - phi**2)], [1.0, -phi], white)[500:]


def located(mv, *, base=11, sigma=SIGMA):
    """The map of a position against S and J alone."""
    p = problem(base)
    return locate(p.op, mv, run(base), p.scored, p.block, p.interval_s, sigma)


def sentences(mv):
    """All hot places of a noisy position."""
    return " ".join(hot.sentence for hot in located(mv + noise()).hot)


@pytest.mark.parametrize(
    "phi", [0.7, *(pytest.param(phi, marks=pytest.mark.long) for phi in (0.0, 0.95))]
)
def test_noise_has_no_hot_place(phi):
    """For noise, white or correlated over up to 20 s, at most three records in a hundred have a hot
    place.
    """
    hot = [bool(located(run() + noise(seed, phi)).hot) for seed in range(66)]
    assert 0.03 * len(hot) >= sum(hot)


def test_a_delay_shows_after_slips():
    """A late command is found in the first seconds after a slip, with most of the mismatch."""
    first = located(run(DEAD_TIME_S=2.0) + noise()).hot[0]
    assert ("phase", "slip") == (first.facet, first.label)
    assert first.sentence.startswith("In the first 4 s after a slip, ")
    assert first.share > 0.5


def test_a_slow_direction_shows_in_that_direction():
    """A stem that can only fall slowly differs from the model only while it falls."""
    first = located(run(RATE_DOWN=0.3) + noise()).hot[0]
    assert ("direction", "falling") == (first.facet, first.label)
    assert first.sentence.startswith("While the stem falls, ")
    assert first.share > 0.6


def test_an_offset_is_said_once():
    """A reading that is off by a constant is one sentence, not one for each cell."""
    (only,) = located(run() + 1.0 + noise()).hot
    assert "All the time, the position lies 1.00 % above the model." == only.sentence


def test_a_late_step_shows_in_the_last_part():
    """What happens in the last minutes is placed there."""
    late = np.where(np.arange(problem().op.size) >= 3150, 0.5, 0.0)
    first = located(run() + late + noise()).hot[0]
    assert ("time", "minute 52 to 60") == (first.facet, first.label)
    assert first.z > 3.0


def test_a_stop_shows_at_the_end_of_travel():
    """A stem that is held at 49 % is found in the bands above, below the model."""
    text = sentences(np.minimum(run(), 49.0))
    assert "At a travel of" in text
    assert "below the model" in text


def test_hot_places_do_not_repeat_each_other():
    """At most five hot places, and each has half of its mismatch to itself."""
    for changes in ({"DEAD_TIME_S": 3.0}, {"LAG_UP_S": 4.0, "LAG_DOWN_S": 4.0}, {"GAIN": 1.05}):
        hot = located(run(**changes) + noise()).hot
        assert len(hot) <= MOST_HOT
        assert len({(h.facet, h.label) for h in hot}) == len(hot)


def test_cells_account_for_the_whole_residual():
    """Phase, direction, travel, speed and time cut the record without loss or overlap."""
    result = located(run(DEAD_TIME_S=1.0) + noise())
    assert {cell.facet for cell in result.cells} <= FACETS
    for facet in FACETS - {"rest"}:
        of_facet = [cell for cell in result.cells if cell.facet == facet]
        assert sum(cell.weight for cell in of_facet) == pytest.approx(1.0)
        assert sum(cell.share for cell in of_facet) == pytest.approx(1.0)


def test_the_grid_is_travel_by_phase():
    """One row for each band of travel and one column for each phase; empty places are None."""
    result = located(run() + noise())
    assert len(result.grid) == len(result.travel_edges) - 1
    assert {len(result.columns)} == {len(row) for row in result.grid}
    values = [value for row in result.grid for value in row if value is not None]
    assert np.median(values) == pytest.approx(SIGMA, rel=0.3)


def test_gaps_in_the_position_do_not_spread():
    """Samples without a position are left out, and the rest is still located."""
    mv = run(DEAD_TIME_S=2.0) + noise()
    mv[1000:1200] = np.nan
    result = located(mv)
    assert "slip" in {hot.label for hot in result.hot}
    assert all(np.isfinite(cell.rms) for cell in result.cells)


def test_fewer_than_a_hundred_samples_give_an_empty_map():
    """With fewer than a hundred samples to score there is no map, and no error."""
    p = problem()
    scored = np.arange(p.op.size) < 50
    located_in = locate(p.op, p.mv, run(), scored, p.block, 1.0, SIGMA)
    assert ((), (), ()) == (located_in.cells, located_in.hot, located_in.grid)


def test_a_valve_that_never_moves_is_no_error():
    """A resting model and a resting stem give a map without hot places."""
    p = problem()
    still = np.full(p.op.size, 50.0)
    located_in = locate(still, still + noise(), still, p.scored, p.block, 1.0, SIGMA)
    assert () == located_in.hot
    assert located_in.cells
