"""Draws docs/figures/model_*.svg, what each stiction model does with one and the same command, and
network_*.svg, what each network has learned of a sticking valve.

Run from anywhere with ``python docs/figures/models.py``; it needs the package and matplotlib. The
same versions draw the same bytes.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np

from stemwatch.models.recording import Floats, Recording, Role, Signal
from stemwatch.models.studies.literature.canonical import CANONICAL
from stemwatch.models.studies.literature.catalogue import DATA_DRIVEN, EVERY
from stemwatch.models.studies.literature.model import ValveModel, values_of
from stemwatch.models.studies.literature.networks.network import Network, fit_network
from stemwatch.service.studies.comparison.compare_models import NETWORKS

HERE = Path(__file__).parent
SAMPLES = 360
TRAINED = 1200  # samples that the networks are trained on, before those that are drawn
COMMAND, STEM, NETWORK = "#8a8f98", "#0b6bcb", "#e5484d"
STYLE: Any = {
    "svg.hashsalt": "stemwatch",
    "svg.fonttype": "none",
    "font.size": 8.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "path.simplify": True,
    "path.simplify_threshold": 0.3,
}


def command(swing: float) -> Floats:
    """A wave that shrinks, with a little noise and two holds: what a loop might ask for."""
    k = np.arange(SAMPLES)
    shrink = 1.0 - 0.5 * k / SAMPLES
    op: Floats = 50.0 + swing * shrink * np.sin(2.0 * np.pi * (k + 0.3) / 120.0)
    op += 0.01 * swing * np.random.default_rng(4).standard_normal(SAMPLES)
    for first in (95, 215):
        op[first : first + 12] = op[first]
    return op


def draw(model: ValveModel) -> None:
    """One figure: over time, and the stem against the command."""
    # The force balances' packing is that of a published set, five times as strong.
    op = command(10.0 if model in DATA_DRIVEN else 40.0)
    mv = model.simulate(op, values_of(model), 1.0, float(op[0]))
    figure, (over_time, loop) = plt.subplots(
        1, 2, figsize=(6.4, 2.0), width_ratios=(2.4, 1.0), layout="constrained"
    )
    over_time.plot(op, color=COMMAND, linewidth=0.9, label="OP")
    over_time.plot(mv, color=STEM, linewidth=1.2, label="MV")
    over_time.set(xlabel="Time, s", ylabel="%", xlim=(0, SAMPLES))
    over_time.legend(frameon=False, loc="upper right", ncols=2)
    loop.plot(op, mv, color=STEM, linewidth=0.8)
    loop.set(xlabel="OP, %", ylabel="MV, %")
    figure.savefig(HERE / f"model_{model.name}.svg", metadata={"Date": None})
    plt.close(figure)


def sticking_valve() -> Recording:
    """A canonical element with S 4 % and J 1.5 %, on a wandering wave, with noise."""
    k = np.arange(TRAINED + SAMPLES)
    rng = np.random.default_rng(4)
    op = 50.0 + 10.0 * np.sin(2.0 * np.pi * (k + 0.3) / 120.0)
    op += np.cumsum(0.05 * rng.standard_normal(k.size))
    mv = CANONICAL.simulate(op, values_of(CANONICAL, S=4.0, J=1.5), 1.0, float(op[0]))
    mv += 0.05 * rng.standard_normal(k.size)
    signals = {Role.OP: Signal.good(op, "OP"), Role.MV: Signal.good(mv, "MV")}
    return Recording(valve="FV-1", signals=signals, interval_s=1.0)


def draw_network(network: Network, recording: Recording) -> None:
    """One figure: the free run over what was held out, and against the command."""
    run = fit_network(network, recording, TRAINED).simulated
    if run is None or recording.mv is None:
        raise RuntimeError(f"{network.name}: no free run to draw")
    op, mv, run = (x[TRAINED:] for x in (recording.op.values, recording.mv.values, run))
    figure, (over_time, loop) = plt.subplots(
        1, 2, figsize=(6.4, 2.2), width_ratios=(2.4, 1.0), layout="constrained"
    )
    over_time.plot(op, color=COMMAND, linewidth=0.9, label="OP")
    over_time.plot(mv, color=STEM, linewidth=1.2, label="MV")
    over_time.plot(run, color=NETWORK, linewidth=1.0, label="network")
    over_time.set(xlabel="Time since the training part, s", ylabel="%", xlim=(0, SAMPLES))
    over_time.legend(frameon=False, loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=3)
    loop.plot(op, mv, color=STEM, linewidth=0.8)
    loop.plot(op, run, color=NETWORK, linewidth=0.8)
    loop.set(xlabel="OP, %", ylabel="MV, %")
    name = re.sub(r"\W+", "_", network.name.lower()).strip("_")
    figure.savefig(HERE / f"network_{name}.svg", metadata={"Date": None})
    plt.close(figure)


def main() -> None:
    """All figures, in the style of the documentation."""
    with mpl.rc_context(STYLE):
        for model in EVERY:
            draw(model)
        recording = sticking_valve()
        for network in NETWORKS:
            draw_network(network, recording)


if __name__ == "__main__":
    main()
