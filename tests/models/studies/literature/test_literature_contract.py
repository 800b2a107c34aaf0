"""The contract of ``ValveModel``, tested on every model."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stemwatch.models.studies.literature.catalogue import DATA_DRIVEN, EVERY, PHYSICAL
from stemwatch.models.studies.literature.model import Parameter, values_of
from tests.models.studies.literature.named_models import BY_NAME

every = pytest.mark.parametrize("model", EVERY, ids=lambda m: m.name)
physical = pytest.mark.parametrize("model", PHYSICAL, ids=lambda m: m.name)


def usual(model, op, interval_s=1.0):
    return model.simulate(op, values_of(model), interval_s, float(op[0]))


@every
def test_describes_itself(model):
    """Name, source, equation and limits are there, and every parameter has a unit and a meaning."""
    assert model.name.isidentifier()
    assert model.source.endswith(".")
    assert len(model.equation()) > 20
    assert all(limit.endswith(".") for limit in model.limits)
    assert model.limits
    assert all(p.meaning for p in model.parameters)
    assert len({p.name for p in model.parameters}) == len(model.parameters)


@every
def test_says_how_well_its_source_is_known(model):
    """A paper that was not read again is said to be quoted from memory, and what is the product's
    own is said to be so."""
    text = ("from memory", "this product", "checked numerically")
    assert any(words in model.source for words in text)


@every
@pytest.mark.parametrize(
    "name",
    [
        "random walk",
        *(pytest.param(name, marks=pytest.mark.long) for name in ("triangle", "quantised sine")),
    ],
)
def test_as_long_as_the_command_and_finite(signals, model, name):
    """One finite position for each command, the first being where the stem was."""
    op = signals[name][:400]
    y = usual(model, op)
    assert y.shape == op.shape
    assert np.isfinite(y).all()
    assert y[0] == op[0]


@every
def test_moves_with_a_large_command_and_rests_with_a_constant_one(model):
    """A stroke of 40 % moves the stem most of the way; then it comes to rest for good."""
    op = np.concatenate((np.linspace(30.0, 70.0, 200), np.full(400, 70.0)))
    y = usual(model, op)
    assert y[-1] - y[0] > 20.0
    np.testing.assert_allclose(y[-100:], y[-1], atol=2e-3)


@every
def test_holds_on_a_constant_command(model):
    """A resting stem within its friction stays exactly where it was, for as long as it takes."""
    np.testing.assert_allclose(usual(model, np.full(300, 43.0)), 43.0, atol=1e-6)


@every
def test_the_response_does_not_depend_on_the_start_time(signals, model):
    """Time invariance (I18): a stem that waits before the record does the same afterwards."""
    op = signals["triangle"][:500]
    late = usual(model, np.concatenate((np.full(37, op[0]), op)))
    tolerance = 1e-9 if model in DATA_DRIVEN else 0.05
    np.testing.assert_allclose(late[37:], usual(model, op), atol=tolerance)


@every
def test_a_later_command_does_not_change_earlier_positions(signals, model):
    """A change of the command leaves every earlier position as it was."""
    op = signals["noisy sine"][:300]
    other = op.copy()
    other[200:] += 7.0
    np.testing.assert_allclose(usual(model, other)[:200], usual(model, op)[:200], atol=1e-9)


@every
def test_does_not_write_to_what_it_is_given(signals, model):
    """Command and parameters may be read-only."""
    op, q = signals["sine"][:50].copy(), values_of(model)
    op.flags.writeable = q.flags.writeable = False
    assert model.simulate(op, q, 1.0, 50.0).flags.writeable


@every
@pytest.mark.parametrize(
    ("op", "interval_s", "y0", "words"),
    [
        ([[50.0, 51.0]], 1.0, 50.0, r"op \(n,\) with at least one sample expected"),
        ([], 1.0, 50.0, r"at least one sample expected, received shape \(0,\)"),
        ([50.0, math.nan], 1.0, 50.0, "1 of 2 samples of op are not finite; cut or bridge"),
        ([50.0, 51.0], 0.0, 50.0, "interval_s must be positive, received 0"),
        ([50.0, 51.0], math.nan, 50.0, "interval_s must be positive"),
        ([50.0, 51.0], 1.0, math.inf, "y0 must be finite, received inf"),
    ],
)
def test_refuses_a_command_that_makes_no_sense(model, op, interval_s, y0, words):
    """What was expected and what was received, with the model's name in front."""
    with pytest.raises(ValueError, match=f"^{model.name}: .*{words}"):
        model.simulate(np.array(op), values_of(model), interval_s, y0)


@every
def test_refuses_parameters_that_make_no_sense(model):
    """Too many, outside its bounds, not a number: each is named."""
    op, q = np.array([50.0, 51.0]), values_of(model)
    first = model.parameters[0]
    with pytest.raises(ValueError, match=f"expected {q.size} parameters .{first.name}"):
        model.simulate(op, np.append(q, 1.0), 1.0, 50.0)
    for wrong in (first.upper * 2.0, math.nan):
        bad = np.concatenate(([wrong], q[1:]))
        with pytest.raises(ValueError, match=f"{first.name} = .* is outside"):
            model.simulate(op, bad, 1.0, 50.0)


@pytest.mark.parametrize(
    ("name", "chosen", "words"),
    [
        ("he2", {"fs": 1.0, "fd": 2.0}, r"expected \|fd\| <= fs, received fs = 1 % and fd = 2 %"),
        ("xch", {"fs": 1.0, "fd": -2.0}, r"expected \|fd\| <= fs"),
        ("karnopp", {"static_n": 500.0}, "expected kinetic_n <= static_n, received 700 and 500 N"),
    ],
)
def test_refuses_inconsistent_friction_levels(name, chosen, words):
    """Each is within its bounds, but together they are not a friction."""
    model = BY_NAME[name]
    with pytest.raises(ValueError, match=words):
        model.simulate(np.array([50.0, 51.0]), values_of(model, **chosen), 1.0, 50.0)


def test_an_unknown_parameter_name_is_refused_with_the_known_ones():
    """A misspelt parameter gets the list to choose from."""
    with pytest.raises(ValueError, match="kano has no Q; it has S, J"):
        values_of(BY_NAME["kano"], Q=1.0)


def test_a_parameter_checks_itself():
    """A default outside the bounds, and a logarithm of zero, are refused where they are written."""
    answer = {"unit": "%", "meaning": "a level"}
    with pytest.raises(ValueError, match="a: expected lower <= default <= upper"):
        Parameter(name="a", lower=0.0, upper=1.0, default=2.0, **answer)
    with pytest.raises(ValueError, match="a: a logarithmic parameter needs lower above 0"):
        Parameter(name="a", lower=0.0, upper=1.0, default=0.5, logarithmic=True, **answer)


def test_names_are_unique():
    """A name finds one model."""
    assert [BY_NAME[model.name] for model in EVERY] == list(EVERY)


@pytest.mark.parametrize("model", DATA_DRIVEN, ids=lambda m: m.name)
@settings(max_examples=25, deadline=None)
@given(data=st.data())
def test_any_admissible_parameters_give_finite_positions(model, data):
    """No corner of the bounds breaks a model, on any command."""
    shares = data.draw(
        st.lists(st.floats(0, 1), min_size=len(model.parameters), max_size=len(model.parameters))
    )
    pairs = zip(model.parameters, shares, strict=True)
    q = np.array([p.lower + share * (p.upper - p.lower) for p, share in pairs])
    op = np.array(data.draw(st.lists(st.floats(-200.0, 300.0), min_size=1, max_size=40)))
    if model.objection(q) is None:
        assert np.isfinite(model.simulate(op, q, 1.0, 50.0)).all()


@physical
@settings(max_examples=8, deadline=None)
@given(data=st.data())
def test_no_corner_of_the_bounds_breaks_a_force_balance(model, data):
    """Light, heavy, dragging or free: the integration comes to an end with finite positions."""
    corners = [data.draw(st.sampled_from([p.lower, p.default, p.upper])) for p in model.parameters]
    op = np.array(data.draw(st.lists(st.floats(0.0, 100.0), min_size=2, max_size=6)))
    q = np.array(corners)
    if model.objection(q) is None:
        y = model.simulate(op, q, 1.0, 50.0)
        assert np.isfinite(y).all()
        assert np.all(np.abs(y - 50.0) < 400.0)
