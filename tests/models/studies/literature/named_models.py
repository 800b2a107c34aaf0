"""Every model of the literature by its name."""

from __future__ import annotations

from stemwatch.models.studies.literature.catalogue import EVERY

BY_NAME = {model.name: model for model in EVERY}
