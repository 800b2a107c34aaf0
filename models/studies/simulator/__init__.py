"""A simulated plant: closed loops with healthy and sticking valves, for tests and demonstration.

It is written from the force balance of the valve in continuous time, and shares neither code nor
discretisation with the stick-slip element that the product fits.
"""

from stemwatch.models.studies.simulator.demo import demo_plant as demo_plant
from stemwatch.models.studies.simulator.demo import weeks_before as weeks_before
from stemwatch.models.studies.simulator.draws import draw_healthy as draw_healthy
from stemwatch.models.studies.simulator.draws import draw_sticky as draw_sticky
from stemwatch.models.studies.simulator.loop import PlantLoop as PlantLoop
from stemwatch.models.studies.simulator.simulate import SimulatedLoop as SimulatedLoop
from stemwatch.models.studies.simulator.simulate import simulate_loop as simulate_loop
from stemwatch.models.studies.simulator.truth import Truth as Truth
from stemwatch.models.studies.simulator.valve import Actuator as Actuator
from stemwatch.models.studies.simulator.valve import SimulatedValve as SimulatedValve
