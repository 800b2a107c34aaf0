"""Pages and API of the service, for browsers and programs. ``create_app`` is in ``app``."""

from __future__ import annotations
