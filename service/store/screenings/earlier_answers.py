"""What OP and PV alone said of a loop in its last windows, which counts with its newest."""

from __future__ import annotations

from datetime import timedelta

from sqlalchemy import select
from sqlalchemy.orm import Session

from stemwatch.models.without_position.several_recordings import LAST_THAT_COUNT
from stemwatch.service.store.screenings.baselines import last_work
from stemwatch.service.store.screenings.evidence import WEEKS
from stemwatch.service.store.screenings.records import EarlierAnswer
from stemwatch.service.store.screenings.rows import without_position_of
from stemwatch.service.store.screenings.tables import ScreeningRow

_MOST_ROWS = 8 * LAST_THAT_COUNT  # windows that share samples, of which one in eight counts


def read_earlier_answers(session: Session, valve: str, run_id: int) -> list[EarlierAnswer]:
    """What OP and PV alone said in windows of other runs than ``run_id``, the last first; of those
    of one run no other counts, since they are over in any order.

    Windows before or during the last work on the valve do not count, nor one that shares samples
    with a later one, nor what is older than ``WEEKS``.
    """
    table = ScreeningRow
    statement = select(
        table.id, table.window_start, table.window_end, table.without_position
    ).where(
        table.valve == valve,
        table.run_id != run_id,
        table.window_start.is_not(None),
        table.window_end.is_not(None),
    )
    if (worked_at := last_work(session, [valve]).get(valve)) is not None:
        statement = statement.where(table.window_start >= worked_at)
    statement = statement.order_by(table.at.desc(), table.id.desc()).limit(_MOST_ROWS)
    answers: list[EarlierAnswer] = []
    for screening, start, end, stored in session.execute(statement):
        answer = without_position_of(stored)
        if answer is None or (answers and end > answers[-1].start):
            continue
        if answers and end < answers[0].end - timedelta(weeks=WEEKS):
            break
        answers.append(EarlierAnswer(screening=screening, start=start, end=end, answer=answer))
    return answers[:LAST_THAT_COUNT]
