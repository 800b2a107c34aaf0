"""``Site``: what the pages work with: the store, a plant, and the actions allowed.

The pages never screen, fit or poll: what takes longer than a query is queued for the scheduler.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, tzinfo
from zoneinfo import ZoneInfo

from stemwatch.connectors.connector import Window
from stemwatch.models.limits import Limits
from stemwatch.models.recording import Recording
from stemwatch.models.screening_result import Indicator
from stemwatch.service.config import Plant
from stemwatch.service.config.in_force import limits_in_force
from stemwatch.service.presenter.cost_of_sticking import CostOfSticking, cost_of_sticking
from stemwatch.service.store.store import Store
from stemwatch.service.web.actions import Actions

LOOPBACK = ("localhost", "127.0.0.1", "[::1]")

# The valve's id and a window, both ends known; ``None`` where nothing is recorded there. May raise
# ``ConnectorError``, whose sentence the page shows.
Read = Callable[[str, Window], Recording | None]


@dataclass(frozen=True, kw_only=True)
class Check:
    """One line of ``/healthz``: ``name`` of a part, whether it works, and its message.

    ``vital`` parts decide ``/ready``: without one of them the service does not work.
    """

    name: str
    ok: bool
    says: str = ""
    vital: bool = False


@dataclass(frozen=True, kw_only=True)
class Site:
    """What ``create_app`` serves.

    ``plant`` may be ``None``: then the pages show what is stored, in UTC. ``read`` gives samples
    for the plots of a valve. ``actions`` is what a reader may set off, on the store alone where it
    is not given. ``checks`` are asked by ``/healthz``. ``hosts`` are the names under which a
    browser may ask: those of this machine unless told otherwise; ``("*",)`` is any. ``token`` lets
    a program read and act, besides those of users, where it is not empty (``STEMWATCH_WEB_TOKEN``).
    """

    store: Store
    plant: Plant | None = None
    read: Read | None = None
    actions: Actions | None = None
    checks: Callable[[], Sequence[Check]] = tuple
    hosts: tuple[str, ...] = LOOPBACK
    token: str = field(default="", repr=False)
    clock: Callable[[], datetime] = lambda: datetime.now(UTC)

    @property
    def zone(self) -> str:
        """The IANA name of the zone in which times are shown."""
        return (self.plant.zone if self.plant else None) or "UTC"

    @property
    def tz(self) -> tzinfo:
        """The zone in which times are shown."""
        return ZoneInfo(self.zone)

    @property
    def name(self) -> str:
        """The plant's name; empty where it has none."""
        return self.plant.name if self.plant else ""

    def cost_of(self, valve: str, made: Mapping[str, Indicator]) -> CostOfSticking | None:
        """The cost of the sticking of ``valve``, from the indicators of its screening and the plant
        file's prices."""
        entry = self.plant.valves.get(valve) if self.plant else None
        currency = self.plant.currency if self.plant else ""
        return cost_of_sticking(made, entry.prices if entry else None, currency)

    def costs(self) -> dict[str, CostOfSticking]:
        """What the sticking costs of each valve with a price that sticks by its latest
        screening."""
        valves = self.plant.valves.values() if self.plant else ()
        made = self.store.made_by_sticking([valve.id for valve in valves if valve.prices])
        costs = {
            valve: self.cost_of(valve, {name: one.indicator(name) for name, one in points.items()})
            for valve, points in made.items()
        }
        return {valve: cost for valve, cost in costs.items() if cost and cost.is_money}

    @property
    def limits(self) -> Limits:
        """The limits that verdicts are measured against: the plant file's, and those set here."""
        return limits_in_force(self.plant, self.store.browser_settings.limits())
