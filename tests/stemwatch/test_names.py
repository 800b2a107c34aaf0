"""The names that ``import stemwatch`` promises: these and no others, each with its words."""

from __future__ import annotations

import doctest
import inspect
from importlib.metadata import version

import pytest

import stemwatch as sw
from stemwatch import functions
from stemwatch.models import recording

PROMISED = [
    "Recording",
    "__version__",
    "explain",
    "plan_test",
    "read",
    "screen",
    "simulate",
    "twin",
]
FUNCTIONS = [sw.explain, sw.plan_test, sw.read, sw.screen, sw.simulate, sw.twin]


def test_nothing_is_promised_beside_the_names() -> None:
    """``__all__``, ``dir`` and ``from stemwatch import *`` agree, whatever was imported before."""
    assert PROMISED == list(sw.__all__) == dir(sw)
    names: dict[str, object] = {}
    exec("from stemwatch import *", names)
    assert set(PROMISED) == set(names) - {"__builtins__"}


def test_the_version_is_that_of_the_package() -> None:
    """One number, wherever it is asked for."""
    assert version("stemwatch") == sw.__version__


def test_a_name_that_is_not_there_says_so() -> None:
    """An unknown name raises ``AttributeError`` like any module."""
    with pytest.raises(AttributeError, match="module 'stemwatch' has no attribute 'sceen'"):
        sw.sceen  # type: ignore[attr-defined]  # noqa: B018


@pytest.mark.parametrize("function", FUNCTIONS, ids=lambda item: item.__name__)
def test_every_function_says_arguments_result_errors_and_an_example(function: object) -> None:
    """Each argument is described by its name."""
    assert inspect.isfunction(function)
    text = inspect.getdoc(function) or ""
    for part in ("Args:", "Returns:", "Raises:", "Example:"):
        assert part in text
    described = text.replace("**", "").replace(":", ",").replace("\n", " ").split()
    arguments = {f"{name}," for name in inspect.signature(function).parameters}
    assert arguments <= set(described)


@pytest.mark.parametrize("module", [functions, recording], ids=lambda item: item.__name__)
def test_the_examples_run(module: object) -> None:
    """Each prints what stands below it."""
    assert inspect.ismodule(module)
    result = doctest.testmod(module)
    assert result.attempted > 0
    assert result.failed == 0
