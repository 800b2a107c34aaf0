"""The likelihood of a loop where all is known but the stem."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import multivariate_normal

from stemwatch.models.studies.loops.draws import (
    WARM_UP,
    LoopScans,
    draw_with_scans,
)
from stemwatch.models.studies.loops.random_signals import coloured, many_scales
from tests.benchmarks import stem_filter
from tests.benchmarks.stem_filter import (
    NO_WAVE,
    KnownLoop,
    Wave,
    behind_air,
    pole_of,
    stem_likelihood,
    wave_of,
)


def told(scans: LoopScans, last: int | None = None, waves=(NO_WAVE, NO_WAVE)) -> KnownLoop:
    """A loop that has no steps and no waves of its own, up to scan ``last``."""
    wandering = scans.disturbances.wandering
    part = slice(WARM_UP, last)
    air = behind_air(scans, WARM_UP)
    seen = (scans.pv - scans.sp[0])[part]
    return KnownLoop(
        numbers=scans.numbers,
        air=air[: seen.size],
        seen=seen,
        rounding=1e-6,
        shaped=np.zeros(seen.size),
        wandering=np.array([(item.size, pole_of(item.time)) for item in wandering]),
        where=np.ones((len(wandering), seen.size)),
        noise=(scans.noise_size, pole_of(scans.noise_time)),
        waves=waves,
    )


@pytest.mark.long
def test_without_friction_it_is_the_gaussian_density(monkeypatch) -> None:
    """One stem that follows OP: the product of the filter's predictions is the density of all of
    PV at once, with waves of the load and of PV as well."""
    monkeypatch.setattr(stem_filter, "sound_ways", lambda _: np.zeros((4, 2)))
    wave = Wave(past=np.array([1.6, -0.8]), variance=0.02)
    loop = told(draw_with_scans(5151, 5)[1], WARM_UP + 30, (wave, wave))
    n, linear = loop.seen.size, stem_filter._linear_part(loop)
    state, covariance = np.zeros(linear.enters.size), linear.start
    means, reaches = np.empty(n), [np.eye(state.size)]
    covariances = []
    for k in range(n):
        means[k] = linear.sees @ state
        covariances.append(covariance)
        step = linear.step + np.outer(linear.enters, linear.load[k])
        deviation = loop.air[k] - loop.numbers.output
        bent = deviation * max(1.0 + 0.1 * loop.numbers.bend * deviation, 0.2)
        state = step @ state + linear.enters * bent
        covariance = step @ covariance @ step.T + linear.added
        reaches.append(step)
    of_pv = np.empty((n, n))
    for i in range(n):
        carried = covariances[i]
        for j in range(i, n):
            if j > i:
                carried = reaches[j] @ carried
            of_pv[i, j] = of_pv[j, i] = linear.sees @ carried @ linear.sees
    density = multivariate_normal(means, of_pv + loop.rounding * np.eye(n)).logpdf(loop.seen)
    found = stem_likelihood(loop, False, np.random.default_rng(1))
    assert found.log_likelihood == pytest.approx(density, rel=1e-3)


@pytest.mark.long
@pytest.mark.parametrize(("place", "sticks"), [(8, True), (13, False)])
def test_it_tells_which_stem_there_is(place, sticks) -> None:
    """The true kind of stem is far more likely, and the S of one that sticks is found."""
    drawn, scans = draw_with_scans(5151, place)
    sound, sticking = (
        stem_likelihood(told(scans), it, np.random.default_rng(1)) for it in (False, True)
    )
    gained = sticking.log_likelihood - sound.log_likelihood
    assert gained > 20.0 if sticks else gained < -5.0
    if sticks:
        assert sticking.S == pytest.approx(drawn.S, rel=0.1)


def test_a_wave_is_known_by_its_past_values() -> None:
    """Two past values are found again; of a square wave as well no prediction explodes, and a
    still signal is no wave."""
    rng = np.random.default_rng(1)
    values = lfilter([1.0], [1.0, -1.6, 0.8], rng.standard_normal(20_000))
    found = wave_of(values)
    assert found.past[:2] == pytest.approx([1.6, -0.8], abs=0.05)
    assert found.variance == pytest.approx(1.0, abs=0.05)
    square = wave_of(np.sign(np.sin(np.arange(3000) / 20.0)))
    assert np.max(np.abs(np.linalg.eigvals(square.step))) < 1.0
    assert wave_of(np.ones(100)) is NO_WAVE


@pytest.mark.long
def test_the_load_is_the_sum_of_what_is_told() -> None:
    """Wandering parts have the size of the load that is no step and no wave."""
    rng = np.random.default_rng(1)
    assert np.std(coloured(50_000, 5.0, rng)) == pytest.approx(1.0, abs=0.05)
    assert np.std(many_scales(50_000, rng)) == pytest.approx(1.0, abs=0.3)
    sizes, shares = [], []
    for place in range(40):
        acting = draw_with_scans(5151, place, "quiet")[1].disturbances
        sizes.append(np.sum([part.size**2 for part in acting.wandering]))
        shares.append(np.mean((acting.load - acting.shaped) ** 2))
    assert np.sum(shares) == pytest.approx(np.sum(sizes), rel=0.4)
