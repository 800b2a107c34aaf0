"""The page of a comparison: a table, and the models' free runs over the recorded position.

One file that loads nothing; its policy allows exactly the scripts that are in it.
"""

from __future__ import annotations

from importlib.resources import files
from typing import Any

import numpy as np
from jinja2 import Environment, FunctionLoader, StrictUndefined
from markupsafe import Markup

from stemwatch.models.recording import Floats
from stemwatch.service.report.charts.thinning import ThinningGrid, lowest_and_highest
from stemwatch.service.report.html_page import script_policy
from stemwatch.service.studies.comparison.compare_models import Comparison, ModelRow

SHOWN_FIRST = 3  # models drawn before a reader chooses: the best
HERE, REPORT = "stemwatch.service.studies.comparison", "stemwatch.service.report"


def html_bytes(comparison: Comparison) -> bytes:
    """The page as UTF-8."""
    environment = Environment(
        loader=FunctionLoader(lambda name: _text(HERE, name)),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.policies["json.dumps_kwargs"] = {"separators": (",", ":"), "allow_nan": False}
    environment.filters["number"] = lambda value: f"{value:.3g}"
    library = _text(REPORT, "scripts/vendor/uPlot.iife.min.js").strip()
    script = f"{library};\n{_text(HERE, 'compare.js').strip()}"
    styles = _text(REPORT, "scripts/vendor/uPlot.min.css"), _text(HERE, "compare.css")
    page = environment.get_template("compare.html").render(
        valve=comparison.recording.valve,
        source=comparison.recording.provenance.source,
        rows=comparison.ranked(),
        train_share=round(100 * comparison.train_until / len(comparison.recording)),
        styles=Markup("\n".join(styles)),
        script=Markup(script),
        licence=_text(REPORT, "scripts/vendor/uPlot-LICENSE.txt"),
        policy=script_policy(script),
        data=_data(comparison),
    )
    return page.encode()


def _data(comparison: Comparison) -> dict[str, Any]:
    """What the plot draws: times in s, then OP, MV and each model's free run."""
    recording = comparison.recording
    grid = ThinningGrid.of(len(recording))
    traces = [{"label": "OP", "values": _points(recording.op.values, grid), "shown": True}]
    if recording.mv is not None:
        mv = _points(recording.mv.values, grid)
        traces.append({"label": "MV", "values": mv, "shown": True})
    simulated_rows = [row for row in comparison.ranked() if row.simulated is not None]
    traces += [_trace(row, grid, index < SHOWN_FIRST) for index, row in enumerate(simulated_rows)]
    return {
        "first": grid.first * recording.interval_s,
        "step": grid.step * recording.interval_s,
        "heldout": comparison.train_until * recording.interval_s,
        "traces": traces,
    }


def _trace(row: ModelRow, grid: ThinningGrid, is_visible: bool) -> dict[str, Any]:
    assert row.simulated is not None
    return {"label": row.model, "values": _points(row.simulated, grid), "shown": is_visible}


def _points(values: Floats, grid: ThinningGrid) -> list[float | None]:
    rounded = np.round(lowest_and_highest(np.asarray(values), grid), 3).tolist()
    return [value if np.isfinite(value) else None for value in rounded]


def _text(package: str, name: str) -> str:
    return files(package).joinpath(name).read_text("utf-8")
