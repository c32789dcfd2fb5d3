"""Mutants: each comparison and bound of a kernel, changed by itself, and nothing else.

How one could cheat: changes outside kernels; changes that add up; mutants that are never run.
"""

from __future__ import annotations

from pathlib import Path
from types import FunctionType

import pytest

from mutants import __main__ as program
from mutants.mutation import mutants

SOURCE = """
def kernel(function):
    return function


@kernel
def below(values, limit):
    found = 0
    for i in range(len(values) - 1):
        if values[i] < limit and i != 3:
            found += max(values[i], 1)
    return found, values[:2]


def above(value, limit):
    return value > limit
"""


def test_each_comparison_and_bound_is_changed_by_itself() -> None:
    changed = [(mutant.function, mutant.before, mutant.after) for mutant in mutants(SOURCE, "m.py")]
    loop, test = "for i in range(len(values) - 1)", "if values[i] < limit and i != 3"
    assert sorted(changed) == [
        ("below", loop, "for i in range(len(values) - 1 - 1)"),
        ("below", "found += max(values[i], 1)", "found += min(values[i], 1)"),
        ("below", test, "if values[i] < limit and i != 4"),
        ("below", test, "if values[i] < limit and i == 3"),
        ("below", test, "if values[i] <= limit and i != 3"),
        ("below", "return (found, values[:2])", "return (found, values[:3])"),
    ]


def test_a_mutant_does_what_it_says() -> None:
    found = {mutant.after: FunctionType(mutant.code, {}) for mutant in mutants(SOURCE, "m.py")}
    values = [1, 2, 3, 4, 5]
    assert found["if values[i] <= limit and i != 3"](values, 2) == (3, [1, 2])
    assert found["for i in range(len(values) - 1 - 1)"](values, 9) == (6, [1, 2])
    assert found["return (found, values[:3])"](values, 2) == (1, [1, 2, 3])


@pytest.mark.parametrize("name", ["tests.txt", "equivalent.txt"])
def test_what_the_lists_name_is_there(name: str) -> None:
    root = Path(program.HERE).parent
    for key, value in program.listed(name).items():
        if name == "tests.txt":
            assert (root / f"{key.replace('.', '/')}.py").is_file()
            paths = [word for word in value.split() if word.startswith("tests/")]
            assert paths
            assert all((root / path).is_file() for path in paths)
        else:
            dotted, _, change = key.partition(": ")
            module, _, function = dotted.rpartition(".")
            source = (root / f"{module.replace('.', '/')}.py").read_text()
            names = {f"{m.function}: {m.before} -> {m.after}" for m in mutants(source, "m.py")}
            assert f"{function}: {change}" in names, "of code that has changed"
