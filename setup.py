"""Maps the tree to the package: ``stemwatch/`` is the front door, and each folder beside it is
imported as ``stemwatch.<folder>``. The rest stands in pyproject.toml.

The links ``stemwatch/models`` and so on serve editors and type checkers in a checkout. They are not
followed here, so that nothing is packed twice and a checkout without links installs as well.
"""

from setuptools import find_namespace_packages, setup

FOLDERS = ("service", "connectors", "models")

setup(
    package_dir={"stemwatch": "stemwatch"} | {f"stemwatch.{folder}": folder for folder in FOLDERS},
    packages=[
        "stemwatch",
        *(
            f"stemwatch.{package}"
            for folder in FOLDERS
            for package in find_namespace_packages(
                include=[folder, f"{folder}.*"], exclude=["*.__pycache__"]
            )
        ),
    ],
)
