"""What a kernel is compiled from is told by content: the same for copies, another for any change.

How one could cheat: to tell by names or by files' times; to overlook what stands two functions off,
constants, parts of modules, named tuples, or numbers that print alike; to know of each thing that
the kernels name today by chance alone, so the digest of every kernel is taken.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

import numpy as np
import pytest

import mlscli
from mlscli.runtime.kernel_sources import digest

TEXT = """
import enum, math, numpy as np
from typing import NamedTuple

class Pair(NamedTuple):
    one: int
    other: int

class Kind(enum.IntEnum):
    SEEN = 2

FACTOR = 3
TABLE = np.arange(5)
SIZES = (1, 2.5)
DTYPE = np.dtype([("x", "f8"), ("y", "i4")])
SMALL = np.int64(7)

def third(x):
    return x * FACTOR

def second(x):
    return third(x) + sum(y for y in SIZES)

def first(x, more=2):
    if x in {"a", "b", "c"}:
        return np.empty(more, dtype=DTYPE)
    return Pair(second(x), TABLE[0]), Kind.SEEN, math.floor(x), SMALL
"""


def defined(text: str) -> FunctionType:
    module = ModuleType("made_for_this")
    exec(compile(text, "anywhere.py", "exec"), vars(module))
    found = vars(module)["first"]
    assert isinstance(found, FunctionType)
    return found


def test_where_a_source_lies_and_what_says_nothing_to_the_compiler_is_no_part() -> None:
    moved = "\n\n# A comment.\n" + TEXT.replace("(x):", "(x):  # Another.")
    assert digest(defined(moved)) == digest(defined(TEXT))


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("x * FACTOR", "x / FACTOR"),
        ("FACTOR = 3", "FACTOR = 3.0"),
        ("FACTOR = 3", "FACTOR = True"),
        ("third(x) + sum", "third(x) - sum"),
        ("(1, 2.5)", "(1, 2.25)"),
        ("np.arange(5)", "np.arange(6)"),
        ("np.arange(5)", "np.arange(5, dtype=np.int32)"),
        ('("y", "i4")', '("y", "u4")'),
        ("np.int64(7)", "np.uint64(7)"),
        ("other: int", "another: int"),
        ("SEEN = 2", "SEEN = 3"),
        ("more=2", "more=3"),
        ('"b", "c"', '"b", "d"'),
        ("math.floor", "math.ceil"),
        ("y for y in", "-y for y in"),
    ],
)
def test_every_change_of_what_is_built_in_counts(old: str, new: str) -> None:
    assert TEXT.count(old) == 1
    assert digest(defined(TEXT.replace(old, new))) != digest(defined(TEXT))


def test_what_a_function_asks_of_the_packages_modules_counts() -> None:
    text = "def first(x):\n    return part.SIZE * x"
    found = [defined(text), defined(text)]
    for size, function in enumerate(found):
        part = ModuleType("made_for_this.part")
        vars(part)["SIZE"] = size
        function.__globals__["part"] = part
    assert digest(found[0]) != digest(found[1])


def test_the_digest_is_the_same_in_every_process() -> None:
    code = "from tests.runtime.test_kernel_sources import *; print(digest(defined(TEXT)))"
    root = Path(mlscli.__file__).parents[1]
    said = {
        subprocess.check_output(
            [sys.executable, "-c", code], cwd=root, env={**os.environ, "PYTHONHASHSEED": seed}
        ).decode()
        for seed in ("1", "2")
    }
    assert said == {digest(defined(TEXT)) + "\n"}


def test_a_thing_of_which_no_content_is_known_is_refused() -> None:
    function = defined(TEXT)
    function.__globals__["FACTOR"] = {"changes": "unseen"}
    with pytest.raises(TypeError, match="'FACTOR', a dict"):
        digest(function)


def kernels() -> Iterator[Any]:
    root = Path(mlscli.__file__).parent
    for path in root.rglob("*.py"):
        if "\n@kernel\n" in path.read_text(encoding="utf-8"):
            name = ".".join(path.relative_to(root.parent).with_suffix("").parts)
            module = import_module(name)
            yield from (one for one in vars(module).values() if hasattr(one, "py_func"))


def test_all_kernels_have_digests_of_their_own() -> None:
    every = {kernel.py_func for kernel in kernels()}
    assert len(every) > 50
    assert len({digest(function) for function in every}) == len(every)


def test_numbers_that_print_alike_are_told_apart() -> None:
    one, other = defined(TEXT), defined(TEXT)
    one.__globals__["FACTOR"], other.__globals__["FACTOR"] = np.float32(3), np.float64(3)
    assert digest(one) != digest(other)
