"""How many valves need work, are to be watched, cannot be judged or need nothing, and the sentence
that says so in every output."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from stemwatch.models.words import counted
from stemwatch.service.presenter.work_decision import WorkDecision, WorkState


@dataclass(frozen=True, kw_only=True)
class WorkCounts:
    """How many valves are in each state of work. ``recordings`` exceeds ``valves`` where a tag has
    several recordings.

    ``orders`` of the valves that cannot be judged get a work order to find out why.
    """

    recordings: int
    needs_work: int
    watch: int
    not_judged: int
    no_work: int
    orders: int = 0

    @classmethod
    def of_states(cls, states: Mapping[WorkState, int], orders: int = 0) -> WorkCounts:
        """The counts where each valve is counted already."""
        return cls(
            recordings=sum(states.values()),
            needs_work=states[WorkState.NEEDS_WORK],
            watch=states[WorkState.WATCH],
            not_judged=states[WorkState.NOT_JUDGED],
            no_work=states[WorkState.NO_WORK],
            orders=orders,
        )

    @property
    def valves(self) -> int:
        """How many valves there are: the sum of the four states."""
        return self.needs_work + self.watch + self.not_judged + self.no_work

    @property
    def headline(self) -> str:
        """How many valves need work: "4 of 15 valves need work"; or that nobody can say. Of a
        single valve: what it needs."""
        if self.valves == 1:
            return f"The valve {self._of_the_only_one}"
        if self.not_judged == self.valves:
            return f"None of {counted(self.valves, 'valve')} can be judged"
        needs = "needs" if self.needs_work <= 1 else "need"
        return f"{self.needs_work or 'None'} of {counted(self.valves, 'valve')} {needs} work"

    @property
    def _of_the_only_one(self) -> str:
        if self.not_judged:
            return "cannot be judged"
        if self.watch:
            return "is to be watched"
        return "needs work" if self.needs_work else "needs no work"

    @property
    def rest(self) -> str:
        """The other valves, those that cannot be judged among them; empty where there are none."""
        if self.valves == 1:
            return "its work order says how to find out why" if self.orders else ""
        clauses = []
        if self.watch:
            clauses.append(f"{self.watch} to watch")
        to_find_out = f"{self.orders} with a work order to find out why" if self.orders else ""
        if self.not_judged == self.valves:
            return to_find_out
        if self.not_judged:
            reason_clause = f" ({to_find_out})" if to_find_out else ""
            clauses.append(f"{self.not_judged} cannot be judged{reason_clause}")
        if self.no_work:
            clauses.append(f"{self.no_work} without work")
        return ", ".join(clauses)

    @property
    def sentence(self) -> str:
        """All of it in one sentence: the same in report, PDF, work orders and terminal."""
        if not self.valves:
            return "No valve was screened."
        text = f"{self.headline}; {self.rest}" if self.rest else self.headline
        if self.recordings > self.valves:
            text += f" ({self.recordings} recordings)"
        return f"{text}."


def count_valves(decided: Iterable[tuple[str, WorkDecision]]) -> WorkCounts:
    """Valves by their state, each valve once by its tag.

    Where a tag has several recordings, one that shows work counts, then one to watch; it cannot be
    judged only where none of them allows a verdict.
    """
    rank = (WorkState.NEEDS_WORK, WorkState.WATCH, WorkState.NO_WORK, WorkState.NOT_JUDGED)
    states: dict[str, WorkState] = {}
    ordered: set[str] = set()
    recordings = 0
    for valve, decision in decided:
        recordings += 1
        states[valve] = min(states.get(valve, decision.state), decision.state, key=rank.index)
        if decision.has_order and not decision.needs_work:
            ordered.add(valve)
    counts = {
        state: [v for v, its_state in states.items() if its_state is state] for state in WorkState
    }
    return WorkCounts(
        recordings=recordings,
        needs_work=len(counts[WorkState.NEEDS_WORK]),
        watch=len(counts[WorkState.WATCH]),
        not_judged=len(counts[WorkState.NOT_JUDGED]),
        no_work=len(counts[WorkState.NO_WORK]),
        orders=len(ordered.intersection(counts[WorkState.NOT_JUDGED])),
    )
