"""The mutants of a module's kernels: one comparison or bound changed in each.

- ``<`` and ``<=`` become each other, so do ``>`` and ``>=``, ``==`` and ``!=``, `min` and `max`;
- a number that is compared with, or bounds a slice or a range, grows by 1;
- the end of a range is 1 less.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from types import CodeType

_OTHER: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
}
_EXTREME = {"min": "max", "max": "min"}
_KERNELS = {"kernel", "inner"}


@dataclass(frozen=True)
class Mutant:
    """A kernel in which one thing is another.

    Attributes
    ----------
    function : str
        The kernel.
    before, after : str
        The line of code that differs, so and so.
    code : CodeType
        What the kernel would then be.
    """

    function: str
    before: str
    after: str
    code: CodeType

    @property
    def name(self) -> str:
        """What tells it from others, also where lines above it have changed."""
        return f"{self.function}: {self.before} -> {self.after}"


def mutants(source: str, path: str) -> Iterator[Mutant]:
    """Yield the mutants of all kernels of a module."""
    tree = ast.parse(source)
    for function in tree.body:
        if not isinstance(function, ast.FunctionDef) or not _is_kernel(function):
            continue
        for place in ast.walk(function):
            for change, undo in _changes(place):
                before = _line(function, place)
                change()
                after = _line(function, place)
                yield Mutant(function.name, before, after, _compiled(tree, function.name, path))
                undo()


def _is_kernel(function: ast.FunctionDef) -> bool:
    return any(isinstance(d, ast.Name) and d.id in _KERNELS for d in function.decorator_list)


def _changes(place: ast.AST) -> Iterator[tuple[_Act, _Act]]:
    """Yield what changes a place, and what undoes it."""
    if isinstance(place, ast.Compare):
        for number, op in enumerate(place.ops):
            if type(op) in _OTHER:
                yield _set(place.ops, number, _OTHER[type(op)](), op)
        yield from _grown(place.comparators)
    elif isinstance(place, ast.Call) and isinstance(place.func, ast.Name):
        if place.func.id in _EXTREME:
            yield _named(place.func, _EXTREME[place.func.id])
        elif place.func.id == "range":
            yield from _grown(place.args)
            end = min(1, len(place.args) - 1)
            less = ast.BinOp(place.args[end], ast.Sub(), ast.Constant(1))
            yield _set(place.args, end, less, place.args[end])
    elif isinstance(place, ast.Slice):
        bounds = [bound for bound in (place.lower, place.upper) if bound is not None]
        yield from _grown(bounds)


class _Act:
    """A call that can be made later."""

    def __init__(self, target: object, name: str | int, value: object) -> None:
        self._target, self._name, self._value = target, name, value

    def __call__(self) -> None:
        if isinstance(self._name, int):
            assert isinstance(self._target, list)
            self._target[self._name] = self._value
        else:
            setattr(self._target, self._name, self._value)


def _set(
    items: list[ast.cmpop] | list[ast.expr], number: int, new: object, old: object
) -> tuple[_Act, _Act]:
    return _Act(items, number, new), _Act(items, number, old)


def _named(name: ast.Name, new: str) -> tuple[_Act, _Act]:
    return _Act(name, "id", new), _Act(name, "id", name.id)


def _grown(numbers: list[ast.expr]) -> Iterator[tuple[_Act, _Act]]:
    for number in numbers:
        if not isinstance(number, ast.Constant) or isinstance(number.value, bool):
            continue
        if isinstance(number.value, int | float):
            yield _Act(number, "value", number.value + 1), _Act(number, "value", number.value)


def _line(function: ast.FunctionDef, place: ast.AST) -> str:
    """Return the statement that holds a place, as one line, without what stands below it."""
    holds = [
        node
        for node in ast.walk(function)
        if isinstance(node, ast.stmt | ast.comprehension) and place in ast.walk(node)
    ]
    statement = holds[-1]
    if isinstance(statement, ast.If | ast.While):
        return f"{type(statement).__name__.lower()} {ast.unparse(statement.test)}"
    if isinstance(statement, ast.For):
        return f"for {ast.unparse(statement.target)} in {ast.unparse(statement.iter)}"
    return " ".join(ast.unparse(statement).split())


def _compiled(tree: ast.Module, name: str, path: str) -> CodeType:
    """Return the code of a function of a module."""
    module = compile(ast.fix_missing_locations(tree), path, "exec")
    found = [c for c in module.co_consts if isinstance(c, CodeType) and c.co_name == name]
    return found[-1]
