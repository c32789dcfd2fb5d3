"""What a kernel is compiled from: its own code, and all of the package that is built into it.

Functions and constants of other modules are compiled into a kernel, too. What counts is content,
not files and their times: a copy of the program is the same program.
"""

from __future__ import annotations

import enum
import hashlib
import sys
from collections.abc import Iterator
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numba
import numpy as np

# Their versions stand for what they are; the rest of what a kernel names is looked into.
_FOREIGN = {"numpy", "numba", "llvmlite", *sys.stdlib_module_names, *sys.builtin_module_names}


def digest(function: FunctionType) -> str:
    """Return a digest (hexadecimal) of a function and of all that it names, and these name.

    Raises
    ------
    TypeError
        If it names a thing whose content cannot be told.
    """
    return hashlib.sha256("\n".join(_parts(function, set())).encode()).hexdigest()


def _parts(function: FunctionType, known: set[int]) -> Iterator[str]:
    """Yield texts that say what a function is compiled from; a function that is known, by name."""
    yield f"{function.__module__}.{function.__qualname__}"
    if id(function) in known:
        return
    known.add(id(function))
    yield f"{_code(function.__code__)} {function.__defaults__!r} {function.__kwdefaults__!r}"
    names = sorted(_names(function.__code__))
    # What a module is asked for is among the names, too.
    spaces = [function.__globals__]
    for space in spaces:
        modules = [space[name] for name in names if isinstance(space.get(name), ModuleType)]
        own = [vars(one) for one in modules if not _is_foreign(one.__name__)]
        spaces.extend(one for one in own if not any(one is space for space in spaces))
    for name in names:
        for space in spaces:
            if name in space:
                yield f"{name}:"
                yield from _content(name, space[name], known)
    for name, cell in zip(function.__code__.co_freevars, function.__closure__ or (), strict=True):
        yield f"{name}:"
        yield from _content(name, cell.cell_contents, known)


def _content(name: str, value: Any, known: set[int]) -> Iterator[str]:
    function = getattr(value, "py_func", value)
    if isinstance(value, ModuleType):
        yield value.__name__
    elif isinstance(value, np.ndarray):
        yield f"{value.dtype} {value.shape} {hashlib.sha256(value.tobytes()).hexdigest()}"
    elif isinstance(value, tuple):
        for item in value:
            yield from _content(name, item, known)
    elif value is None or isinstance(value, _CONSTANT):
        yield f"{type(value).__name__} {value!r}"
    elif _is_foreign(getattr(value, "__module__", None) or ""):
        yield f"{value.__module__}.{value.__qualname__}"
    elif isinstance(function, FunctionType):
        yield from _parts(function, known)
    elif isinstance(value, type):
        yield f"{value.__module__}.{value.__qualname__} {getattr(value, '_fields', ())}"
        if issubclass(value, enum.Enum):
            yield repr([(member.name, member.value) for member in value])
    else:
        raise TypeError(f"a kernel cannot name {name!r}, a {type(value).__name__}")


_CONSTANT = bool | int | float | str | bytes | np.generic | np.dtype | np.ufunc | numba.types.Type


def _is_foreign(module: str) -> bool:
    return module.split(".")[0] in _FOREIGN


def _names(code: CodeType) -> set[str]:
    inside = [_names(constant) for constant in code.co_consts if isinstance(constant, CodeType)]
    return set(code.co_names).union(*inside)


def _code(code: CodeType) -> str:
    """Return what a function does as a text; where its source lies is no part of it."""
    constants = [
        _code(one) if isinstance(one, CodeType) else _constant(one) for one in code.co_consts
    ]
    names = (code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars)
    counts = (code.co_argcount, code.co_kwonlyargcount, code.co_posonlyargcount, code.co_flags)
    return f"{code.co_code.hex()} {code.co_exceptiontable.hex()} {constants} {names} {counts}"


def _constant(value: Any) -> str:
    # The order of a set of texts differs from run to run.
    return f"{sorted(map(repr, value))}" if isinstance(value, frozenset) else repr(value)
