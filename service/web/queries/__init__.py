"""What the pages ask of the database: read only, few columns, never all valves where one page of
them is shown."""

from __future__ import annotations
