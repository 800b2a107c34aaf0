"""The contract of networks: simulate a recording, repeat exactly, and refuse with a sentence."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from stemwatch.models.recording import Recording, Role, Signal
from stemwatch.models.studies.literature.canonical import CANONICAL
from stemwatch.models.studies.literature.fit import fit_model
from stemwatch.models.studies.literature.networks import training
from stemwatch.models.studies.literature.networks.network import fit_network
from stemwatch.models.studies.literature.networks.product_network import PRODUCT
from stemwatch.models.studies.literature.networks.table_one import FEEDFORWARD_PAPER, NARX_PAPER
from stemwatch.models.studies.reproduction.layers import NARX, NARX_INPUTS, ThreeLayers
from stemwatch.models.studies.reproduction.network_step import LIMIT
from stemwatch.models.verdict import Shape
from stemwatch.service.studies.comparison.compare_models import NETWORKS

# Compiling the kernels of a study that no plant runs takes longer than all else here.
pytestmark = pytest.mark.long

DOCS = Path(__file__).parents[4] / "docs"
PAGE = re.sub(r"\s+", " ", (DOCS / "models.md").read_text("utf-8"))
TRAIN_UNTIL = 700
every = pytest.mark.parametrize("network", NETWORKS, ids=lambda n: n.name)
# What trains once more: one network in the short run.
one = pytest.mark.parametrize(
    "network",
    [
        pytest.param(network, marks=[] if network is NARX_PAPER else [pytest.mark.long])
        for network in NETWORKS
    ],
    ids=lambda n: n.name,
)


@pytest.fixture(scope="module")
def recording(signals, recorded):
    op = signals["noisy sine"][:1000]
    return recorded(CANONICAL, op, S=4.0, J=1.5)


@pytest.fixture(scope="module")
def element(recording):
    return fit_model(CANONICAL, recording, TRAIN_UNTIL)


@pytest.fixture(scope="module")
def fits(recording, element):
    return {n.name: fit_network(n, recording, TRAIN_UNTIL, element) for n in NETWORKS}


def changed(recording, role, values):
    signals = {**recording.signals, role: Signal.good(values, role.value)}
    return Recording(valve=recording.valve, signals=signals, interval_s=recording.interval_s)


@every
def test_a_network_simulates_the_recording(network, fits):
    """A finite free run over every sample, better than a constant on both parts."""
    fit = fits[network.name]
    assert fit.model == network.name
    assert np.isfinite(fit.simulated).all()
    assert min(fit.training.fit_percent, fit.heldout.fit_percent) > 50.0
    assert fit.parameters["weights"].value == fit.values.size


@one
def test_a_network_repeats_itself(network, recording, fits):
    """The same recording gives the same run, also where the element is fitted on the way."""
    repeated = fit_network(network, recording, TRAIN_UNTIL)
    np.testing.assert_array_equal(repeated.simulated, fits[network.name].simulated)


@one
def test_held_out_positions_do_not_change_the_weights(network, recording, element, fits):
    """Other positions after ``train_until`` and its start leave the weights as they were."""
    mv = np.array(recording.mv.values)
    mv[TRAIN_UNTIL + 2 :] = mv[TRAIN_UNTIL + 2 :][::-1]
    fit = fit_network(network, changed(recording, Role.MV, mv), TRAIN_UNTIL, element)
    np.testing.assert_array_equal(fit.values, fits[network.name].values)


@every
def test_a_recording_without_position_is_refused(network, recording):
    """No numbers, and the sentence that the models give."""
    bare = Recording(valve="V", signals={Role.OP: recording.op}, interval_s=1.0)
    fit = fit_network(network, bare, TRAIN_UNTIL)
    assert not fit.concluded
    assert fit.outcome == "the recording has no valve position (MV) to fit to"
    assert fit.parameters["weights"].reason == fit.outcome


@every
def test_a_place_outside_the_recording_is_an_error(network, recording):
    """As for a model."""
    with pytest.raises(ValueError, match="train_until from 1 to 1000 expected, received 1001"):
        fit_network(network, recording, 1001)


@one
def test_a_hole_restarts_the_run(network, recording):
    """A run goes on after a hole from the measurement there; nothing is trained across it."""
    mv = np.array(recording.mv.values)
    mv[300:340] = np.nan
    fit = fit_network(network, changed(recording, Role.MV, mv), TRAIN_UNTIL)
    assert fit.simulated[340] == pytest.approx(mv[340], abs=1e-9)
    assert fit.training.fit_percent > 50.0


def test_memory_beats_a_static_map(fits):
    """The paper's NARX follows a sticking valve better than its feedforward network, ours best."""
    rmse = [fits[n.name].heldout.rmse for n in (PRODUCT, NARX_PAPER, FEEDFORWARD_PAPER)]
    assert rmse == sorted(rmse)


def test_the_outcome_names_the_row_of_the_table(fits):
    """S 4 % and J 1.5 % are an undershoot, and the outcome says so."""
    answer = "Layers of Table 1 for undershoot, by the fitted S "
    assert [fits[n.name].outcome.startswith(answer) for n in NETWORKS] == [True, True, False]


def test_a_diverging_run_is_reported():
    """Weights that double the position at every sample end at the limit, and are marked so."""
    step = ThreeLayers(
        transfers=NARX[Shape.NO_OFFSET],
        inputs=NARX_INPUTS,
        reach=1.0,
        sizes=(1, 1, 1),
    )
    weights = np.array([0.0, 0.0, 2.0, 0.0, 0.0, 1.0, 0.0, 0.8, 0.0])
    u, y = np.zeros(40), np.full(40, 0.1)
    simulated, diverged = training.run(step, weights, u, y, ((0, 40),))
    assert (simulated[2], simulated[-1], diverged) == (pytest.approx(0.2), LIMIT, True)


def test_too_few_whole_pieces_give_a_reason():
    """Holes everywhere leave nothing to train on."""
    u = np.sin(np.arange(400) / 9.0)
    run = np.arange(400) % 2 == 0
    trained = training.train(Shape.DEADBAND, u, u, [run], recurrent=True)
    assert (
        trained == "too few samples without a hole to train on and to watch; take a longer window"
    )


def test_a_long_record_is_thinned():
    """Of 20,000 samples 1,500 are trained on, in pieces from its beginning to its end."""
    u = np.arange(20_000.0)
    cut = training.segments(u, u, [np.ones(u.size, dtype=bool)], 150)
    assert cut.samples == training.MOST_SAMPLES
    assert cut.u[0, 0] == 0.0
    assert cut.u[-1, -1] > 19_700.0


@every
def test_a_network_has_its_section_and_figure(network):
    """Statement, source and limits stand in the documentation as the network says them itself."""
    assert f"### {network.name} " in PAGE
    for words in (network.equation(), network.source, *network.limits):
        assert words in PAGE
    figure = re.sub(r"\W+", "_", network.name.lower()).strip("_")
    assert f"(figures/network_{figure}.svg)" in PAGE
    assert 1_000 < (DOCS / "figures" / f"network_{figure}.svg").stat().st_size < 60_000
