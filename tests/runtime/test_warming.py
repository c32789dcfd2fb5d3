"""Kernels compiled ahead: all there are, by other processes, for any processor, telling no places.

How one could cheat: to list a few, so every kernel must be on the list, and what a build, an export
and a plot call; to compile here, or for this processor, so what is made is looked for by name; to
hide what cannot be compiled.
"""

from __future__ import annotations

import os
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest
from click.testing import CliRunner
from numba.core import event

import mlscli
from mlscli.cli import Run, commands
from mlscli.errors import OutputError
from mlscli.runtime import kernel_files, warming
from mlscli.runtime.kernel_types import read, written

ROOT = Path(mlscli.__file__).parents[1]
SAMPLE = ROOT / "data" / "samples" / "bridge.txt"
MODULE = """
from mlscli.runtime.kernels import inner, kernel

@inner
def checked(x):
    if x < 0:
        raise ValueError("below 0")
    return x

@kernel
def twice(x):
    return 2 * checked(x)

@kernel
def total(values):
    return values.sum()
"""
HOW = "list them: python -m benchmarks.compiling --list > mlscli/runtime/kernels.txt"
LINES = ["made_for_warming.twice(int64)", "made_for_warming.total(float64[:])"]


@pytest.fixture
def made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Make a module with two kernels, the list of them, and a folder to keep them in: return it."""
    (tmp_path / "made_for_warming.py").write_text(MODULE)
    (tmp_path / "kernels.txt").write_text("\n".join(LINES))
    monkeypatch.setattr(warming, "KERNELS", tmp_path / "kernels.txt")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.syspath_prepend(tmp_path)
    kept = tmp_path / "kept"
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(kept))
    monkeypatch.setattr(kernel_files._config, "CACHE_DIR", str(kept))
    return kept


def test_what_is_compiled_ahead_is_loaded_and_tells_no_places(made: Path) -> None:
    assert warming.warm_up(jobs=2) == (made, 2, 0, [])
    assert warming.warm_up(jobs=1) == (made, 0, 2, [])
    with event.install_recorder("numba:compile") as compiled:
        assert import_module("made_for_warming").twice(21) == 42
    assert not compiled.buffer
    for file in made.iterdir():
        for place in (str(made.parent), str(ROOT), sys.prefix):
            assert place.encode() not in file.read_bytes()
    # The name has the processor: for this one, there would be others.
    kernel, types = read(LINES[0])
    processor = kernel.targetctx.codegen().magic_tuple()
    named = kernel._cache.name(types, (processor[0], "generic", ""))
    assert (made / named).exists()


def test_what_cannot_be_compiled_is_told_and_the_rest_is_compiled(made: Path) -> None:
    with warming.KERNELS.open("a") as file:
        file.write("\nmade_for_warming.total(int64)\nmade_for_warming.thrice(int64)\n")
    seen: list[tuple[int, int]] = []
    warmed = warming.warm_up(1, lambda *done: seen.append(done))
    assert (warmed.folder, warmed.compiled) == (made, 2)
    assert [line.split(": ")[0] for line in warmed.failed] == [
        "made_for_warming.total(int64)",
        "made_for_warming.thrice(int64)",
    ]
    assert seen == [(1, 4), (2, 4), (3, 4), (4, 4)]


def test_without_a_folder_to_keep_them_in_nothing_is_compiled_ahead(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(kernel_files._config, "CACHE_DIR", "/dev/null/kernels")
    with pytest.raises(OutputError, match="NUMBA_CACHE_DIR"):
        warming.warm_up()


def test_every_kernel_is_on_the_list_and_every_line_is_in_order() -> None:
    lines = warming.KERNELS.read_text().splitlines()
    assert lines == sorted(set(lines))
    listed = set()
    for line in lines:
        kernel, types = read(line)
        name = f"{kernel.__module__}.{kernel.__qualname__}"
        assert f"{name}({', '.join(map(written, types))})" == line
        assert len(types) == kernel.py_func.__code__.co_argcount
        listed.add(kernel)
    every, called = set(), set()
    for path in (ROOT / "mlscli").rglob("*.py"):
        if "\n@kernel\n" in path.read_text():
            module = import_module(".".join(path.relative_to(ROOT).with_suffix("").parts))
            every |= {value for value in vars(module).values() if hasattr(value, "py_func")}
            # Kernels that others call alone are compiled with these.
            for value in vars(module).values():
                function = getattr(value, "py_func", value)
                called |= set(getattr(getattr(function, "__code__", None), "co_names", ()))
    assert not {kernel.__name__ for kernel in every - listed} - called, HOW


CALLED = """
import sys
from mlscli.cli import Run, commands
from mlscli.runtime.kernel_types import written

for command in sys.stdin:
    commands.main(command.split(), standalone_mode=False, obj=Run())
own = [module for name, module in sys.modules.items() if name.startswith("mlscli.")]
for module in own:
    for name, value in list(vars(module).items()):
        if hasattr(value, "py_func") and value.__module__ == module.__name__:
            for types in value.signatures:
                print("called", f"{module.__name__}.{name}({', '.join(map(written, types))})")
"""
COMMANDS = f"""build {SAMPLE} -o map.npz --overwrite
export map.npz --format ply --overwrite
plot map.npz -o map.png --overwrite
"""


def test_all_that_a_build_an_export_and_a_plot_call_is_on_the_list(tmp_path: Path) -> None:
    # Kernels that others call are compiled with these, but not loaded: a second run tells.
    for _ in range(2):
        run = subprocess.run(
            [sys.executable, "-c", CALLED],
            input=COMMANDS, capture_output=True, text=True, check=True, cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
        )  # fmt: skip
    called = {line.removeprefix("called ") for line in run.stdout.splitlines() if "called " in line}
    assert len(called) > 20
    assert called <= set(warming.KERNELS.read_text().splitlines()), HOW


def test_the_command_compiles_and_says_where(made: Path) -> None:
    for counts in ("2 kernels compiled, 0 were there", "0 kernels compiled, 2 were there"):
        done = CliRunner().invoke(commands, ["warmup", "--jobs", "1"], obj=Run())
        assert done.output == f"{made}: {counts}\n"
