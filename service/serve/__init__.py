"""``stemwatch serve``: collector, scheduler, watched folders, alerts and pages in one service."""

from stemwatch.service.serve.service import ListenAddress as ListenAddress
from stemwatch.service.serve.service import Service as Service
