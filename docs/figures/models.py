"""Draws docs/figures/model_*.svg: what each stiction model does with one and the same command.

Run from anywhere with ``python docs/figures/models.py``; it needs the package and matplotlib. The
same versions draw the same bytes.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np

from stemwatch.models.recording import Floats
from stemwatch.models.zoo.catalogue import DATA_DRIVEN, EVERY
from stemwatch.models.zoo.model import ValveModel, values_of

HERE = Path(__file__).parent
SAMPLES = 360
COMMAND, STEM = "#8a8f98", "#0b6bcb"
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


def main() -> None:
    """All figures, in the style of the documentation."""
    with mpl.rc_context(STYLE):
        for model in EVERY:
            draw(model)


if __name__ == "__main__":
    main()
