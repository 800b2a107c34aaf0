"""``PlantPath``: where in its plant a valve is, by the levels of ISA-95 (IEC 62264-1): site, area,
unit, and the loop that it belongs to. ``PartOfPlant`` chooses valves by the first three.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Protocol, TypedDict, TypeVar

from stemwatch.models.words import listed

LEVELS = ("site", "area", "unit", "loop")
CHOSEN_BY = LEVELS[:3]
MOST_LISTED = 40  # names of a level that a message lists


class HasPath(Protocol):
    """Anything with a place in the plant: an entry of the plant file, a stored valve, a line of a
    ranking."""

    @property
    def site(self) -> str: ...
    @property
    def area(self) -> str: ...
    @property
    def unit(self) -> str: ...
    @property
    def loop(self) -> str: ...


@dataclass(frozen=True, kw_only=True)
class PlantPath:
    """The levels of one valve; an unknown level is empty."""

    site: str = ""
    area: str = ""
    unit: str = ""
    loop: str = ""

    @property
    def path(self) -> str:
        """All levels that are known: "Harbour/Crude/200/FIC-201"."""
        return path_of(self)

    @property
    def area_and_unit(self) -> str:
        """Area and unit, as a column of a table has room for them: "Crude, unit 200"."""
        unit = f"unit {self.unit}" if self.unit else ""
        return ", ".join(part for part in (self.area, unit) if part)


NO_PATH = PlantPath()


def path_of(valve: HasPath) -> str:
    """The levels of ``valve`` that are known, from the largest to the smallest."""
    return "/".join(filter(None, (valve.site, valve.area, valve.unit, valve.loop)))


class Levels(TypedDict):
    """The arguments of a ``PlantPath``."""

    site: str
    area: str
    unit: str
    loop: str


def levels_of(valve: HasPath) -> Levels:
    """The four levels of ``valve`` by name."""
    return {"site": valve.site, "area": valve.area, "unit": valve.unit, "loop": valve.loop}


def names_by_level(valves: Iterable[HasPath]) -> dict[str, tuple[str, ...]]:
    """The sites, areas and units that ``valves`` are in, by name."""
    names: dict[str, set[str]] = {level: set() for level in CHOSEN_BY}
    for valve in valves:
        for level, known in names.items():
            known.add(getattr(valve, level))
    return {level: tuple(sorted(known - {""})) for level, known in names.items()}


class UnknownPart(ValueError):
    """A site, area or unit was asked for that the plant does not have; the text lists those there
    are."""


Chosen = TypeVar("Chosen", bound=HasPath)


@dataclass(frozen=True, kw_only=True)
class PartOfPlant:
    """Sites, areas and units that are asked for; an empty level keeps everything."""

    sites: tuple[str, ...] = ()
    areas: tuple[str, ...] = ()
    units: tuple[str, ...] = ()

    def __bool__(self) -> bool:
        return bool(self.sites or self.areas or self.units)

    @property
    def asked(self) -> dict[str, tuple[str, ...]]:
        """The names that are asked for by level, levels without one left out."""
        levels = zip(CHOSEN_BY, (self.sites, self.areas, self.units), strict=True)
        return {level: names for level, names in levels if names}

    def has(self, valve: HasPath) -> bool:
        """Whether ``valve`` is in this part."""
        return all(getattr(valve, level) in names for level, names in self.asked.items())

    def valves(self, valves: Iterable[Chosen]) -> list[Chosen]:
        """Those of ``valves`` in this part, in their order. Raises ``UnknownPart``."""
        all_valves = list(valves)
        self.check(names_by_level(all_valves))
        chosen = [valve for valve in all_valves if self.has(valve)]
        if not chosen:
            asked = " and ".join(
                f"{level} {' or '.join(map(repr, names))}" for level, names in self.asked.items()
            )
            raise UnknownPart(f"no valve is in {asked}")
        return chosen

    def check(self, known: Mapping[str, Collection[str]]) -> None:
        """Raise ``UnknownPart`` where a name is not among those ``known`` of its level."""
        for level, names in self.asked.items():
            for name in names:
                if name not in known[level]:
                    raise UnknownPart(f"there is no {level} {name!r}; {_there_are(level, known)}")


def _there_are(level: str, known: Mapping[str, Collection[str]]) -> str:
    names = sorted(known[level])
    if not names:
        return f"the plant file names no {level} of any valve (key {level!r} of [[valves]])"
    return f"there {'is' if len(names) == 1 else 'are'} {listed(names, MOST_LISTED)}"


WHOLE_PLANT = PartOfPlant()
