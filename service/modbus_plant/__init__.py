"""A simulated plant for demonstrations and tests: valves behind a Modbus server, live, some
wearing.

``PlantServer`` serves loops of the simulator (``stemwatch.models.studies.simulator``) as registers;
``serve_plant`` does so until it is stopped and writes the plant file that reads them.
"""

from stemwatch.service.modbus_plant.plant_file import plant_toml as plant_toml
from stemwatch.service.modbus_plant.plant_server import PlantServer as PlantServer
from stemwatch.service.modbus_plant.plant_server import serve_plant as serve_plant
from stemwatch.service.modbus_plant.wear import Wear as Wear
