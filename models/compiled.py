"""``compiled``: a numba kernel that is kept on disk for as long as nothing that it calls changes.

numba compiles a function together with all that it calls and with the constants that it uses, and
keeps that until the function's own file changes. Where the others stand in other files, it goes on
running their earlier versions: after an upgrade numbers would be wrong without a word (numba's
documentation has this under the limitations of its cache). Here a kernel's entry names all of them.

numba also writes that an entry is there before the entry itself, under a number that another
process may take at the same moment: a program that was killed in between left an older version's
code, or another signature's, under the new name for good. Here the entry is written first, and
named by what it is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache, cached_property
from hashlib import sha256
from types import CodeType, FunctionType, ModuleType
from typing import Any, TypeVar, cast

import numpy as np
from numba import njit
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.core.dispatcher import Dispatcher

Function = TypeVar("Function", bound=Callable[..., Any])
_PLAIN = (bool, int, float, complex, str, bytes, type(None))


def compiled(**options: Any) -> Callable[[Function], Function]:
    """``numba.njit(**options)``, with a cache on disk that knows all that the kernel calls."""

    def compile_when_called(function: Function) -> Function:
        kernel: Any = njit(**options)(function)
        if kernel is not function:  # as it is where numba is switched off
            kernel._cache = _KernelCache(function)
        return cast(Function, kernel)

    return compile_when_called


class _KernelCache(FunctionCache):
    """The entries of one kernel, one for each signature and kind of processor."""

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)  # type: ignore[no-untyped-call]
        self._cache_file = _Entries(self, function)


class _Entries(IndexDataCacheFile):
    """The files of a kernel's entries, and the index of what is in which."""

    def __init__(self, cache: FunctionCache, function: Callable[..., Any]) -> None:
        self._function = cast(FunctionType, function)
        self._own_file = cache._impl.locator.get_source_stamp()
        self._name = cache._impl.filename_base
        super().__init__(cache.cache_path, self._name, None)  # type: ignore[no-untyped-call]
        del self._source_stamp  # set by numba when a function is defined, too early for us

    @cached_property
    def _source_stamp(self) -> str:
        """Of the kernel's file and of all that it calls, which are all there when it is called."""
        return sha256(repr((self._own_file, sorted(_reached(self._function)))).encode()).hexdigest()

    def save(self, key: object, data: object) -> None:
        """Keep ``data`` under ``key``: a process that ends half way leaves what there was."""
        name = sha256(repr((self._source_stamp, key)).encode()).hexdigest()[:16]
        file = f"{self._name}.{name}.nbc"
        files: Any = self  # numba has no types
        files._save_data(file, data)
        files._save_index({**files._load_index(), key: file})


def _reached(function: FunctionType) -> set[str]:
    """A line for each kernel that ``function`` calls, itself or by others, with its code, and for
    each constant that they use."""
    lines: set[str] = set()
    to_do, seen = [function], {function}
    while to_do:
        own_lines, called = _own(to_do.pop())
        lines |= own_lines
        to_do += called - seen
        seen |= called
    return lines


@cache
def _own(function: FunctionType) -> tuple[frozenset[str], frozenset[FunctionType]]:
    """The lines of ``function`` itself, and the kernels that it calls."""
    place = f"{function.__module__}.{function.__qualname__}"
    lines = {f"{place}: {text}" for text in _text_of(function.__code__)}
    called = set[FunctionType]()
    for name, value in (*_used(function, function.__code__), *_from_around(function)):
        if isinstance(value, Dispatcher):
            called.add(value.py_func)
        elif (text := _constant(value)) is not None:
            lines.add(f"{place}: {name} = {text}")
    return frozenset(lines), frozenset(called)


def _used(function: FunctionType, code: CodeType) -> Iterator[tuple[str, object]]:
    """The globals of ``function`` that ``code`` in it names, and what it names of theirs."""
    for name in code.co_names:
        value = function.__globals__.get(name)
        yield name, value
        if isinstance(value, (ModuleType, type)):
            yield from ((f"{name}.{more}", getattr(value, more, None)) for more in code.co_names)
    for inner in code.co_consts:
        if isinstance(inner, CodeType):
            yield from _used(function, inner)


def _from_around(function: FunctionType) -> Iterator[tuple[str, object]]:
    """What ``function`` has from a function around it."""
    for name, cell in zip(function.__code__.co_freevars, function.__closure__ or (), strict=True):
        yield name, cell.cell_contents


def _text_of(code: CodeType) -> Iterator[str]:
    """What a function does, whatever file and line it stands in."""
    plain = [constant for constant in code.co_consts if not isinstance(constant, CodeType)]
    yield repr((code.co_code.hex(), code.co_names, code.co_varnames, plain))
    for inner in code.co_consts:
        if isinstance(inner, CodeType):
            yield from _text_of(inner)


def _constant(value: object) -> str | None:
    """A constant as text; ``None`` for what numba does not compile in as such."""
    if isinstance(value, np.ndarray):
        return f"{value.dtype} {value.shape} {sha256(value.tobytes()).hexdigest()}"
    if isinstance(value, tuple):
        return repr([_constant(part) for part in value])
    return repr(value) if isinstance(value, (*_PLAIN, np.generic)) else None
