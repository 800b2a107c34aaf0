"""The maintenance report: one page per valve for those who do the work, and the work orders."""

from stemwatch.service.maintenance.background import NOTHING_KNOWN, Background
from stemwatch.service.maintenance.write import MaintenanceFiles, write_maintenance

__all__ = ["NOTHING_KNOWN", "Background", "MaintenanceFiles", "write_maintenance"]
