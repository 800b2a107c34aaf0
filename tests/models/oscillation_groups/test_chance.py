"""How often unrelated loops look as coherent as those of a group."""

from __future__ import annotations

import numpy as np
import pytest

from stemwatch.models.oscillation_groups.chance import log_chance, log_chances, log_expected


def spectra(rng: np.random.Generator, count: int, bins: int, width: float) -> np.ndarray:
    """(count, bins) of random phases; their powers are a line ``width`` bins wide at a place of its
    own each, or flat."""
    place = rng.uniform(0, bins, (count, 1))
    size = np.exp(-0.5 * ((np.arange(bins) - place) / width) ** 2) + 1e-3
    return size * (rng.normal(size=(count, bins)) + 1j * rng.normal(size=(count, bins)))


def of_one(reference: np.ndarray) -> np.ndarray:
    """(bins, 1) of unit length."""
    return (reference / np.linalg.norm(reference))[:, None]


@pytest.mark.parametrize(
    ("width", "bins"),
    [
        # Each width and each count of bins has its turn in the short run.
        pytest.param(width, bins, marks=[] if k == n else [pytest.mark.long])
        for k, width in enumerate((1.0, 4.0, 1e3))
        for n, bins in enumerate((5, 12, 40))
    ],
)
def test_the_chance_of_unrelated_spectra_is_no_larger_than_said(bins: int, width: float) -> None:
    """Of 2,000 unrelated pairs hardly more than a share p have a chance of p or less, whether they
    are lines or broad. Four standard errors of the count are allowed."""
    rng = np.random.default_rng(4060)
    references, parts = (spectra(rng, 2000, bins, width) for _ in range(2))
    chances = np.exp(
        [log_chance(of_one(one), part) for one, part in zip(references, parts, strict=True)]
    )
    for p in (0.2, 0.05, 0.01):
        assert np.mean(chances <= p) <= p + 4.0 * np.sqrt(p / 2000)


def test_one_oscillation_in_two_loops_is_hardly_chance() -> None:
    """A wandering one over thirty bins, with a tenth of noise in each."""
    rng = np.random.default_rng(4061)
    wave, *noise = spectra(rng, 3, 30, 5.0)
    one, other = (wave + 0.1 * each for each in noise)
    assert log_chance(of_one(one), other) < np.log(1e-6)


def test_few_bins_prove_nothing() -> None:
    """One bin is always coherent with one bin, and silence with anything."""
    one = np.ones((1, 1), dtype=complex)
    assert log_chance(one, np.array([2.0 + 1.0j])) == 0.0
    assert log_chance(np.ones((4, 1)) / 2.0, np.zeros(4, dtype=complex)) == 0.0


def test_equal_signals_have_a_finite_chance() -> None:
    """Two recordings of one signal, such as PV of a cascade under two tags."""
    part = spectra(np.random.default_rng(4062), 1, 20, 1e3)[0]
    chance = log_chance(of_one(part), part)
    assert np.isfinite(chance)
    assert chance < np.log(1e-9)


def test_each_member_is_compared_with_the_others() -> None:
    """Of three loops the two that share an oscillation are surprising beside the rest, not the
    third."""
    rng = np.random.default_rng(4063)
    wave, first, second, third = spectra(rng, 4, 25, 1e3)
    parts = np.stack([3.0 * wave + 0.3 * first, -2.0 * wave + 0.2 * second, third])
    chances = log_chances(parts, of_one, lambda rows: np.linalg.svd(rows)[2][0])
    assert chances[2] > np.log(0.01)
    assert max(chances[:2]) < np.log(1e-4)


def test_more_searches_and_more_loops_are_expected_to_show_more() -> None:
    """Groups by chance: one pair of chance p among m loops, begun from s of them, is expected
    s (m - 1) p times."""
    pair = np.log(np.array([1e-3, 1e-3]))
    assert np.exp(log_expected(pair, 15, 10)) == pytest.approx(10 * 14 * 1e-3)
    assert np.exp(log_expected(pair, 2, 1)) == pytest.approx(1e-3)
