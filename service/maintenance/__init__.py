"""The maintenance report: one page per valve for the technician, and the work orders."""

from stemwatch.service.maintenance.valve_history import (
    NOTHING_KNOWN,
    ValveHistory,
)
from stemwatch.service.maintenance.write_maintenance import MaintenanceFiles, write_maintenance

__all__ = [
    "NOTHING_KNOWN",
    "MaintenanceFiles",
    "ValveHistory",
    "write_maintenance",
]
