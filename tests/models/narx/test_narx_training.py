"""Training NARX networks: on stick-slip, on a real valve, and on what cannot be fitted."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example as for_example
from hypothesis import given, settings
from hypothesis import strategies as st

from stemwatch.models.narx.example import NarxExample, NarxFit, NarxSettings
from stemwatch.models.narx.stages import train_members
from stemwatch.models.narx.training import LEAST_ON_GPU, device_for, train
from stemwatch.models.recording import Recording, Role, Signal
from tests.models.stick_slip_element import stick_slip

N = 3600
# (S, J, noise) in percent, the four shapes twice: deadband, undershoot, no offset, overshoot.
VALVES = [
    (3.0, 0.0, 0.10),
    (5.0, 2.0, 0.10),
    (3.0, 3.0, 0.10),
    (4.0, 5.0, 0.10),
    (6.0, 0.5, 0.05),
    (2.0, 1.0, 0.10),
    (5.0, 4.0, 0.20),
    (7.0, 2.5, 0.15),
]


def command(rng: np.random.Generator, n: int) -> np.ndarray:
    """A controller output as in a closed loop: three sines, a dozen steps, a little noise."""
    t = np.arange(n)
    u = 50 + rng.normal(0, 0.05, n)
    for _ in range(3):
        u += rng.uniform(2, 7) * np.sin(2 * np.pi * t / rng.uniform(40, 400) + rng.uniform(0, 6))
    for integer in rng.integers(0, n, 12):
        u[integer:] += rng.normal(0, 3)
    return u


def example(
    S: float = 3.0, J: float = 1.0, noise: float = 0.1, seed: int = 0, n: int = N
) -> NarxExample:
    rng = np.random.default_rng(seed)
    op = command(rng, n)
    return NarxExample(
        valve=f"FV-{seed}",
        op=op,
        mv=stick_slip(op, S, J) + rng.normal(0, noise, n),
        usable=np.ones(n, dtype=bool),
        train_until=round(0.6 * n),
        interval_s=1.0,
    )


@pytest.fixture(scope="module")
def examples() -> list[NarxExample]:
    return [example(*valve, seed=index) for index, valve in enumerate(VALVES)]


@pytest.fixture(scope="module")
def fits(examples: list[NarxExample]) -> list[NarxFit]:
    return train(examples)


def fit_percents(fits: list[NarxFit]) -> list[float]:
    """Held-out free-run fit, or -100 where there is no network."""
    return [fit.heldout.fit_percent if fit.heldout else -100.0 for fit in fits]


def weights_of(fit: NarxFit) -> np.ndarray:
    assert fit.network is not None, fit.reason
    return np.concatenate([array.ravel() for array in fit.network.weights.values()])


def test_held_out_free_run_follows_stick_slip(fits: list[NarxFit]) -> None:
    """On samples never trained on, fed its own output only, the ensemble follows the stem."""
    percents = fit_percents(fits)
    assert np.median(percents) > 80
    assert min(percents) > 40


def test_training_on_free_runs_beats_training_on_one_step(
    examples: list[NarxExample], fits: list[NarxFit]
) -> None:
    """With as many steps, one-step training is better at one step and worse at what counts."""
    only = train(examples, NarxSettings(horizons=(1,), steps=(26,)))
    assert np.mean(fit_percents(fits)) > np.mean(fit_percents(only)) + 3
    pairs = [(a.heldout, b.heldout) for a, b in zip(fits, only, strict=True)]
    one_step = [(a.one_step_rmse, b.one_step_rmse) for a, b in pairs if a and b]
    assert np.median([free / step for free, step in one_step]) > 1


def test_what_is_reported_is_what_the_network_does(
    examples: list[NarxExample], fits: list[NarxFit]
) -> None:
    """Held-out figures and the simulated run can be had again from the network alone."""
    for case, fit in zip(examples, fits, strict=True):
        assert fit.network is not None
        assert fit.heldout is not None
        assert fit.simulated is not None
        late = slice(case.train_until, None)
        repeated = fit.network.free_run(case.op[late], case.mv[late])
        assert np.array_equal(repeated, fit.simulated[late])
        error = repeated[2:] - case.mv[late][2:]
        assert fit.heldout.rmse == pytest.approx(np.sqrt(np.mean(error**2)), rel=1e-12)
        spread = np.std(case.mv[late][2:])
        assert fit.heldout.normalised == pytest.approx(fit.heldout.rmse / spread, rel=1e-12)
        reference = fit.network.free_run(case.op, case.mv, horizon=100)[2:] - case.mv[2:]
        assert fit.network.reference_rmse == pytest.approx(np.sqrt(np.mean(reference**2)))


def test_the_log_tells_every_stage_of_every_seed(fits: list[NarxFit]) -> None:
    """Three horizons, eight seeds; nobody takes more steps than allowed."""
    for fit in fits:
        assert [stage.horizon for stage in fit.log] == [1, 20, 300]
        for stage, most in zip(fit.log, NarxSettings().steps, strict=True):
            assert stage.watched_rmse is not None
            assert len(stage.trained_rmse) == len(stage.watched_rmse) == len(stage.steps) == 8
            assert all(0 <= steps <= most for steps in stage.steps)
        assert fit.network is not None
        assert 1 <= fit.network.members <= NarxSettings().kept == 6


def test_the_same_training_twice_gives_the_same_network(examples: list[NarxExample]) -> None:
    """Seeded: bit for bit."""
    first, second = (train(examples[:2]) for _ in range(2))
    for item, other in zip(first, second, strict=True):
        assert np.array_equal(weights_of(item), weights_of(other))


def test_another_seed_gives_another_network(examples: list[NarxExample]) -> None:
    """Networks depend on the seed."""
    first, second = (train(examples[:1], NarxSettings(seed=seed))[0] for seed in (0, 1))
    item, other = weights_of(first), weights_of(second)
    assert item.shape != other.shape or not np.allclose(item, other)


def test_a_valve_does_not_depend_on_the_company_it_is_trained_in(
    examples: list[NarxExample], fits: list[NarxFit]
) -> None:
    """Alone, in a batch of eight, or beside a shorter record with gaps: the same network."""
    short = example(4.0, 1.0, seed=50, n=900)
    short.usable[200:230] = False
    alone = train([examples[3]])[0]
    beside = train([short, examples[3]], NarxSettings(valves_per_batch=2))[1]
    for fit in (fits[3], beside):
        np.testing.assert_allclose(weights_of(fit), weights_of(alone), rtol=0, atol=1e-9)
    in_two = train([short, examples[3]], NarxSettings(valves_per_batch=1))
    np.testing.assert_allclose(
        weights_of(in_two[0]), weights_of(train([short])[0]), rtol=0, atol=1e-9
    )


def test_gaps_cost_their_samples_and_nothing_else() -> None:
    """With holes of nonsense masked out, the network is nearly as good and never sees them."""
    complete, holed = example(4.0, 2.0, seed=21), example(4.0, 2.0, seed=21)
    for first in range(150, N, 400):
        holed.usable[first : first + 40] = False
        holed.mv[first : first + 20] = np.nan
        holed.op[first + 20 : first + 40] = 1e12
    fit, with_gaps = train([complete, holed])
    assert with_gaps.heldout is not None
    assert fit.heldout is not None
    assert with_gaps.simulated is not None
    assert np.array_equal(np.isnan(with_gaps.simulated), ~holed.usable)
    assert with_gaps.heldout.fit_percent > fit.heldout.fit_percent - 12
    gaps_held_out = [first for first in range(150, N, 400) if first >= holed.train_until]
    runs = len(gaps_held_out) + 1
    held_out = int(holed.usable[holed.train_until :].sum())
    assert with_gaps.heldout.samples == held_out - 2 * runs


@pytest.mark.parametrize("slope", [0.031, -250.0])
def test_a_position_in_another_unit_is_followed_as_well(
    examples: list[NarxExample], fits: list[NarxFit], slope: float
) -> None:
    """MV in metres or in kilopascals the other way round: the fit is about as good."""
    other = replace(examples[1], mv=4000.0 + slope * examples[1].mv)
    percent = fit_percents(train([other]))[0]
    assert percent > 75


def test_a_sudden_step_larger_than_any_in_training_does_not_derail_the_run() -> None:
    """Inputs beyond the training range are clamped: the run stays near and comes back."""
    case = example(7.5, 7.0, 0.15, seed=33)
    op = case.op.copy()
    op[2600:2610] += 25.0
    case = replace(case, op=op, mv=stick_slip(op, 7.5, 7.0))
    fit = train([case])[0]
    assert fit.simulated is not None, fit.reason
    assert np.sqrt(np.mean((fit.simulated[2700:] - case.mv[2700:]) ** 2)) < 4


REFUSALS = [
    (lambda c: replace(c, train_until=150), "too few usable samples to train on: 148"),
    (lambda c: replace(c, train_until=N - 10), "too few usable samples held out to judge"),
    (lambda c: replace(c, usable=np.arange(N) % 2 == 0), "too few usable samples to train on: 0"),
    (lambda c: replace(c, op=np.full(N, 40.0)), "OP never moves in the training part"),
    (lambda c: replace(c, mv=np.full(N, 40.0)), "MV is constant in the training part"),
    (
        lambda c: replace(c, mv=np.where(np.arange(N) < c.train_until, c.mv, 40.0)),
        "MV is constant in the held-out part",
    ),
]


@pytest.mark.parametrize(("spoil", "sentence"), REFUSALS)
def test_what_cannot_be_trained_on_gets_a_reason(spoil, sentence: str) -> None:  # type: ignore[no-untyped-def]
    """A record without the answer in it is a result with a sentence, and no network."""
    fit = train([spoil(example())])[0]
    assert fit.network is None
    assert fit.heldout is None
    assert fit.reason is not None
    assert sentence in fit.reason


def test_a_position_that_has_nothing_to_do_with_the_command_is_refused() -> None:
    """Where even the training part is not followed, there is no network to trust."""
    walk = np.cumsum(np.random.default_rng(8).normal(0, 1, N))
    case = replace(example(), mv=60 + 20 * np.sin(walk), valve="crossed tags")
    fit = train([case], NarxSettings(seeds=2, steps=(2, 2, 2)))[0]
    assert fit.network is None
    assert fit.reason is not None
    assert "did not converge" in fit.reason
    assert len(fit.log) == 3


def test_one_bad_record_does_not_cost_the_others(
    examples: list[NarxExample], fits: list[NarxFit]
) -> None:
    """Order is kept and the good neighbour is trained as if alone."""
    bad = replace(examples[0], op=np.zeros(N), valve="dead")
    refused, good = train([bad, examples[0]])
    assert (refused.valve, good.valve) == ("dead", "FV-0")
    assert refused.network is None
    np.testing.assert_allclose(weights_of(good), weights_of(fits[0]), rtol=0, atol=1e-9)


def test_training_works_without_watched_samples(examples: list[NarxExample]) -> None:
    """Without a watched block all of the training part is trained on, and the log says so."""
    fit = train(examples[:1], NarxSettings(watched_share=0.0, seeds=2))[0]
    assert fit.heldout is not None, fit.reason
    assert fit.heldout.fit_percent > 60
    assert [stage.watched_rmse for stage in fit.log] == [None] * 3


def test_an_empty_batch_is_no_fits() -> None:
    """Nothing in, nothing out."""
    assert train([]) == []


LENGTH = 700
odd_numbers = st.floats() | st.sampled_from([0.0, 50.0, 1e-300, 1e300, -1e14])
USUAL = (10.0, 10.0)
waves = st.floats(0, 30) | st.sampled_from([0.0, 1e-13, 1e14, 1e200])


@settings(max_examples=40, deadline=None)
@given(
    odd=st.lists(
        st.tuples(st.sampled_from(["op", "mv"]), st.integers(0, LENGTH - 1), odd_numbers),
        max_size=12,
    ),
    train_until=st.sampled_from([0, 350, 400, 690, LENGTH]),
    waves=st.tuples(waves, waves),
    period=st.floats(0.5, 500),
)
@for_example(odd=[], train_until=400, waves=USUAL, period=30.0)
def test_whatever_the_numbers_are_there_is_a_finite_answer_or_a_reason(
    odd: list[tuple[str, int, float]],
    train_until: int,
    waves: tuple[float, float],
    period: float,
) -> None:
    """No input raises, and no score is ever infinite or not a number; usual ones have a score."""
    t = np.arange(LENGTH)
    signals = {
        name: 50 + wave * np.sin((t - lag) / period)
        for name, wave, lag in zip(("op", "mv"), waves, (0, 2), strict=True)
    }
    for name, at, value in odd:
        signals[name][at] = value
    case = NarxExample(
        valve="any",
        **signals,
        usable=np.isfinite(signals["op"]) & np.isfinite(signals["mv"]),
        train_until=train_until,
        interval_s=1.0,
    )
    fit = train([case], NarxSettings(seeds=2, steps=(2, 1, 1)))[0]
    if fit.heldout is None:
        assert fit.reason
        assert odd or waves != USUAL or train_until > 400 or period != 30.0
    else:
        heldout = fit.heldout
        assert np.isfinite([heldout.rmse, heldout.one_step_rmse, heldout.normalised]).all()
        assert fit.network is not None
        assert np.isfinite(fit.network.reference_rmse)


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"train_until": N + 1}, f"train_until between 0 and {N} expected, received {N + 1}"),
        ({"interval_s": 0.0}, "interval_s must be positive"),
        ({"mv": np.zeros(3)}, "op, mv and usable of one length expected"),
    ],
)
def test_an_example_that_contradicts_itself_is_refused(
    changes: dict[str, object], sentence: str
) -> None:
    """A caller's mistake is an error that names the valve and what was expected."""
    with pytest.raises(ValueError, match=f"FV-0: {sentence}"):
        replace(example(), **changes)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "changes",
    [
        {"seeds": 0},
        {"fitted_seeds": -1},
        {"steps": (1, 2)},
        {"watched_share": 0.9},
        {"decay": 0.0},
        {"horizons": (0, 1)},
    ],
)
def test_settings_that_make_no_sense_are_refused(changes: dict[str, object]) -> None:
    """The error names what was expected."""
    with pytest.raises(ValueError, match="expected"):
        NarxSettings(**changes)  # type: ignore[arg-type]


@pytest.mark.recordings
def test_a_real_boiler_feed_valve_is_followed_from_the_first_half_to_the_second(
    recordings: Path,
) -> None:
    """An hour of a working valve that closes slowly: about 73 % in the free run."""
    path = recordings / "damadics" / "lublin_actuator3_one_hour.csv"
    with path.open(newline="") as file:
        rows = [(float(r["LC74_20CV_pct"]), float(r["LC74_20X_pct"])) for r in csv.DictReader(file)]
    op, mv = np.array(rows).T
    usable = np.ones(op.size, dtype=bool)
    case = NarxExample(
        valve="LC74_20", op=op, mv=mv, usable=usable, train_until=op.size // 2, interval_s=1.0
    )
    assert fit_percents(train([case]))[0] > 71


def test_an_example_of_a_recording_is_its_signals() -> None:
    """A recording gives its OP, position and mask; without a position there is no example."""
    op, mv = np.linspace(40.0, 60.0, 50), np.linspace(41.0, 59.0, 50)
    signals = {Role.OP: Signal.good(op, "OP"), Role.MV: Signal.good(mv, "ZT")}
    example = NarxExample.of(Recording(valve="V", signals=signals, interval_s=2.0), 30)
    assert ("V", 30, 2.0, None) == (
        example.valve,
        example.train_until,
        example.interval_s,
        example.start,
    )
    np.testing.assert_array_equal(mv, example.mv)
    bare = Recording(valve="V", signals={Role.OP: signals[Role.OP]}, interval_s=2.0)
    with pytest.raises(ValueError, match=r"V: a network needs the valve position"):
        NarxExample.of(bare, 30)


SHORT = NarxSettings(seeds=2, horizons=(1, 20), steps=(2, 2))


@pytest.mark.parametrize(
    ("valves", "wanted", "present", "expected"),
    [
        (LEAST_ON_GPU, "auto", True, "cuda"),
        (LEAST_ON_GPU, "auto", False, "cpu"),
        (LEAST_ON_GPU - 1, "auto", True, "cpu"),
        (1, "cuda", False, "cuda"),
        (LEAST_ON_GPU, "cpu", True, "cpu"),
    ],
)
def test_a_gpu_trains_a_batch_that_is_worth_it(
    monkeypatch: pytest.MonkeyPatch, valves: int, wanted: str, present: bool, expected: str
) -> None:
    """A GPU that is there takes batches of several valves, unless another device is asked for."""
    monkeypatch.setattr("torch.cuda.is_available", lambda: present)
    assert device_for(valves, wanted) == expected


def test_what_a_gpu_works_by_takes_the_steps_of_the_kernel(
    monkeypatch: pytest.MonkeyPatch, examples: list[NarxExample]
) -> None:
    """Torch on all networks at once, the way of a GPU, takes the same steps as the kernel: the same
    equations, summed in another order."""
    by_kernel = train(examples[:2], SHORT)
    monkeypatch.setattr("stemwatch.models.narx.normal_equations.by_kernel", lambda device: False)
    together = train(examples[:2], SHORT)
    for item, other in zip(by_kernel, together, strict=True):
        assert item.log[-1].steps == other.log[-1].steps
        np.testing.assert_allclose(
            item.log[-1].trained_rmse, other.log[-1].trained_rmse, rtol=1e-6, atol=0
        )


def test_a_gpu_that_fails_costs_no_network(
    monkeypatch: pytest.MonkeyPatch, examples: list[NarxExample]
) -> None:
    """Where the GPU cannot be used after all, the batch is trained on the CPU, to the same bits."""
    as_list = list(examples)
    expected = train(as_list, SHORT)
    answer: list[str] = []

    def refuse(valves: object, settings: NarxSettings, device: str) -> object:
        answer.append(device)
        if device == "cuda":
            raise RuntimeError("CUDA error: out of memory")
        return train_members(valves, settings, device)

    monkeypatch.setattr("torch.cuda.is_available", lambda: True)
    monkeypatch.setattr("stemwatch.models.narx.training.LEAST_ON_GPU", len(as_list))
    monkeypatch.setattr("stemwatch.models.narx.training.train_members", refuse)
    trained = train(as_list, SHORT)
    assert answer == ["cuda", "cpu"]
    assert {fit.device for fit in trained} == {"cpu"}
    for item, other in zip(expected, trained, strict=True):
        np.testing.assert_array_equal(weights_of(item), weights_of(other))
