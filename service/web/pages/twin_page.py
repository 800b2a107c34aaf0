"""What if: the loop around a valve, simulated with another friction, tuning or a knocker."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from fastapi import APIRouter, HTTPException, Request
from fastapi.responses import HTMLResponse, Response

from stemwatch.models.recording import Floats
from stemwatch.service.report.charts.small_plot import PlottedLine, SmallPlot
from stemwatch.service.store.screenings.restored import screening_of
from stemwatch.service.web.api.signals import LONGEST, SignalWindow, read_recording
from stemwatch.service.web.dependencies import Dependencies, Deps

if TYPE_CHECKING:
    from stemwatch.models.closed_loop.fitted_loop import FittedLoop
    from stemwatch.models.closed_loop.what_if import LoopFigures, Prediction
    from stemwatch.models.estimate import Estimate
    from stemwatch.models.recording import Recording
    from stemwatch.models.valve_chain import ValveChain
    from stemwatch.service.store.screenings.records import StoredScreening
    from stemwatch.service.store.screenings.restored import Restored
    from stemwatch.service.twin.loop_twin import TwinCache

SHOWN_S = 3600.0  # of the stretch, its newest part
POINTS = 700
NOT_SCREENED = "no run has screened it yet"
FRICTION_TIMES, TUNING_TIMES = (0.0, 2.0), (0.25, 4.0)

router = APIRouter(include_in_schema=False)


@dataclass(frozen=True, kw_only=True)
class FigureRow:
    """One figure: recorded, of the loop run as it is, and with the change."""

    name: str
    unit: str
    recorded: float | None
    as_it_is: float | None
    changed: Estimate


@router.get("/valve/what-if")
def what_if(request: Request, deps: Deps) -> HTMLResponse:
    """The twin of the valve ``id``; the change stands in the query."""
    name = deps.need_valve(request.query_params.get("id", ""))
    refused, given = "", {key: request.query_params.get(key, "")[:20] for key in _NAMES}
    values: dict[str, Any] = {"plot": None, "rows": [], "settings": "", "saved": None}
    times = dict.fromkeys(_NAMES, 1.0) | {"S": 0.0}
    try:
        times |= {key: _number(key, text) for key, text in given.items() if text}
        loop = _loop(deps, name)
        if isinstance(loop, str):
            refused = f"The loop cannot be run again: {loop}."
        else:
            values = _shown(loop, times)
    except ValueError as error:
        refused = str(error)
    return deps.renderer.page(
        request,
        "twin_page.html",
        here="ranking",
        open_alerts=deps.open_alerts(),
        valve=name,
        times=times,
        limits={key: FRICTION_TIMES if key == "S" else TUNING_TIMES for key in _NAMES},
        names=_NAMES,
        refused=refused.replace("..", "."),
        has_model=not isinstance(_chain(deps, name), str),
        **values,
    )


@router.get("/valve/what-if/valve.fmu")
def valve_unit(request: Request, deps: Deps) -> Response:
    """The valve ``id`` of its last screening as an FMI 3.0 unit for other simulators."""
    from stemwatch.service.twin.simulation_model.write_model import (
        functional_mockup_unit,
        identifier_of,
    )

    name = deps.need_valve(request.query_params.get("id", ""))
    chain = _chain(deps, name)
    if isinstance(chain, str):
        raise HTTPException(404, f"There is no model of {name} to download: {chain.rstrip('.')}.")
    headers = {"content-disposition": f'attachment; filename="{identifier_of(name)}.fmu"'}
    content = functional_mockup_unit(chain).content
    return Response(content, media_type="application/octet-stream", headers=headers)


_NAMES = {
    "S": "Friction, times the present",
    "gain": "Controller gain, times the present",
    "reset": "Reset time, times the present",
}


def _number(key: str, text: str) -> float:
    low, high = FRICTION_TIMES if key == "S" else TUNING_TIMES
    try:
        value = float(text.replace(",", "."))
    except ValueError:
        value = float("nan")
    if not low <= value <= high:
        raise ValueError(f"{_NAMES[key]}: {low:g} to {high:g} is expected, received {text!r}")
    return value


@cache
def _kept() -> TwinCache:
    from stemwatch.service.twin.loop_twin import TwinCache

    return TwinCache()


def _latest(deps: Dependencies, name: str) -> tuple[StoredScreening, Restored] | None:
    """The last screening of a valve, as it is stored and as one; ``None`` before the first run."""
    latest = deps.store.screenings(name, 1)
    if not latest:
        return None
    points = deps.store.indicators(latest[0].id)
    numbers = {name: point.indicator(name) for name, point in points.items()}
    return latest[0], screening_of(latest[0], numbers)


def _chain(deps: Dependencies, name: str) -> ValveChain | str:
    from stemwatch.models.valve_chain import valve_chain

    latest = _latest(deps, name)
    return NOT_SCREENED if latest is None else valve_chain(latest[1])


def _loop(deps: Dependencies, name: str) -> FittedLoop | str:
    latest = _latest(deps, name)
    if latest is None:
        return NOT_SCREENED
    stored, screening = latest
    start, end = stored.window
    if start is None or end is None or end - start > LONGEST:
        return "its last window has no dates, or is longer than what is read at once"
    window = SignalWindow(valve=name, start=start, stop=end)

    def read() -> Recording | str:
        recording, sentence = read_recording(deps.site, window)
        return sentence.rstrip(".") if recording is None else recording

    return _kept().twin(id(deps.store), stored.id, screening, read)


def _shown(loop: FittedLoop, times: dict[str, float]) -> dict[str, Any]:
    from stemwatch.models.closed_loop.what_if import LoopChange, predict
    from stemwatch.service.twin.loop_twin import settings_in_words

    share, valve = times["S"], loop.valve
    change = LoopChange(
        S=None if share == 1.0 else share * valve.S,
        J=None if share == 1.0 else share * valve.J,
        gain_times=times["gain"],
        reset_times=times["reset"],
    )
    prediction = predict(loop, change)
    return {
        "plot": _plot(loop, prediction),
        "rows": _rows(prediction),
        "settings": settings_in_words(loop),
        "saved": prediction.fall("error_std", squared=True),
    }


def _rows(prediction: Prediction) -> list[FigureRow]:
    names = {
        "error_std": "Standard deviation of SP - PV",
        "amplitude": "Amplitude of SP - PV",
        "period_s": "Period of PV",
        "travel_per_hour": "Travel of the stem",
        "turns_per_hour": "Reversals of the stem",
    }

    def of(figures: LoopFigures, name: str) -> float | None:
        value: float | None = getattr(figures, name)
        return value

    return [
        FigureRow(
            name=words,
            unit=prediction.predicted[name].unit,
            recorded=of(prediction.recorded, name),
            as_it_is=of(prediction.as_it_is, name),
            changed=prediction.predicted[name],
        )
        for name, words in names.items()
    ]


def _plot(loop: FittedLoop, prediction: Prediction) -> object:
    recorded, run = loop.recorded, prediction.run
    shown = min(round(SHOWN_S / recorded.interval_s), recorded.pv.size)
    stride = max(shown // POINTS, 1)
    minutes: Floats = np.arange(0, shown, stride, dtype=np.float64) * (recorded.interval_s / 60.0)

    def newest(values: Floats) -> Floats:
        return values[values.size - shown :][::stride][: minutes.size]

    drawn = [
        PlottedLine("naive", "PV as recorded", minutes, newest(recorded.pv)),
        PlottedLine("extended", "PV with the change", minutes, newest(run.pv)),
        PlottedLine("sp", "SP", minutes, newest(recorded.sp), dashed=True),
    ]
    plot = SmallPlot(
        x_label="minutes",
        y_label=f"PV, {loop.unit}",
        description="PV as it was recorded and as it would have been with the change.",
        lines=drawn,
        width=740,
    )
    return plot.svg()
