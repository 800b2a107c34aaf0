"""Text exports of plant historians, each read as it was written.

``HistorianFile`` is the connector; ``find_sources`` turns what a user typed into files;
``propose_valves`` says which valves a file holds where tags and descriptions leave no doubt.
"""

from stemwatch.connectors.historian.connector import HistorianFile, propose_valves
from stemwatch.connectors.historian.find_exports import FoundSources, find_sources
from stemwatch.connectors.historian.inspection import Inspection
from stemwatch.connectors.historian.options import ReadOptions

__all__ = [
    "FoundSources",
    "HistorianFile",
    "Inspection",
    "ReadOptions",
    "find_sources",
    "propose_valves",
]
