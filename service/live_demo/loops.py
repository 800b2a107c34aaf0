"""The control loops of the live demo."""

from __future__ import annotations

from stemwatch.models.studies.simulator import Actuator, PlantLoop, SimulatedValve
from stemwatch.models.studies.simulator.loop import (
    Controller,
    Load,
    LoadKind,
    Process,
    PvRange,
    SimulatedArchive,
)

WEARING = "FIC-101"
INTERVAL_S = 0.2  # s between updates of the simulated registers; polls are less frequent
# Too quick for the polls to show. A lag that they show is named, and the valve is not healthy.
_QUICK = Actuator(air_lag_s=0.05)
STROKES = {WEARING: "40 mm", "FIC-102": "50 mm", "FIC-103": "30 mm"}  # full travel, by tag
_FLOW = PvRange(unit="t/h", low=0.0, high=40.0)


def live_loops() -> list[PlantLoop]:
    """Three fast loops with healthy valves. The valve of the first will wear; the third oscillates
    because of a disturbance, not because of its valve."""
    load = Load(kind=LoadKind.COLOURED, size=1.6, time_s=8.0)
    wave = Load(kind=LoadKind.OSCILLATING, size=4.0, time_s=25.0, drift_rad=0.25)
    return [
        PlantLoop(
            tag=WEARING,
            description="Naphtha feed to the reactor",
            area="Reforming",
            criticality=3,
            story="healthy at first, then it wears",
            valve=SimulatedValve.showing(0.4, 0.16, actuator=_QUICK),
            process=Process(gain=1.0, lag_s=2.0, dead_time_s=0.6),
            controller=Controller(gain=0.5, reset_s=2.4, scan_s=0.2),
            archive=SimulatedArchive(interval_s=INTERVAL_S),
            pv_range=_FLOW,
            loads=(load,),
        ),
        PlantLoop(
            tag="FIC-102",
            description="Recycle gas to the charge heater",
            area="Reforming",
            criticality=3,
            story="healthy, smart positioner",
            valve=_positioned(),
            process=Process(gain=1.0, lag_s=2.0, dead_time_s=0.6),
            controller=Controller(gain=0.5, reset_s=3.0, scan_s=0.2, set_point=42.0, output=55.0),
            archive=SimulatedArchive(interval_s=INTERVAL_S),
            pv_range=_FLOW,
            loads=(Load(kind=LoadKind.COLOURED, size=1.2, time_s=10.0),),
        ),
        PlantLoop(
            tag="FIC-103",
            description="Reflux to the stabiliser",
            area="Fractionation",
            criticality=2,
            story="healthy, oscillating disturbance",
            valve=SimulatedValve.showing(0.4, 0.1, actuator=_QUICK),
            process=Process(gain=1.0, lag_s=2.0, dead_time_s=0.6),
            controller=Controller(gain=0.5, reset_s=3.0, scan_s=0.2, set_point=58.0, output=47.0),
            archive=SimulatedArchive(interval_s=INTERVAL_S),
            pv_range=_FLOW,
            loads=(wave, Load(kind=LoadKind.COLOURED, size=0.6, time_s=8.0)),
        ),
    ]


def _positioned() -> SimulatedValve:
    actuator = Actuator(air_lag_s=1.5)
    return SimulatedValve.showing(0.3, 0.0, positioner_gain=9.0, actuator=actuator)
