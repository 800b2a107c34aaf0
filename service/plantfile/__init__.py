"""``plant.toml``: the plant's sources, valves, limits and store, read with every mistake named."""

from stemwatch.service.plantfile.load import load_plant as load_plant
from stemwatch.service.plantfile.plant import Plant as Plant
from stemwatch.service.plantfile.problem import PlantFileError as PlantFileError
from stemwatch.service.plantfile.problem import Problem as Problem
from stemwatch.service.plantfile.schema import Source as Source
from stemwatch.service.plantfile.schema import Tag as Tag
from stemwatch.service.plantfile.schema import Tags as Tags
from stemwatch.service.plantfile.schema import Valve as Valve
