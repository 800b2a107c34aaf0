"""What runs in the plant: command line, runs, store, reports."""

from importlib.metadata import version

__version__ = version("stemwatch")
