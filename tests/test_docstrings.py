"""What docstrings owe: the meaning of many parameters, and of the fields of tuples.

How one could cheat: to write a section that leaves some out, so all names are looked for, and no
others may be there; to hide a function behind an underscore, so kernels with many parameters are
held to it, too.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

import mlscli

ROOT = Path(mlscli.__file__).parent
MANY = 6


class Documented(NamedTuple):
    """A function or a class, what a section of its docstring must name, and what it names."""

    name: str
    owed: set[str]
    named: set[str]


def section(docstring: str, title: str) -> set[str]:
    """Return the names that a numpydoc section explains."""
    found = re.search(rf"^{title}\n-+\n(.*?)(?=^\w+\n-+\n|\Z)", docstring, re.MULTILINE | re.DOTALL)
    heads = re.findall(r"^(\*{0,2}\w[\w, *]*?)(?: : .*)?$", found[1], re.MULTILINE) if found else []
    return {name.strip(" *") for head in heads for name in head.split(",")}


def parameters(function: ast.FunctionDef) -> list[str]:
    given = function.args
    names = [each.arg for each in (*given.posonlyargs, *given.args, *given.kwonlyargs)]
    names += [each.arg for each in (given.vararg, given.kwarg) if each is not None]
    return [name for name in names if name not in ("self", "cls")]


def is_command(function: ast.FunctionDef) -> bool:
    """Tell whether the docstring is the help of a command, whose options explain themselves."""
    return any("click" in ast.dump(decorator) for decorator in function.decorator_list)


def functions() -> Iterator[Documented]:
    for path in sorted(ROOT.rglob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        makers = {
            method: owner
            for owner in ast.walk(tree)
            if isinstance(owner, ast.ClassDef)
            for method in owner.body
            if isinstance(method, ast.FunctionDef) and method.name == "__init__"
        }
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef) and not is_command(node):
                names = parameters(node)
                if len(names) >= MANY:
                    # What makes an instance is explained with its class.
                    docstring = ast.get_docstring(makers.get(node, node)) or ""
                    name = f"{path.relative_to(ROOT)}:{node.name}"
                    yield Documented(name, set(names), section(docstring, "Parameters"))


def tuples() -> Iterator[Documented]:
    for path in sorted(ROOT.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef) and "NamedTuple" in map(ast.unparse, node.bases):
                assigned = [each.target for each in node.body if isinstance(each, ast.AnnAssign)]
                fields = {ast.unparse(each) for each in assigned}
                if len(fields) > 1:
                    docstring = ast.get_docstring(node) or ""
                    name = f"{path.relative_to(ROOT)}:{node.name}"
                    yield Documented(name, fields, section(docstring, "Attributes"))


@pytest.mark.parametrize("found", [*functions()], ids=lambda found: found.name)
def test_many_parameters_are_explained_each(found: Documented) -> None:
    assert found.named == found.owed


@pytest.mark.parametrize("found", [*tuples()], ids=lambda found: found.name)
def test_the_fields_of_a_tuple_are_explained_each(found: Documented) -> None:
    assert found.named == found.owed
