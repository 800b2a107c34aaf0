"""Pages and API of the service: what a browser and a script see. ``create_app`` is in ``app``."""

from __future__ import annotations
