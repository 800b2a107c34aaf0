"""``Dependencies``: the site, its templates and the actions, for every route."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from typing import Annotated

from fastapi import Depends, HTTPException, Request

from stemwatch.models.oscillation_groups.plant_groups import OscillationGroup
from stemwatch.service.store.store import Store
from stemwatch.service.web.actions import Actions
from stemwatch.service.web.page_renderer import PageRenderer
from stemwatch.service.web.site import Site


@dataclass(frozen=True, kw_only=True)
class Dependencies:
    """The site, its templates, and what a reader may do."""

    site: Site
    renderer: PageRenderer
    actions: Actions

    @property
    def store(self) -> Store:
        """The store behind the site."""
        return self.site.store

    @property
    def now(self) -> datetime:
        """The time in UTC by the clock of the site, which tests set."""
        return self.site.clock()

    def open_alerts(self) -> int:
        """How many alerts are open, for the head of every page."""
        return self.store.alerts.count_open(self.now)

    def standing_groups(self) -> list[OscillationGroup]:
        """The groups of loops that oscillate together at present."""
        return [kept.group for kept in self.store.oscillations(self.now) if not kept.over]

    def need_valve(self, valve: str) -> str:
        """``valve``, or 404 where neither store nor plant knows it."""
        if self.site.plant is not None and valve in self.site.plant.valves:
            return valve
        if self.store.knows(valve):
            return valve
        raise HTTPException(404, f"There is no valve {valve!r}.")


def _dependencies(request: Request) -> Dependencies:
    deps: Dependencies = request.app.state.deps
    return deps


Deps = Annotated[Dependencies, Depends(_dependencies)]
