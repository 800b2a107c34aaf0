"""Networks started from a fitted stick-slip element: what the start is, and what it is worth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stemwatch.models.narx.actuator import actuator_output
from stemwatch.models.narx.architecture import NO_ACTUATOR, StickSlipStart
from stemwatch.models.narx.example import NarxExample, NarxFit, NarxSettings
from stemwatch.models.narx.network import NarxNetwork
from stemwatch.models.narx.training import train
from tests.models.stick_slip_element import stick_slip

N = 2400
SHAPES = {
    "deadband": (4.0, 0.0),
    "undershoot": (5.0, 2.0),
    "no offset": (4.0, 4.0),
    "overshoot": (4.0, 5.0),
}
ACTUATOR = dict(NO_ACTUATOR) | {"dead_time_s": 3.0, "lag_up_s": 6.0, "lag_down_s": 6.0}


def example(
    S: float, J: float, *, noise: float = 0.1, seed: int = 0, **start: object
) -> NarxExample:
    """A valve of a wandering loop, and a start that knows S and J unless told otherwise."""
    rng = np.random.default_rng(seed)
    t = np.arange(N)
    op = 50 + rng.normal(0, 0.03, N) + 5 * np.sin(t / 31 + seed) + 4 * np.sin(t / 57)
    for at in range(80, N, 160):
        op[at:] += 3 * np.sin(at * (seed + 1))
    start = {"S": S, "J": J} | start
    passed_on = actuator_output(op, 1.0, start.get("actuator", NO_ACTUATOR))
    return NarxExample(
        valve=f"FV-{seed}",
        op=op,
        mv=stick_slip(passed_on, S, J) + rng.normal(0, noise, N),
        usable=np.ones(N, dtype=bool),
        train_until=1440,
        interval_s=1.0,
        start=StickSlipStart(**start),
    )


def percent(fit: NarxFit) -> float:
    return fit.heldout.fit_percent if fit.heldout else -100.0


def weights_of(fit: NarxFit) -> np.ndarray:
    assert fit.network is not None, fit.reason
    return np.concatenate([array.ravel() for array in fit.network.weights.values()])


ONLY_FITTED = NarxSettings(seeds=1, fitted_seeds=1, horizons=(300,), steps=(1,), damping=1e8)


@pytest.mark.parametrize(("S", "J"), SHAPES.values(), ids=SHAPES)
def test_the_start_is_the_element_itself(S: float, J: float) -> None:
    """Hardly trained at all, it follows a valve of this S and J in the free run."""
    fit = train([example(S, J, noise=0.0, seed=3)], ONLY_FITTED)[0]
    assert percent(fit) > 96


def test_the_start_knows_the_actuator_and_the_reading() -> None:
    """Dead time, lag, a reading in other units and turned round: the element all the same."""
    case = example(4.0, 1.0, noise=0.0, seed=4, actuator=ACTUATOR)
    turned = replace(
        case,
        mv=900.0 - 7.0 * case.mv,
        start=StickSlipStart(S=4.0, J=1.0, gain=-7.0, zero=900.0, actuator=ACTUATOR),
    )
    for fit in train([case, turned], ONLY_FITTED):
        assert percent(fit) > 96


@pytest.mark.long
def test_half_the_members_from_the_element_beat_random_members() -> None:
    """On every shape the grey-box ensemble is nearly as good or better, and better in the mean."""
    cases = [example(*levels, seed=index) for index, levels in enumerate(SHAPES.values())]
    grey = [percent(fit) for fit in train(cases)]
    random = [percent(fit) for fit in train([replace(case, start=None) for case in cases])]
    assert np.mean(grey) > np.mean(random) + 2
    assert min(np.subtract(grey, random)) > -3


def test_a_late_valve_needs_its_actuator() -> None:
    """Two lags of OP say nothing of a command some samples old; the start's actuator does."""
    case = example(3.0, 1.0, seed=6, actuator=ACTUATOR)
    knows, does_not = train([case, replace(case, start=None)])
    assert knows.heldout.rmse < 0.75 * does_not.heldout.rmse


def test_a_wrong_start_costs_little() -> None:
    """Members started from a useless S and J are not kept before better random ones."""
    case = example(4.0, 1.0, seed=7)
    wrong = replace(case, start=StickSlipStart(S=0.1, J=0.0))
    misled, random = train([wrong, replace(case, start=None)])
    assert percent(misled) > percent(random) - 8


def test_the_log_tells_the_fitted_members_apart() -> None:
    """Six random members through three stages, then two fitted ones through the longest runs."""
    fit = train([example(4.0, 1.0)])[0]
    assert [(stage.horizon, len(stage.steps)) for stage in fit.log] == [
        *((1, 6), (20, 6), (300, 6)),
        (300, 2),
    ]


def test_the_start_changes_nothing_for_the_neighbours() -> None:
    """With and without a start, in one batch or each alone: the same networks, in order."""
    cases = [example(4.0, 1.0, seed=1), replace(example(3.0, 3.0, seed=2), start=None)]
    cases.append(example(5.0, 0.0, seed=5, actuator=ACTUATOR))
    together = train(cases)
    for case, fit in zip(cases, together, strict=True):
        alone = train([case])[0]
        assert case.valve == fit.valve
        np.testing.assert_allclose(weights_of(fit), weights_of(alone), rtol=1e-6, atol=1e-9)


def test_no_fitted_seeds_means_random_starts_that_know_the_actuator() -> None:
    """Switched off, no member starts from the element, and the log says so."""
    case = example(4.0, 1.0, actuator=ACTUATOR)
    fit = train([case], NarxSettings(fitted_seeds=0))[0]
    assert [(stage.horizon, len(stage.steps)) for stage in fit.log] == [(1, 8), (20, 8), (300, 8)]
    assert fit.network is not None
    assert dict(fit.network.actuator) == ACTUATOR


@pytest.mark.parametrize(
    ("changes", "fitted"),
    [({}, 2), ({"seeds": 1}, 1), ({"hidden": 4}, 0), ({"fitted_seeds": 0}, 0)],
)
def test_the_number_of_members_that_start_from_the_element(
    changes: dict[str, int], fitted: int
) -> None:
    """Never more than there are, and none where the units do not suffice for the element."""
    assert fitted == NarxSettings(**changes).fitted


def test_a_grey_box_network_comes_back_from_its_bytes() -> None:
    """Its actuator is stored with it, so that it runs as it was trained."""
    case = example(3.0, 1.0, actuator=ACTUATOR)
    network = train([case])[0].network
    assert network is not None
    back = NarxNetwork.from_bytes(network.to_bytes())
    assert np.array_equal(network.free_run(case.op, case.mv), back.free_run(case.op, case.mv))


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"S": -1.0}, "S, J and actuator finite and at least 0 expected"),
        ({"J": float("nan")}, "S, J and actuator finite and at least 0 expected"),
        ({"zero": float("inf")}, "S, J and actuator finite and at least 0 expected"),
        ({"gain": 0.0}, "a stem that the command does not move"),
        ({"actuator": {"dead_time_s": 1.0}}, "actuator: .* expected, received"),
        ({"actuator": dict(NO_ACTUATOR) | {"lag_up_s": -1.0}}, "at least 0 expected"),
    ],
)
def test_a_start_that_no_valve_has_is_refused(changes: dict[str, object], sentence: str) -> None:
    """The error says which numbers were expected."""
    with pytest.raises(ValueError, match=sentence):
        StickSlipStart(**({"S": 2.0, "J": 1.0} | changes))
