"""Samples that live sources and watched folders delivered, and how those sources are doing."""
