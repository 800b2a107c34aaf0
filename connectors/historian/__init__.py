"""Text exports of plant historians, each read as it was written.

``HistorianFile`` is the connector; ``find_sources`` turns what a user typed into files;
``propose_valves`` says which valves a file holds where tags and descriptions leave no doubt, and
``position_question`` asks for the position where they leave some.
"""

from stemwatch.connectors.historian.connector import HistorianFile, propose_valves, valves_among
from stemwatch.connectors.historian.find_exports import FoundSources, find_sources
from stemwatch.connectors.historian.inspection import Inspection
from stemwatch.connectors.historian.options import ReadOptions
from stemwatch.connectors.historian.tags.perhaps_position import (
    position_question,
)

__all__ = [
    "FoundSources",
    "HistorianFile",
    "Inspection",
    "ReadOptions",
    "find_sources",
    "position_question",
    "propose_valves",
    "valves_among",
]
