"""The service: collector, scheduler, watched folders, alerts and pages, started and stopped
together."""

from stemwatch.service.serve.service import ListenAddress as ListenAddress
from stemwatch.service.serve.service import Service as Service
