"""``plant.toml``: the plant's sources, valves, limits and store, read with every mistake named."""

from stemwatch.connectors.settings import Problem as Problem
from stemwatch.service.config.load import load_plant as load_plant
from stemwatch.service.config.plant import Plant as Plant
from stemwatch.service.config.problems import PlantFileError as PlantFileError
from stemwatch.service.config.schema import Tag as Tag
from stemwatch.service.config.schema import Tags as Tags
from stemwatch.service.config.schema import Valve as Valve
