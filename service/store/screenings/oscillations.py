"""Loops that oscillate together, kept from run to run: the same oscillation is recognised in the
next window, and one that a later run of its loops no longer finds is over."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta

from sqlalchemy import delete, func, select
from sqlalchemy.orm import Session, undefer

from stemwatch.models.oscillation_groups.over_windows import (
    LINKED_WITHIN,
    OscillationWindow,
    continued,
    is_same_oscillation,
)
from stemwatch.models.oscillation_groups.plant_groups import GroupMember, OscillationGroup
from stemwatch.service.store.screenings.tables import OscillationRow, ScreeningRow
from stemwatch.service.store.storable import from_row

SHOWN_DAYS = 30
JUST_BEFORE = timedelta(days=1)  # within which an earlier window without a group dates its begin


@dataclass(frozen=True, kw_only=True)
class KeptOscillation:
    """The newest window of an oscillation; ``over`` where a later run over more than half of its
    loops did not find it again. ``history`` has its windows of the days shown, the oldest first."""

    run_id: int
    at: datetime
    group: OscillationGroup
    over: bool
    history: tuple[OscillationWindow, ...]


def write_oscillations(
    session: Session, run_id: int, groups: Sequence[OscillationGroup]
) -> list[OscillationGroup]:
    """Keep the groups of a run instead of those it had, and of the same window screened earlier;
    the groups, in the order given, with since when and in how many windows each was found. Those of
    earlier windows are written first, whatever their order: a run over several windows finds an
    oscillation in each of them.

    A run over a part of the plant finds a part of a group: the whole one of that window stays.
    """
    session.execute(delete(OscillationRow).where(OscillationRow.run_id == run_id))
    kept = list(groups)
    by_start = sorted(range(len(groups)), key=lambda number: str(groups[number].start))
    for number in by_start:
        group = groups[number]
        window_and_earlier = _rows_until(session, group)
        for row in [row for row in window_and_earlier if row.start == group.start]:
            if is_same_oscillation(group, _group(row)) and _looked_for(session, row, run_id):
                session.delete(row)
        earlier = [row for row in window_and_earlier if row.start != group.start]
        linked = continued(group, [_group(row) for row in earlier])
        follows = None
        if linked.windows > 1:
            same_oscillation = [row for row in earlier if is_same_oscillation(group, _group(row))]
            follows = max(same_oscillation, key=_start_and_size).id
        elif linked.since is None and _was_absent(session, run_id, linked):
            linked = replace(linked, since=linked.start)
        session.add(_row(run_id, follows, linked))
        kept[number] = linked
    return kept


def read_oscillations(
    session: Session, now: datetime, loop: str | None = None, pictures: bool = True
) -> list[KeptOscillation]:
    """The oscillations of the last ``SHOWN_DAYS``, those that stand first, then those with most
    loops moved; only those of ``loop`` where one is given. ``pictures``: with spectra and strength.

    The days are counted back from the newest results, whose verdicts the pages show too: of a plant
    whose recordings are months old its report and its pages say the same.
    """
    since = min(now, _newest_result(session) or now) - timedelta(days=SHOWN_DAYS)
    statement = select(OscillationRow).where(OscillationRow.at >= since)
    if pictures:
        statement = statement.options(undefer(OscillationRow.pictures))
    rows = {row.id: row for row in session.scalars(statement.order_by(OscillationRow.at))}
    followed = {row.follows for row in rows.values()}
    newest = [row for row in rows.values() if row.id not in followed]
    if loop is not None:
        newest = [row for row in newest if loop in row.members["loops"]]
    kept_oscillations = [
        KeptOscillation(
            run_id=row.run_id,
            at=row.at,
            group=_group(row, pictures),
            over=_looked_for(session, row),
            history=_history(row, rows),
        )
        for row in newest
        if not any(_is_part_of(row, other) for other in rows.values())
    ]
    return sorted(kept_oscillations, key=lambda kept: (kept.over, -_moved(kept.group)))


def _moved(group: OscillationGroup) -> float:
    return sum(member.share for member in group.members)


def _start_and_size(row: OscillationRow) -> tuple[str, int]:
    return str(row.start), len(row.members["loops"])


def _is_part_of(row: OscillationRow, other: OscillationRow) -> bool:
    """Whether a run over more loops found ``row``, and more of its loops, in the same window."""
    return (
        row.start is not None
        and row.start == other.start
        and len(row.members["loops"]) < len(other.members["loops"])
        and is_same_oscillation(_group(row), _group(other))
    )


def _rows_until(session: Session, group: OscillationGroup) -> list[OscillationRow]:
    """Of the group's own window and of those before that it can continue."""
    if group.start is None:
        return []
    return list(
        session.scalars(
            select(OscillationRow).where(
                OscillationRow.start <= group.start,
                OscillationRow.at >= group.start - LINKED_WITHIN,
            )
        )
    )


def _was_absent(session: Session, run_id: int, group: OscillationGroup) -> bool:
    """Whether windows that ended within a day before the group's were looked at for at least half
    of its loops: since it was not found there, it began after them."""
    if group.start is None:
        return False
    names = [member.loop for member in group.members]
    table = ScreeningRow
    loops_before = session.scalar(
        select(func.count(func.distinct(table.valve))).where(
            table.valve.in_(names),
            table.run_id != run_id,
            table.window_end <= group.start,
            table.window_end >= group.start - JUST_BEFORE,
        )
    )
    return 2 * (loops_before or 0) >= len(names)


def _newest_result(session: Session) -> datetime | None:
    """The end of the newest window of the last run, or of the last oscillation if that is newer."""
    last_run = select(func.max(ScreeningRow.run_id)).scalar_subquery()
    ends = (
        session.scalar(select(func.max(ScreeningRow.at)).where(ScreeningRow.run_id == last_run)),
        session.scalar(select(func.max(OscillationRow.at))),
    )
    return max((end for end in ends if end is not None), default=None)


def _looked_for(session: Session, row: OscillationRow, run_id: int | None = None) -> bool:
    """Whether more than half of the loops of ``row`` were screened in the run ``run_id``, or where
    none is given in any one later run: that run would have found what is left of it."""
    table = ScreeningRow
    loops = func.count(func.distinct(table.valve))
    in_run = table.run_id > row.run_id if run_id is None else table.run_id == run_id
    of_run = (
        select(loops)
        .where(table.valve.in_(row.members["loops"]), in_run)
        .group_by(table.run_id)
        .order_by(loops.desc())
        .limit(1)
    )
    return 2 * (session.scalar(of_run) or 0) > len(row.members["loops"])


def _history(
    newest: OscillationRow, rows: dict[int, OscillationRow]
) -> tuple[OscillationWindow, ...]:
    history: list[OscillationWindow] = []
    row: OscillationRow | None = newest
    while row is not None:
        group = _group(row)
        history.append(
            OscillationWindow(
                at=row.at,
                variance_share=group.variance_share,
                period_s=group.period_s,
                source=group.source,
            )
        )
        row = None if row.follows is None else rows.get(row.follows)
    return tuple(history[::-1])


def _row(run_id: int, follows: int | None, group: OscillationGroup) -> OscillationRow:
    end = group.start and group.start + timedelta(seconds=group.duration_s)
    return OscillationRow(
        run_id=run_id,
        follows=follows,
        at=end or datetime.now(UTC),
        start=group.start,
        duration_s=group.duration_s,
        period_s=group.period_s,
        regularity=group.regularity,
        outside=group.outside,
        since=group.since,
        first_found=group.first_found,
        windows=group.windows,
        members={
            "loops": [member.loop for member in group.members],
            "shares": [member.share for member in group.members],
            "probabilities": [member.probability for member in group.members],
            "evidence": [list(member.evidence) for member in group.members],
        },
        pictures={
            "strength": list(group.strength),
            "periods_s": list(group.periods_s),
            "spectra": [list(powers) for powers in group.spectra],
        },
    )


def _group(row: OscillationRow, pictures: bool = False) -> OscillationGroup:
    of_members = (row.members[key] for key in ("loops", "shares", "probabilities", "evidence"))
    pictures_stored = row.pictures if pictures else {"strength": (), "periods_s": (), "spectra": ()}
    return from_row(
        OscillationGroup,
        row,
        members=tuple(
            GroupMember(loop=loop, share=share, probability=probability, evidence=tuple(evidence))
            for loop, share, probability, evidence in zip(*of_members, strict=True)
        ),
        strength=tuple(pictures_stored["strength"]),
        periods_s=tuple(pictures_stored["periods_s"]),
        spectra=tuple(tuple(powers) for powers in pictures_stored["spectra"]),
    )
