"""The rules of the house that a machine can check, each with the places that break it."""

from __future__ import annotations

import ast
import gc
import shutil
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parent.parent
PACKAGES = ("stemwatch", "service", "connectors", "models")
LONGEST_FUNCTION = 70
LONGEST_FILE = 700
# Ways to reach a file or a terminal that need no import.
BUILT_IN_DOORS = frozenset({"open", "print", "input", "breakpoint"})
FILE_METHODS = frozenset(
    {"read_text", "read_bytes", "write_text", "write_bytes", "tofile", "mkdir"}
)
NUMPY_FILES = frozenset({"load", "save", "savez", "loadtxt", "savetxt", "fromfile", "memmap"})

OF_ALEMBIC = frozenset({"upgrade", "downgrade"})  # the module says what its migration does

Function = ast.FunctionDef | ast.AsyncFunctionDef


def test_the_import_contracts_hold() -> None:
    """Layers point one way, models do no I/O, and the simulator is apart from what is fitted."""
    command = shutil.which("lint-imports", path=str(Path(sys.executable).parent))
    assert command is not None
    process = subprocess.run(
        [command, "--no-cache"], cwd=REPOSITORY, capture_output=True, text=True, check=False
    )
    assert process.returncode == 0, process.stdout + process.stderr


def test_models_open_print_and_write_nothing() -> None:
    """What an import contract cannot see: no call in models reaches a file or a terminal."""
    doors = [
        f"{_place(path, call)} calls {ast.unparse(call.func)}"
        for path in _sources(("models",))
        for call in ast.walk(_tree(path))
        if isinstance(call, ast.Call) and _is_door(call.func)
    ]
    assert doors == []


def test_kernels_copy_samples_one_by_one() -> None:
    """For arrays numba compiles the words of its error about shapes too, which takes seconds."""
    copied = [
        f"{_place(path, line)}: {ast.unparse(line)}"
        for path in _sources(("models",))
        for function in _functions(path)
        if any(_compiles(decorator) for decorator in function.decorator_list)
        for line in ast.walk(function)
        if isinstance(line, ast.Assign) and _copies_arrays(line, function)
    ]
    assert copied == []


@pytest.mark.parametrize(
    ("line", "copies"),
    [
        ("out[:] = op", True),
        ("out[:, k] = 2.0 * op[:, k - 1]", True),
        ("total, out[:2] = 0.0, np.exp(op)", True),
        ("row[:] = 1.0 / count", False),
        ("out[first:] = op[k]", False),
        ("out[k] = op[k]", False),
    ],
)
def test_a_copy_of_an_array_is_recognised(line: str, copies: bool) -> None:
    """The check above sees what it is there for."""
    source = f"def kernel(op: Floats, out: Floats, count: int) -> None:\n    {line}"
    (function,) = ast.parse(source).body
    assert isinstance(function, ast.FunctionDef)
    (first,) = function.body
    assert isinstance(first, ast.Assign)
    assert _copies_arrays(first, function) is copies


def test_every_module_says_what_it_is() -> None:
    """A docstring stands at the top of each module of packages and tests."""
    silent = [_place(path) for path in _everything() if not _says_something(_tree(path))]
    assert silent == []


def test_a_name_means_one_class() -> None:
    """No two modules have a public class of one name."""
    places: dict[str, list[str]] = {}
    for path in _sources(PACKAGES):
        for node in _tree(path).body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                places.setdefault(node.name, []).append(_place(path, node))
    doubled = {name: here for name, here in places.items() if len(here) > 1}
    assert doubled == {}


def test_every_public_function_and_class_says_what_it_does() -> None:
    """A docstring stands under each public function and class of the packages."""
    silent = [
        f"{_place(path, node)} {node.name}"
        for path in _sources(PACKAGES)
        for node in _tree(path).body
        if isinstance(node, Function | ast.ClassDef)
        if not node.name.startswith("_") and not ast.get_docstring(node)
        if not _is_overload(node)
        if node.name not in OF_ALEMBIC
    ]
    assert silent == []


def test_every_test_says_what_it_shows() -> None:
    """A sentence stands under each test."""
    silent = [
        f"{_place(path, function)} {function.name}"
        for path in _sources(("tests",))
        for function in _functions(path)
        if function.name.startswith("test_") and not ast.get_docstring(function)
    ]
    assert silent == []


def test_no_function_is_longer_than_a_screen() -> None:
    """Functions stay below 70 lines, what they say of themselves apart."""
    long = [
        f"{_place(path, function)} {function.name}: {_length(function)} lines"
        for path in _everything()
        for function in _functions(path)
        if _length(function) > LONGEST_FUNCTION
    ]
    assert long == []


def test_no_file_is_a_heap() -> None:
    """Files stay below 700 lines: one idea, whole, and nothing beside it."""
    lengths = {path: len(path.read_text("utf-8").splitlines()) for path in _everything()}
    long = [f"{_place(p)}: {n} lines" for p, n in lengths.items() if n > LONGEST_FILE]
    assert long == []


def test_no_files_import_each_other() -> None:
    """Imports run one way, those for types and those inside functions counted."""
    modules = {_module(path): path for path in _sources(PACKAGES)}
    imported = {
        module: {name for name in _imported(path) if name in modules and name != module}
        for module, path in modules.items()
    }
    try:
        TopologicalSorter(imported).prepare()
    except CycleError as error:
        pytest.fail(f"a circle of imports: {' <- '.join(error.args[1])}")


def test_nothing_is_left_unfinished() -> None:
    """No placeholder stands where code or a decision should."""
    marks = ("TO" + "DO", "FIX" + "ME", "NotImplemented" + "Error")
    unfinished = [
        f"{_place(path)} says {mark}"
        for path in _everything()
        for mark in marks
        if mark in path.read_text("utf-8")
    ]
    assert unfinished == []


@pytest.mark.parametrize("source", ["print(1)", "open('x')", "p.read_text()", "np.load('x')"])
def test_a_way_to_a_file_or_terminal_is_recognised(source: str) -> None:
    """The check above sees what it is there for."""
    call = ast.parse(source, mode="eval").body
    assert isinstance(call, ast.Call)
    assert _is_door(call.func)


def _compiles(decorator: ast.expr) -> bool:
    return ast.unparse(decorator).partition("(")[0] in ("compiled", "njit", "never_raises")


def _copies_arrays(line: ast.Assign, kernel: Function) -> bool:
    """Whether part of an array is set to what may be one as well."""
    arrays = {
        argument.arg
        for argument in kernel.args.args
        if argument.annotation is not None
        and ast.unparse(argument.annotation) not in ("int", "float")
    }
    pairs = [(target, line.value) for target in line.targets]
    if isinstance(pairs[0][0], ast.Tuple) and isinstance(line.value, ast.Tuple):
        pairs = list(zip(pairs[0][0].elts, line.value.elts, strict=True))
    return any(_is_part(to) and _may_be_array(value, arrays) for to, value in pairs)


def _is_part(node: ast.expr) -> bool:
    return isinstance(node, ast.Subscript) and any(
        isinstance(index, ast.Slice) for index in ast.walk(node.slice)
    )


def _may_be_array(value: ast.expr, arrays: set[str]) -> bool:
    """Of numbers and elements there is only a number; what a function returns may be an array."""
    if isinstance(value, ast.Subscript):
        return _is_part(value)
    if isinstance(value, ast.Name):
        return value.id in arrays
    if isinstance(value, ast.Call):
        return True
    return any(
        _may_be_array(part, arrays)
        for part in ast.iter_child_nodes(value)
        if isinstance(part, ast.expr)
    )


def _is_door(called: ast.expr) -> bool:
    if isinstance(called, ast.Name):
        return called.id in BUILT_IN_DOORS
    if not isinstance(called, ast.Attribute):
        return False
    of_numpy = isinstance(called.value, ast.Name) and called.value.id == "np"
    return called.attr in FILE_METHODS or (of_numpy and called.attr in NUMPY_FILES)


def _everything() -> list[Path]:
    return _sources((*PACKAGES, "tests"))


def _sources(folders: tuple[str, ...]) -> list[Path]:
    return sorted(path for folder in folders for path in (REPOSITORY / folder).rglob("*.py"))


def _module(path: Path) -> str:
    name = ".".join(path.relative_to(REPOSITORY).with_suffix("").parts)
    return f"stemwatch.{name}".removesuffix(".__init__")


def _imported(path: Path) -> Iterator[str]:
    """The modules that a file may mean: ``from a import b`` is a or a.b."""
    for node in ast.walk(_tree(path)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            inside = {f"{node.module}.{alias.name}" for alias in node.names}
            files = {name for name in inside if _is_file(name)}
            yield from files
            if files != inside:
                yield node.module


def _is_file(module: str) -> bool:
    place = REPOSITORY.joinpath(*module.removeprefix("stemwatch.").split("."))
    return place.with_suffix(".py").is_file() or (place / "__init__.py").is_file()


@pytest.fixture(scope="module", autouse=True)
def _trees_stay() -> Iterator[None]:
    """A thousand trees are kept; going through them again and again to find garbage took half of
    the time."""
    gc.disable()
    yield
    _tree.cache_clear()
    gc.enable()


@cache
def _tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text("utf-8"))


def _functions(path: Path) -> Iterator[Function]:
    return (node for node in ast.walk(_tree(path)) if isinstance(node, Function))


def _is_overload(node: ast.stmt) -> bool:
    """One of several signatures of a function; what they say stands under the function."""
    decorators = getattr(node, "decorator_list", [])
    return any(
        isinstance(decorator, ast.Name) and decorator.id == "overload" for decorator in decorators
    )


def _length(function: Function) -> int:
    lines = (function.end_lineno or function.lineno) - function.lineno + 1
    return lines - len((ast.get_docstring(function, clean=False) or "").splitlines())


def _says_something(tree: ast.Module) -> bool:
    return ast.get_docstring(tree) is not None


def _place(path: Path, node: ast.stmt | ast.expr | None = None) -> str:
    name = path.relative_to(REPOSITORY).as_posix()
    return name if node is None else f"{name}:{node.lineno}"
