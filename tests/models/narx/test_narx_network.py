"""The NARX network as an object: its free run, its gaps, its bytes. Nothing is trained here."""

from __future__ import annotations

import hashlib
import inspect
import json
import pickle
import struct
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stemwatch.models.narx import kernel
from stemwatch.models.narx.actuator import actuator_output
from stemwatch.models.narx.architecture import NO_ACTUATOR
from stemwatch.models.narx.network import NarxNetwork
from stemwatch.models.narx.run_plan import PlanStep, plan_run, segments

INTERVAL_S = 2.0


def network(members: int = 3, hidden: int = 5, seed: int = 1, **changes: object) -> NarxNetwork:
    """Random weights behind a sensible scaling: what is tested here does not depend on a fit."""
    draw = np.random.default_rng(seed).standard_normal
    facts: dict[str, object] = {
        "weights": {
            "hidden": draw((members, hidden, 5)),
            "gate": draw((members, hidden + 1)),
            "value": 0.3 * draw((members, hidden + 5)),
        },
        "scaling": {
            "op_centre": 50.0,
            "mv_centre": 49.0,
            "gain": 1.0,
            "error_scale": 2.0,
            "change_scale": 0.5,
        },
        "ranges": {
            "op": (30.0, 70.0),
            "mv": (31.0, 69.0),
            "error": (-6.0, 6.0),
            "change": (-3.0, 3.0),
            "drift": (-4.0, 4.0),
        },
        "interval_s": INTERVAL_S,
        "reference_rmse": 0.7,
        "seed": seed,
    }
    return NarxNetwork(**(facts | changes))  # type: ignore[arg-type]


def signals(n: int = 400, seed: int = 2) -> tuple[np.ndarray, np.ndarray]:
    """OP that wanders about 50 % and an MV that follows it late."""
    rng = np.random.default_rng(seed)
    op = 50 + 8 * np.sin(np.arange(n) / 17) + rng.normal(0, 0.2, n)
    return op, np.roll(op, 3) + rng.normal(0, 0.1, n)


def written_out(net: NarxNetwork, op: np.ndarray, y: list[float], member: int) -> np.ndarray:
    """The docstring's equations, one sample after another, for one member."""
    s = net.scaling
    v = s["mv_centre"] + s["gain"] * (op - s["op_centre"])
    hidden, gate, value = (net.weights[name][member] for name in ("hidden", "gate", "value"))
    units = gate.size - 1
    for t in range(len(y), op.size):
        error = np.clip(v[t] - y[-1], -6.6, 6.6)
        change = np.clip(v[t] - v[t - 1], -4.5, 4.5)
        drift = y[-1] - y[-2]
        ways = np.array([change, drift]) / s["change_scale"]
        x = np.array([error / s["error_scale"], *ways, np.mean(np.tanh(ways / 0.01))])
        h = np.tanh(hidden[:, :4] @ x + hidden[:, 4])
        opening = 1 / (1 + np.exp(-(gate[:units] @ h + gate[units])))
        step = s["error_scale"] * opening * (value[:units] @ h + value[units:-1] @ x + value[-1])
        y.append(float(np.clip(y[-1] + np.clip(step, -6.0, 6.0), 12.0, 88.0)))
    return np.array(y)


def test_the_free_run_is_the_equation_of_the_docstring_averaged_over_members() -> None:
    """Each member runs on its own output, within its clamps, and the ensemble is their mean."""
    net = network()
    op, mv = signals()
    start = [float(mv[0]), float(mv[1])]
    expected = np.mean([written_out(net, op, list(start), m) for m in range(3)], axis=0)
    np.testing.assert_allclose(net.free_run(op, mv), expected, rtol=0, atol=1e-9)


@pytest.mark.long
def test_the_kernel_says_the_same_compiled_and_interpreted() -> None:
    """Compiling the kernel changes nothing but its speed."""
    rng = np.random.default_rng(3)
    weights = rng.standard_normal((2, 41))
    level, move, position = rng.standard_normal((3, 120))
    usable = np.ones(120, dtype=bool)
    usable[40:45] = False
    plan = plan_run(usable, 30)
    outs = np.full((2, 2, 120), np.nan)
    limits = (-3.0, 3.0, -2.0, 2.0, -6.0, 6.0)
    for function, out in zip((kernel.free_run, inspect.unwrap(kernel.free_run)), outs, strict=True):
        function(weights, 5, level, move, position, plan, (1, 2, 3), limits, 2.0, 0.01, out)
    np.testing.assert_allclose(outs[0], outs[1], rtol=0, atol=1e-10)
    assert np.isnan(outs[0, :, 40:45]).all()


def test_one_step_prediction_uses_the_measurement_at_every_sample() -> None:
    """One step ahead is a free run that starts again after one sample."""
    net = network()
    op, mv = signals(60)
    item = net.one_step(op, mv)
    for t in (2, 17, 59):
        repeated = net.free_run(op[t - 2 : t + 1], mv[t - 2 : t + 1])
        assert item[t] == pytest.approx(repeated[-1], abs=1e-12)


def test_after_a_gap_the_run_starts_again_from_the_measurement() -> None:
    """What follows a gap is what a run that begins there gives; the gap itself is NaN."""
    net = network()
    op, mv = signals()
    mv[150:160] = np.nan
    usable = np.ones(400, dtype=bool)
    usable[300] = False
    complete = net.free_run(op, mv, usable)
    assert np.isnan(complete[150:160]).all()
    assert np.isnan(complete[300])
    assert np.array_equal(complete[160:300], net.free_run(op[160:300], mv[160:300]))
    assert np.array_equal(complete[301:], net.free_run(op[301:], mv[301:]))
    assert np.array_equal(complete[160:162], mv[160:162])


def test_numbers_that_cannot_be_measurements_are_gaps() -> None:
    """Infinities and numbers of absurd size are not run through, and raise no warning."""
    net = network()
    op, mv = signals()
    op[100:102], mv[200:202] = (np.inf, 1e300), (-1e300, -np.inf)
    run = net.free_run(op, mv)
    assert list(np.flatnonzero(np.isnan(run))) == [100, 101, 200, 201]


def test_a_mask_of_another_length_is_refused() -> None:
    """The error names both shapes."""
    with pytest.raises(ValueError, match=r"usable of shape \(400,\) expected, received \(3,\)"):
        network().free_run(*signals(), np.ones(3, dtype=bool))


def test_a_run_from_one_opening_needs_no_measured_position() -> None:
    """One number is enough to start from where nothing is missing."""
    net = network()
    op, _ = signals()
    run = net.free_run(op, 48.0)
    assert run[0] == run[1] == 48.0
    assert np.isfinite(run).all()


def test_one_opening_is_not_enough_to_cross_a_gap() -> None:
    """Without a measurement the stem's place after a gap is unknown, and the error says so."""
    op, _ = signals()
    op[50] = np.nan
    with pytest.raises(ValueError, match=r"1 of 400 samples are unusable.*give the measured MV"):
        network().free_run(op, 48.0)


def test_signals_of_different_lengths_are_refused() -> None:
    """The error names both lengths."""
    with pytest.raises(ValueError, match=r"one length expected, received \(5,\) and \(4,\)"):
        network().free_run(np.zeros(5), np.zeros(4))


def test_a_horizon_below_one_is_refused() -> None:
    """A run of no samples is a mistake of the caller."""
    op, mv = signals()
    with pytest.raises(ValueError, match="at least 1 sample expected, received 0"):
        network().free_run(op, mv, horizon=0)


@settings(max_examples=60, deadline=None)
@given(
    usable=st.lists(st.booleans(), min_size=1, max_size=60).map(np.array),
    horizon=st.integers(1, 12),
)
def test_segments_cover_what_the_plan_simulates_exactly_once(
    usable: np.ndarray, horizon: int
) -> None:
    """Training and scoring see the same samples, each once, no segment longer than the horizon."""
    starts, lengths = segments(usable, horizon)
    covered = np.zeros(usable.size, dtype=int)
    for start, length in zip(starts, lengths, strict=True):
        assert 1 <= length <= horizon
        assert usable[start - 2 : start + length].all()
        covered[start : start + length] += 1
    simulated = plan_run(usable, horizon) >= PlanStep.RUN
    assert np.array_equal(covered, simulated.astype(int))


def test_a_network_comes_back_from_its_bytes_bit_for_bit() -> None:
    """Stored and loaded it is the same network, and the same bytes again."""
    net = network(scaling=dict(network().scaling) | {"gain": 0.1 + 0.2})
    data = net.to_bytes()
    back = NarxNetwork.from_bytes(data)
    for name, array in net.weights.items():
        assert array.tobytes() == back.weights[name].tobytes()
    for name in ("scaling", "ranges", "actuator", "lags"):
        assert dict(getattr(net, name)) == dict(getattr(back, name))
    assert (net.interval_s, net.reference_rmse, net.seed, net.format_version) == (
        back.interval_s,
        back.reference_rmse,
        back.seed,
        back.format_version,
    )
    assert data == back.to_bytes()
    op, mv = signals()
    assert np.array_equal(net.free_run(op, mv), back.free_run(op, mv))


def test_a_network_travels_between_processes() -> None:
    """Screenings made in worker processes carry their network home."""
    net = network()
    assert net.to_bytes() == pickle.loads(pickle.dumps(net)).to_bytes()


def read_back(data: bytes) -> NarxNetwork | str:
    """The network, or the sentence it was refused with."""
    try:
        return NarxNetwork.from_bytes(data)
    except ValueError as error:
        return str(error)


@settings(max_examples=120, deadline=None)
@given(at=st.integers(0, 2**20), flip=st.integers(1, 255))
def test_any_damaged_byte_is_noticed(at: int, flip: int) -> None:
    """Wherever a byte has changed, the bytes are refused or still mean the same network."""
    data = bytearray(network(members=1).to_bytes())
    complete = bytes(data)
    data[at % len(data)] ^= flip
    back = read_back(bytes(data))
    assert "NARX network" in back if isinstance(back, str) else complete == back.to_bytes()


@pytest.mark.parametrize("data", [b"", b"abc", b"\x00" * 40, b"\xff" * 64])
def test_bytes_of_something_else_are_refused_with_what_to_do(data: bytes) -> None:
    """What was never a network is called that."""
    with pytest.raises(ValueError, match=r"not a stored NARX network.*train the network again"):
        NarxNetwork.from_bytes(data)


def test_truncated_bytes_are_refused() -> None:
    """Half a file is not half a network."""
    data = network().to_bytes()
    with pytest.raises(ValueError, match="NARX network is damaged"):
        NarxNetwork.from_bytes(data[:-16])


def test_an_unknown_format_version_is_refused_by_its_number() -> None:
    """A newer release's network is named as such, not called damaged."""
    data = network(format_version=3).to_bytes()
    with pytest.raises(ValueError, match="format version 3: this release reads versions up to 2"):
        NarxNetwork.from_bytes(data)


def version_1(net: NarxNetwork) -> bytes:
    """The bytes that the first format had: three inputs, no actuator."""
    from safetensors.numpy import save

    arrays = {name: np.array(array) for name, array in net.weights.items()}
    for name in ("hidden", "value"):
        arrays[name] = np.delete(arrays[name], -2, axis=-1)
    facts = {
        "format_version": 1,
        "scaling": dict(net.scaling),
        "ranges": {name: list(pair) for name, pair in net.ranges.items()},
        "lags": dict(net.lags),
        "interval_s": net.interval_s,
        "reference_rmse": net.reference_rmse,
        "reference_horizon": net.reference_horizon,
        "seed": net.seed,
    }
    digest = hashlib.sha256(json.dumps(facts, sort_keys=True).encode())
    for name in sorted(arrays):
        digest.update(f"{name}{arrays[name].shape}".encode())
        digest.update(arrays[name].tobytes())
    facts["digest"] = digest.hexdigest()
    return bytes(save(arrays, metadata={"stemwatch.narx": json.dumps(facts, sort_keys=True)}))


def test_a_network_of_the_first_format_still_runs_as_it_did() -> None:
    """It weighed three inputs and saw OP as it was; so does what is read from its bytes."""
    net = network()
    without = {name: np.array(array) for name, array in net.weights.items()}
    without["hidden"][..., -2] = without["value"][..., -2] = 0.0
    expected = network(weights=without)
    back = NarxNetwork.from_bytes(version_1(expected))
    op, mv = signals()
    assert np.array_equal(expected.free_run(op, mv), back.free_run(op, mv))
    assert expected.to_bytes() == back.to_bytes()


def test_a_network_sees_the_command_as_the_actuator_passes_it_on() -> None:
    """Dead time, lag and speed limit come before the lags of OP."""
    actuator = dict(NO_ACTUATOR) | {
        "dead_time_s": 3.0,
        "lag_up_s": 5.0,
        "slow_down_s_per_percent": 2.0,
    }
    op, mv = signals()
    passed_on = actuator_output(op, INTERVAL_S, actuator)
    result = network(actuator=actuator).free_run(op, mv)
    assert np.array_equal(network().free_run(passed_on, mv), result)


def test_the_actuator_delays_lags_and_limits() -> None:
    """A step: nothing for the dead time, then an exponential; downwards at most 1 % in 4 s."""
    step = np.where(np.arange(60) < 10, 40.0, 50.0)
    lagged = actuator_output(step, 2.0, dict(NO_ACTUATOR) | {"dead_time_s": 5.0, "lag_up_s": 8.0})
    k = np.arange(60 - 13)
    share = 1 - np.exp(-2.0 / 8.0)  # the fraction of a sample that the dead time leaves is linear
    assert np.array_equal(np.full(12, 40.0), lagged[:12])
    np.testing.assert_allclose(lagged[13:], 50 - (10 - 5 * share) * (1 - share) ** (k + 1))
    falling = actuator_output(-step, 2.0, dict(NO_ACTUATOR) | {"slow_down_s_per_percent": 4.0})
    np.testing.assert_allclose(falling[10:30], np.maximum(-40 - 0.5 * np.arange(1, 21), -50))


def test_a_hole_in_the_command_stays_one_and_is_crossed() -> None:
    """NaN where OP is; what follows is as if the last command had been held."""
    op, _ = signals(60)
    lag = dict(NO_ACTUATOR) | {"lag_up_s": 5.0, "lag_down_s": 5.0}
    held = op.copy()
    held[20:24] = op[19]
    holed = op.copy()
    holed[20:24] = np.nan
    expected = actuator_output(held, 2.0, lag)
    expected[20:24] = np.nan
    np.testing.assert_array_equal(actuator_output(holed, 2.0, lag), expected)


def test_the_header_says_lags_scaling_and_version_to_any_reader() -> None:
    """Another safetensors reader finds in the metadata what the arrays mean."""
    data = network().to_bytes()
    (length,) = struct.unpack_from("<Q", data)
    facts = json.loads(json.loads(data[8 : 8 + length])["__metadata__"]["stemwatch.narx"])
    assert facts["format_version"] == 2
    assert facts["lags"] == {"op": 2, "mv": 2}
    assert facts["scaling"]["error_scale"] == 2.0


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"lags": {"op": 3, "mv": 2}}, "lags .* expected"),
        ({"actuator": {"lag_s": 1.0}}, "actuator: .* expected, received"),
        ({"scaling": {"gain": 1.0}}, "scaling: .* expected, received"),
        ({"interval_s": float("nan")}, "finite scaling"),
        ({"interval_s": 0.0}, "above 0 expected"),
        ({"reference_rmse": -1.0}, "above 0 expected"),
    ],
)
def test_inconsistent_network_fields_are_refused(changes: dict[str, object], sentence: str) -> None:
    """A network that could not be run is refused."""
    with pytest.raises(ValueError, match=sentence):
        network(**changes)


@pytest.mark.parametrize(
    ("name", "array", "sentence"),
    [
        ("gate", np.zeros((3, 7)), "weights of shapes .* expected, received"),
        ("value", np.zeros((2, 9)), "weights of shapes .* expected, received"),
        ("hidden", np.zeros(3), "weights of shapes .* expected, received"),
        ("gate", np.full((3, 6), np.inf), "finite weights expected"),
    ],
)
def test_weights_that_do_not_fit_are_refused(name: str, array: np.ndarray, sentence: str) -> None:
    """Arrays that do not belong together are named with the shapes expected."""
    with pytest.raises(ValueError, match=sentence):
        network(weights=dict(network().weights) | {name: array})


def test_weights_cannot_be_changed_behind_a_networks_back() -> None:
    """The network owns its arrays and they are read-only."""
    mine = {name: array.copy() for name, array in network().weights.items()}
    net = network(weights=mine)
    mine["gate"][:] = 0.0
    assert np.array_equal(net.weights["gate"], network().weights["gate"])
    with pytest.raises(ValueError, match="read-only"):
        net.weights["gate"][0, 0] = 1.0


@pytest.mark.long
def test_running_and_storing_a_network_needs_no_torch() -> None:
    """A screening host that only scores never loads torch."""
    script = (
        "import sys, numpy as np\n"
        "from stemwatch.models.narx.network import NarxNetwork\n"
        "from stemwatch.models.narx.baseline import score_baseline\n"
        "net = NarxNetwork.from_bytes(sys.stdin.buffer.read())\n"
        "net.free_run(np.linspace(40, 60, 50), 40.0)\n"
        "assert 'torch' not in sys.modules\n"
    )
    process = subprocess.run(
        [sys.executable, "-c", script], input=network().to_bytes(), capture_output=True, check=False
    )
    assert (0, b"") == (process.returncode, process.stderr)
