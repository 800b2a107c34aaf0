"""``Dependencies``: what every route is given: the site, its templates, and the actions."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime
from typing import Annotated

from fastapi import Depends, HTTPException, Request
from sqlalchemy.orm import Session

from stemwatch.service.store.store import Store
from stemwatch.service.web.actions import Actions
from stemwatch.service.web.page_renderer import PageRenderer
from stemwatch.service.web.queries.alerts import count_open
from stemwatch.service.web.queries.valve import is_known
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
        """The time, UTC."""
        return self.site.clock()

    @contextmanager
    def reading(self) -> Iterator[Session]:
        """A session that only reads. Raises ``StoreError``."""
        with self.store.access.reading() as session:
            yield session

    def open_alerts(self) -> int:
        """How many alerts are open, for the head of every page."""
        with self.reading() as session:
            return count_open(session, self.now)

    def need_valve(self, valve: str) -> str:
        """``valve``, or 404 where neither store nor plant knows it."""
        if self.site.plant is not None and valve in self.site.plant.valves:
            return valve
        with self.reading() as session:
            if is_known(session, valve):
                return valve
        raise HTTPException(404, f"There is no valve {valve!r}.")


def _dependencies(request: Request) -> Dependencies:
    found: Dependencies = request.app.state.deps
    return found


Deps = Annotated[Dependencies, Depends(_dependencies)]
