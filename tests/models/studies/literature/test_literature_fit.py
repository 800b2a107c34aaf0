"""The same fit for every model: it recovers the simulated parameters, and gives a reason when it
cannot.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stemwatch.models.recording import Quality, Recording, Role, Signal
from stemwatch.models.studies.literature.canonical import CANONICAL
from stemwatch.models.studies.literature.catalogue import DATA_DRIVEN, EVERY, PHYSICAL
from stemwatch.models.studies.literature.fit import fit_model
from stemwatch.models.studies.literature.model import values_of
from stemwatch.models.studies.literature.scores import score
from tests.models.studies.literature.named_models import BY_NAME

TRAIN = 1000


@pytest.fixture(scope="module")
def command():
    """A slow wave with a drift: reversals of all sizes, no repeats, 1500 samples."""
    k = np.arange(1500)
    rng = np.random.default_rng(5)
    walk = np.cumsum(0.15 * rng.standard_normal(k.size))
    return 50.0 + 12.0 * np.sin(2 * np.pi * (k + 0.3) / 150.0) + 0.5 * walk


# Accuracy that the record allows for each parameter: percent of OP for levels, a share for the
# others.
LEVEL_PERCENT = 0.15
SHARP = [model for model in DATA_DRIVEN if model.name != "kano_asymmetric"]


@pytest.mark.long
@pytest.mark.parametrize(
    "model",
    [
        pytest.param(model, marks=[pytest.mark.long] if k % 4 else [])
        for k, model in enumerate(SHARP)
    ],
    ids=lambda m: m.name,
)
def test_finds_its_own_parameters(recorded, command, model):
    """With 0.1 % of noise and a zero error of 0.7 %, levels come back within 0.15 % of OP."""
    fit = fit_model(model, recorded(model, command), TRAIN)
    assert fit.zero == pytest.approx(0.7, abs=0.35)
    for parameter, true in zip(model.parameters, values_of(model), strict=True):
        assert fit.parameters[parameter.name].value == pytest.approx(true, abs=LEVEL_PERCENT)
    assert fit.training.rmse < 0.15
    assert fit.outcome == ""


def test_the_jumps_of_each_direction_trade_with_the_zero(recorded, command):
    """S_up and S_down are sharp; of J_up and J_down only the sum is, since a shift of the zero
    takes from one what it gives to the other."""
    model = BY_NAME["kano_asymmetric"]
    fit = fit_model(model, recorded(model, command), TRAIN)
    S_up, J_up, S_down, J_down = fit.values.tolist()
    assert [S_up, S_down] == pytest.approx([5.0, 5.0], abs=0.2)
    assert J_up + J_down == pytest.approx(4.0, abs=0.2)
    assert 2.0 * (fit.zero - 0.7) == pytest.approx(2.0 - J_up, abs=0.3)


# Fc, Fv and an air lag take each other's place where the stem creeps; Fs alone is always sharp.
@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "sharp"),
    [
        ("classical", {"static_n": 0.02, "kinetic_n": 0.1}),
        pytest.param("karnopp", {"static_n": 0.02, "kinetic_n": 0.1}, marks=pytest.mark.long),
        pytest.param("dahl", {"kinetic_n": 0.02, "viscous_ns_per_m": 0.2}, marks=pytest.mark.long),
        ("lugre", {"static_n": 0.02, "kinetic_n": 0.15}),
        pytest.param("mueller", {"static_n": 0.02}, marks=pytest.mark.long),
    ],
)
def test_a_force_balance_finds_its_own_friction(recorded, command, name, sharp):
    """The friction that the record shows comes back within the stated share."""
    model = BY_NAME[name]
    # Packings as strong as the published ones show only where the command moves far.
    fit = fit_model(model, recorded(model, 50.0 + 2.5 * (command[:600] - 50.0)), 450)
    for parameter, share in sharp.items():
        true = float(values_of(model)[[p.name for p in model.parameters].index(parameter)])
        assert fit.parameters[parameter].value == pytest.approx(true, rel=share)
    assert fit.training.fit_percent > 95.0


@pytest.mark.long
def test_intervals_hold_the_truth(recorded, command):
    """Of ten records of one valve, S and J lie in nearly all of their intervals of 95 %."""
    inside = 0
    for seed in range(10):
        record = recorded(CANONICAL, command, seed=seed, noise=0.2, S=4.0123, J=1.5071)
        fit = fit_model(CANONICAL, record, TRAIN)
        for name, true in (("S", 4.0123), ("J", 1.5071)):
            parameter = fit.parameters[name]
            inside += parameter.low <= true <= parameter.high
            assert parameter.high - parameter.low < 0.5
    assert inside >= 17


def test_a_slow_model_has_no_intervals(recorded, command):
    """Where a simulation takes milliseconds no interval is drawn rather than a poor one."""
    model = BY_NAME["karnopp"]
    fit = fit_model(model, recorded(model, command[:600]), 400)
    assert fit.parameters["static_n"].value is not None
    assert fit.parameters["static_n"].low is None


@pytest.mark.long
@pytest.mark.parametrize(
    "name",
    ["canonical", *(pytest.param(name, marks=pytest.mark.long) for name in ("he3", "karnopp"))],
)
def test_the_same_record_gives_the_same_numbers(recorded, command, name):
    """The search is seeded."""
    model = BY_NAME[name]
    record = recorded(model, command[:700])
    first, second = (fit_model(model, record, 500) for _ in range(2))
    np.testing.assert_array_equal(first.values, second.values)
    np.testing.assert_array_equal(first.simulated, second.simulated)


@pytest.mark.long
def test_held_out_samples_change_no_parameter(recorded, command):
    """Samples from ``train_until`` on are used for scoring only."""
    record = recorded(CANONICAL, command)
    spoilt = record.mv.values.copy()
    spoilt[TRAIN:] += 5.0
    signals = {Role.OP: record.op, Role.MV: Signal.good(spoilt, "ZT")}
    # The noise scale that marks directions is of the whole record; the parameters are not.
    first = fit_model(CANONICAL, record, TRAIN)
    second = fit_model(CANONICAL, replace(record, signals=signals), TRAIN)
    np.testing.assert_allclose(first.values, second.values)
    assert second.heldout.rmse > first.heldout.rmse + 1.0


@pytest.mark.long
def test_the_richer_model_of_the_true_kind_wins_on_what_is_held_out(recorded, command):
    """A record of He's staircase is followed best by He's model, not by one that slides."""
    record = recorded(BY_NAME["he2"], command)
    rmse = {
        name: fit_model(BY_NAME[name], record, TRAIN).heldout.rmse
        for name in ("he2", "canonical", "stenman")
    }
    assert min(rmse, key=rmse.get) == "he2"


@pytest.mark.long
def test_holes_are_left_out_and_the_run_starts_afresh(recorded, command):
    """Bad samples are not scored, a long hole restarts the free run, and the numbers stay."""
    record = recorded(CANONICAL, command, S=5.0, J=2.0)
    quality = record.mv.quality.copy()
    quality[300:340] = Quality.BAD
    quality[500] = Quality.MISSING
    values = record.mv.values.copy()
    values[300:340] = 99.0
    signals = {Role.OP: record.op, Role.MV: Signal(values, quality, "ZT")}
    fit = fit_model(CANONICAL, replace(record, signals=signals), TRAIN)
    assert fit.parameters["S"].value == pytest.approx(5.0, abs=0.15)
    assert fit.training.rmse < 0.15
    assert fit.training.samples < TRAIN - 40


@pytest.mark.long
@pytest.mark.parametrize("first", [0, 40])
def test_the_free_run_covers_the_record(recorded, command, first):
    """A position for each sample from the first usable one on."""
    record = recorded(CANONICAL, command[:600])
    quality = record.mv.quality.copy()
    quality[:first] = Quality.MISSING
    signals = {Role.OP: record.op, Role.MV: replace(record.mv, quality=quality)}
    fit = fit_model(CANONICAL, replace(record, signals=signals), 400)
    assert np.isnan(fit.simulated[:first]).all()
    assert np.isfinite(fit.simulated[first:]).all()


def without_position(record):
    return replace(record, signals={Role.OP: record.op})


def in_flow_units(record):
    flow = replace(record.mv, unit="m3/h")
    return replace(record, signals={Role.OP: record.op, Role.MV: flow})


def with_constant(role):
    def change(record):
        flat = Signal.good(np.full(len(record), 40.0), "X")
        return replace(record, signals={**record.signals, role: flat})

    return change


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (without_position, "has no valve position"),
        (in_flow_units, "position is in 'm3/h' and the command in '%'"),
        (lambda record: record.part(0, 60), "usable samples before train_until, 100 are needed"),
        (with_constant(Role.OP), "the command does not move"),
        (with_constant(Role.MV), "the position does not move"),
    ],
)
@pytest.mark.parametrize("name", ["canonical", "karnopp"])
def test_a_record_that_cannot_be_fitted_is_a_result(recorded, command, name, change, words):
    """No exception and no number that looks like one: a sentence."""
    record = change(recorded(CANONICAL, command))
    fit = fit_model(BY_NAME[name], record, min(TRAIN, len(record)))
    assert not fit.concluded
    assert words in fit.outcome
    assert all(words in str(parameter) for parameter in fit.parameters.values())
    assert fit.simulated is None


@pytest.mark.long
def test_without_a_held_out_part_there_is_no_score_for_it(recorded, command):
    """A fit to the whole record has a training score only."""
    fit = fit_model(CANONICAL, recorded(CANONICAL, command), command.size)
    assert fit.heldout is None
    assert fit.training.rmse < 0.15


@pytest.mark.parametrize("train_until", [0, -1, 1501])
def test_train_until_lies_within_the_record(recorded, command, train_until):
    """The error names the expected range."""
    with pytest.raises(ValueError, match=f"train_until from 1 to 1500 expected.* {train_until}"):
        fit_model(CANONICAL, recorded(CANONICAL, command), train_until)


@pytest.mark.long
def test_a_position_that_follows_nothing_is_doubted():
    """A free run that is no better than a constant on its own training part says so."""
    rng = np.random.default_rng(2)
    op = 50.0 + 10.0 * np.sin(np.arange(900) / 7.0)
    mv = 50.0 - 3.0 * np.sin(np.arange(900) / 31.0) + rng.standard_normal(900)
    signals = {Role.OP: Signal.good(op, "OP"), Role.MV: Signal.good(mv, "ZT")}
    fit = fit_model(CANONICAL, Recording(valve="V", signals=signals, interval_s=1.0), 600)
    assert fit.concluded
    assert fit.training.fit_percent < 20.0


def test_a_parameter_at_the_end_of_its_range_is_doubted(recorded, command):
    """K cannot describe a slip that falls short of its place, so it ends at its lower bound."""
    record = recorded(BY_NAME["he3"], command)
    lagged = record.mv.values.copy()
    for k in range(1, lagged.size):
        lagged[k] = lagged[k - 1] + 0.1 * (record.mv.values[k] - lagged[k - 1])
    signals = {Role.OP: record.op, Role.MV: Signal.good(lagged, "ZT")}
    fit = fit_model(BY_NAME["he3"], replace(record, signals=signals), TRAIN)
    assert fit.outcome.startswith("K ended at the lower end of the search")


def test_scores_are_those_of_their_formulas():
    """RMSE, fit percent and directional change on a record small enough for a pencil."""
    mv = np.tile([0.0, 1.0, 1.0, 0.0], 10)
    simulated = np.tile([0.0, 1.0, 1.0, 1.0], 10)
    scored_result = score(simulated, mv, np.ones(40, dtype=bool), 0.1)
    assert scored_result.rmse == pytest.approx(0.5)
    assert scored_result.fit_percent == pytest.approx(0.0)
    # Steps of MV: up, stay, down, stay; of the simulation: up, stay, stay, down.
    assert scored_result.direction_percent == pytest.approx(100.0 * 20 / 39)


def test_a_score_needs_samples_that_move():
    """Fewer than twenty samples, or a constant, have no mark."""
    mv = np.arange(19.0)
    assert score(mv, mv, np.ones(19, dtype=bool), 0.1) is None
    flat = np.ones(50)
    assert score(flat, flat, np.ones(50, dtype=bool), 0.1) is None


def test_the_catalogue_is_complete():
    """Ten data-driven models and five force balances."""
    assert (len(DATA_DRIVEN), len(PHYSICAL), len(EVERY)) == (10, 5, 15)
