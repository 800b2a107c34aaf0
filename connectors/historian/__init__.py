"""Text exports of plant historians, each read as it was written.

``HistorianFile`` is the connector; ``find_sources`` turns what a user typed into files;
``propose_valves`` says which valves a file holds where tags and descriptions leave no doubt.
"""

from stemwatch.connectors.historian.file import HistorianFile, propose_valves
from stemwatch.connectors.historian.inspection import Inspection
from stemwatch.connectors.historian.options import ReadOptions
from stemwatch.connectors.historian.sources import FoundSources, find_sources

__all__ = [
    "FoundSources",
    "HistorianFile",
    "Inspection",
    "ReadOptions",
    "find_sources",
    "propose_valves",
]
