"""A simulated plant: closed loops with healthy and sticking valves, for tests and demonstration.

It is written from the force balance of the valve in continuous time, and shares neither code nor
discretisation with the stick-slip element that the product fits.
"""

from stemwatch.models.plant.demo import demo_plant as demo_plant
from stemwatch.models.plant.draws import draw_healthy as draw_healthy
from stemwatch.models.plant.draws import draw_sticky as draw_sticky
from stemwatch.models.plant.loop import PlantLoop as PlantLoop
from stemwatch.models.plant.simulate import SimulatedLoop as SimulatedLoop
from stemwatch.models.plant.simulate import simulate_loop as simulate_loop
from stemwatch.models.plant.truth import Truth as Truth
from stemwatch.models.plant.valve import Actuator as Actuator
from stemwatch.models.plant.valve import Valve as Valve
