"""All tables of the store in one ``metadata``, for migrations, checks and backups."""

from __future__ import annotations

from stemwatch.service.store.accounts import tables as accounts
from stemwatch.service.store.alerts import tables as alerts
from stemwatch.service.store.database.columns import TableBase
from stemwatch.service.store.runs import tables as runs
from stemwatch.service.store.samples import tables as samples
from stemwatch.service.store.screenings import tables as screenings

TABLES = (accounts, alerts, runs, samples, screenings)  # importing them registers their tables
metadata = TableBase.metadata
