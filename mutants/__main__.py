"""Try the tests on mutants of the kernels.

    python -m mutants mlscli.maps.patches mlscli.pipeline.stages.slope

The tests of a module are those that mirror it (`tests/maps/test_strips.py`) or, where it has none,
those that `mutants/tests.txt` names. Each mutant has a process of its own, in which the kernels
that it is part of are compiled anew. It is caught where a test fails, five times the usual time
for a test goes by, or 4 GiB do not suffice. Survivors are printed, but for those in
`mutants/equivalent.txt`,
with the reason why no test can tell them. The status is 1 where another one survives.
"""

from __future__ import annotations

import argparse
import os
import shlex
import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from functools import partial
from importlib import import_module
from pathlib import Path
from types import CodeType
from typing import Any

import numba

from mlscli.runtime import kernel_files
from mutants.mutation import mutants
from mutants.trying import Tests, collected

HERE = Path(__file__).parent
ROOT = HERE.parent


def listed(name: str) -> dict[str, str]:
    """Return what a file lists, line by line: a key, a bar, and what belongs to it."""
    rows = (HERE / name).read_text(encoding="utf-8").splitlines()
    pairs = (row.split(" | ", 1) for row in rows if row and not row.startswith("#"))
    return {key.strip(): value.strip() for key, value in pairs}


def tests_of(module: str) -> list[str]:
    """Return the words by which pytest finds the tests of a module."""
    *folders, name = module.split(".")[1:]
    mirror = "/".join(("tests", *folders, f"test_{name}.py"))
    return shlex.split(listed("tests.txt").get(module, mirror))


def modules_of_kernels() -> list[str]:
    """Return the modules that have mutants, all of the program."""
    paths = sorted((ROOT / "mlscli").rglob("*.py"))
    have = [path for path in paths if any(mutants(path.read_text(encoding="utf-8"), str(path)))]
    return [".".join(path.relative_to(ROOT).with_suffix("").parts) for path in have]


def _change(module: str, function: str, code: CodeType) -> None:
    changed: Any = getattr(import_module(module), function)
    getattr(changed, "py_func", changed).__code__ = code


def _try(module: str, most: int | None, counts: Counter[str], say: Callable[[str], None]) -> None:
    """Try the mutants of a module, count what came of them, and say which survive."""
    path = import_module(module).__file__
    assert path is not None
    every = list(mutants(Path(path).read_text(encoding="utf-8"), path))
    chosen = every[:: max(1, len(every) // (most or len(every)))]
    equivalent = listed("equivalent.txt")

    def use(tests: Tests) -> None:
        # The first run compiles what is missing.
        usual = [tests.run(spare=300.0) for _ in range(2)][1]
        if not usual.passed:
            counts["fail"] += 1
            say(f"{module}: fails without a change: {usual.failed}")
            return
        here = Counter[str]()
        for mutant in chosen:
            change = partial(_change, module, mutant.function, mutant.code)
            if not tests.run(change).passed:
                here["caught"] += 1
            elif f"{module}.{mutant.name}" in equivalent:
                here["equivalent"] += 1
            else:
                here["survive"] += 1
                say(f"  survives: {module}.{mutant.name}")
        counts.update(here)
        kinds = ", ".join(f"{here[kind]} {kind}" for kind in ("caught", "equivalent", "survive"))
        say(f"{module}: {len(chosen)} of {len(every)} mutants: {kinds}")

    if not collected(tests_of(module), use):
        counts["fail"] += 1
        say(f"{module}: its tests cannot be collected: {' '.join(tests_of(module))}")


def main() -> int:
    """Run the command line; return the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m mutants", description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("modules", nargs="*", help="whose kernels are changed; by default all")
    parser.add_argument("--most", type=int, help="try so many of each module, evenly spread")
    given = parser.parse_args()
    os.chdir(ROOT)
    counts = Counter[str]()

    def say(line: str) -> None:
        sys.stdout.write(f"{line}\n")
        sys.stdout.flush()

    with tempfile.TemporaryDirectory() as folder:
        # What mutants are compiled to is not kept with the program.
        kept = kernel_files.folder()
        for kernel in kept.glob("mlscli.*.kernel") if kept else ():
            Path(folder, kernel.name).symlink_to(kernel)
        numba.config.CACHE_DIR = folder  # type: ignore[attr-defined]
        for module in given.modules or modules_of_kernels():
            _try(module, given.most, counts, say)
    tried = sum(counts[kind] for kind in ("caught", "equivalent", "survive"))
    say(
        f"{tried} mutants: {counts['caught']} caught, {counts['equivalent']} equivalent, "
        f"{counts['survive']} survive"
    )
    return 1 if counts["survive"] or counts["fail"] else 0


if __name__ == "__main__":
    sys.exit(main())
