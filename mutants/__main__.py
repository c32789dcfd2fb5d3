"""Try the tests on mutants of the kernels.

    python -m mutants mlscli.maps.patches mlscli.pipeline.stages.slope

The tests of a module are those that mirror it (`tests/maps/test_strips.py`) or, where it has none,
those that `mutants/tests.txt` names. Each mutant has a process of its own, in which the kernels
that it is part of are compiled anew. It is caught where a test fails, five times the usual time
goes by, or 4 GiB do not suffice. Survivors are printed, but for those in
`mutants/equivalent.txt`,
with the reason why no test can tell them. The status is 1 where another one survives.
"""

from __future__ import annotations

import argparse
import os
import resource
import sys
import tempfile
import time
from importlib import import_module
from pathlib import Path
from typing import Any

import numba
import pytest

from mutants.mutation import Mutant, mutants

HERE = Path(__file__).parent
ROOT = HERE.parent
_MEMORY = 4 * 2**30
_OPTIONS = ("-q", "-x", "-p", "no:cacheprovider", "-p", "no:xdist")


def listed(name: str) -> dict[str, str]:
    """Return what a file lists, line by line: a key, a bar, and what belongs to it."""
    rows = (HERE / name).read_text(encoding="utf-8").splitlines()
    pairs = (row.split(" | ", 1) for row in rows if row and not row.startswith("#"))
    return {key.strip(): value.strip() for key, value in pairs}


def tests_of(module: str) -> list[str]:
    """Return the tests of a module."""
    *folders, name = module.split(".")[1:]
    mirror = "/".join(("tests", *folders, f"test_{name}.py"))
    return listed("tests.txt").get(module, mirror).split()


def tried(tests: list[str], seconds: int, module: str, mutant: Mutant | None = None) -> bool:
    """Run tests in a process of their own; return whether all pass."""
    child = os.fork()
    if child:
        _, status = os.waitpid(child, 0)
        return status == 0
    status = 70
    try:
        nothing = os.open(os.devnull, os.O_WRONLY)
        for number in (1, 2):
            os.dup2(nothing, number)
        resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))
        resource.setrlimit(resource.RLIMIT_AS, (_MEMORY, _MEMORY))
        if mutant is not None:
            changed: Any = getattr(import_module(module), mutant.function)
            getattr(changed, "py_func", changed).__code__ = mutant.code
        status = int(pytest.main([*_OPTIONS, *tests]))
    finally:
        os._exit(status)


def main() -> int:
    """Run the command line; return the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m mutants", description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("modules", nargs="+", help="whose kernels are changed")
    parser.add_argument("--most", type=int, help="try so many of each module, evenly spread")
    given = parser.parse_args()
    os.chdir(ROOT)
    equivalent = listed("equivalent.txt")
    total = caught = known = 0
    with tempfile.TemporaryDirectory() as folder:
        # What mutants are compiled to is not kept with the program.
        numba.config.CACHE_DIR = folder  # type: ignore[attr-defined]
        for module in given.modules:
            path = import_module(module).__file__
            assert path is not None
            tests = tests_of(module)
            # The first run compiles what is missing.
            begin = time.monotonic()
            if not all(tried(tests, 600, module) for _ in range(2)):
                parser.error(f"{module}: its tests fail without a change: {' '.join(tests)}")
            seconds = (time.monotonic() - begin) / 2
            every = list(mutants(Path(path).read_text(encoding="utf-8"), path))
            chosen = every[:: max(1, len(every) // (given.most or len(every)))]
            sys.stdout.write(f"{module}: {len(chosen)} of {len(every)} mutants, {seconds:.0f} s\n")
            for mutant in chosen:
                total += 1
                if not tried(tests, 30 + int(5 * seconds), module, mutant):
                    caught += 1
                elif f"{module}.{mutant.name}" in equivalent:
                    known += 1
                else:
                    sys.stdout.write(f"  survives: {module}.{mutant.name}\n")
                sys.stdout.flush()
    left = total - caught - known
    sys.stdout.write(f"{total} mutants: {caught} caught, {known} equivalent, {left} survive\n")
    return 1 if left else 0


if __name__ == "__main__":
    sys.exit(main())
