"""Import each top-level folder as ``stemwatch.<folder>``; the rest stands in pyproject.toml."""

from setuptools import find_namespace_packages, setup

FOLDERS = ("service", "connectors", "models")

setup(
    package_dir={f"stemwatch.{folder}": folder for folder in FOLDERS},
    packages=[
        f"stemwatch.{package}"
        for folder in FOLDERS
        for package in find_namespace_packages(
            include=[folder, f"{folder}.*"], exclude=["*.__pycache__"]
        )
    ],
)
