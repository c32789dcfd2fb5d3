"""The types of kernels' arguments as text, and back.

Numbers have numpy's names. ``float64[:, :]`` is an array, its rows one after the other in memory;
``readonly(float64[:])`` one that is not written to. Arrays of records name their dtype, named
tuples their class and its fields: ``mlscli.maps.order.OccupiedCells(ix=int32[:], iy=int32[:])``.
"""

from __future__ import annotations

import ast
import sys
from functools import cache
from importlib import import_module
from typing import Any

import numba
import numpy as np

# numba is typed in part.
_types: Any = numba.types
_from_dtype: Any = numba.from_dtype


def written(kind: Any) -> str:
    """Return the text of a type of numba's; of one that has none, what numba prints."""
    if isinstance(kind, _types.BaseNamedTuple):
        made = kind.instance_class
        fields = zip(kind.fields, kind.types, strict=True)
        inside = ", ".join(f"{field}={written(one)}" for field, one in fields)
        return f"{made.__module__}.{made.__qualname__}({inside})"
    if isinstance(kind, _types.BaseTuple):
        return f"({''.join(f'{written(one)}, ' for one in kind.types).strip()})"
    if isinstance(kind, _types.Array) and kind.layout == "C":
        item = _name_of(kind.dtype) if isinstance(kind.dtype, _types.Record) else str(kind.dtype)
        array = f"{item}[{', '.join(':' * kind.ndim)}]"
        return array if kind.mutable else f"readonly({array})"
    return str(kind) if isinstance(kind, _types.Number | _types.Boolean) else repr(kind)


def read(text: str) -> tuple[Any, tuple[Any, ...]]:
    """Return the kernel and the types that a line names: ``module.function(type, type, ...)``.

    Raises
    ------
    ValueError
        If there is no such kernel, or no such type.
    """
    call = ast.parse(text, mode="eval").body
    if not isinstance(call, ast.Call) or call.keywords:
        raise ValueError(f"no kernel and its types: {text}")
    return _named(call.func), tuple(map(_type, call.args))


def _type(node: ast.expr) -> Any:
    match node:
        case ast.Name("bool"):
            return _types.boolean
        case ast.Name(name) if isinstance(getattr(_types, name, None), _types.Type):
            return getattr(_types, name)
        case ast.Tuple(items):
            return _types.BaseTuple.from_types(tuple(map(_type, items)))
        case ast.Subscript(item, axes):
            is_number = isinstance(item, ast.Name)
            dtype = _type(item) if is_number else _from_dtype(_named(item))
            axes_count = len(axes.elts) if isinstance(axes, ast.Tuple) else 1
            # Fields of records lie anywhere.
            return _types.Array(dtype, axes_count, "C", aligned=is_number)
        case ast.Call(ast.Name("readonly"), [array], []):
            return _type(array).copy(readonly=True)
        case ast.Call(made, [], fields):
            found = _named(made)
            if [field.arg for field in fields] != list(found._fields):
                raise ValueError(f"the fields of {ast.unparse(made)} are {found._fields}")
            return _types.BaseTuple.from_types([_type(field.value) for field in fields], found)
    raise ValueError(f"no type: {ast.unparse(node)}")


def _named(node: ast.expr) -> Any:
    module, _, name = ast.unparse(node).rpartition(".")
    try:
        return getattr(import_module(module), name)
    except (ImportError, AttributeError, ValueError):
        raise ValueError(f"there is no {ast.unparse(node)}") from None


@cache
def _name_of(record: Any) -> str:
    """Return the name that a module gives to a dtype."""
    package = __name__.split(".")[0]
    for name, module in sorted(sys.modules.items()):
        for attribute, value in list(vars(module).items()) if name.startswith(package) else ():
            if isinstance(value, np.dtype) and value.fields and _is(value, record):
                return f"{name}.{attribute}"
    return repr(record)


def _is(dtype: np.dtype[np.void], record: Any) -> bool:
    """Return whether a dtype is a record of numba's, which does not know all dtypes."""
    try:
        return bool(_from_dtype(dtype) == record)
    except numba.errors.NumbaNotImplementedError:
        return False
