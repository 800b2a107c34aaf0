"""What runs in the plant: command line, pipeline, store, reports."""

from importlib.metadata import version

__version__ = version("stemwatch")
