"""What is said while kernels are compiled, and that they are compiled once.

How one could cheat: to say it whether anything is compiled or not, so a second run must not; to
keep nothing and say nothing, so the folder is looked into; to say it among the results; to load
what was compiled from an older source, so what is built in is changed, in one module and two off.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest

import mlscli
from tests.helpers.maps import Patch, map_of

# What was compiled when the package was installed is for another level.
UNLIKE = {"NUMBA_OPT": "2"}
Compare = Callable[[Mapping[str, str]], str]


@pytest.fixture
def compared(tmp_path: Path) -> Compare:
    """Return what `mls compare` says on standard error; its kernels compile soonest."""
    path = tmp_path / "map.npz"
    mlscli.write_map(path, map_of([Patch(0, 0, 0.0, 0.0, 0, 1)]))

    def compare(environment: Mapping[str, str]) -> str:
        command = [sys.executable, "-m", "mlscli", "compare", str(path), str(path), "--json"]
        run = subprocess.run(
            command,
            capture_output=True,
            text=True,
            env={**os.environ, **UNLIKE, **environment},
            check=True,
        )
        assert isinstance(json.loads(run.stdout), dict)
        return run.stderr

    return compare


def test_compiling_is_told_once_and_what_is_compiled_is_loaded(
    compared: Compare, tmp_path: Path
) -> None:
    kept = {"NUMBA_CACHE_DIR": str(tmp_path / "kernels")}
    said = compared(kept)
    assert said.startswith("mls: compiling kernels of this command, once (about ")
    assert said.count("\n") == 1
    assert list(Path(kept["NUMBA_CACHE_DIR"]).rglob("*.kernel"))
    assert compared(kept) == ""


def test_where_no_folder_can_be_written_every_run_says_what_would_help(compared: Compare) -> None:
    # Not even the administrator makes folders there.
    nowhere = {"NUMBA_CACHE_DIR": "/dev/null/kernels"}
    for _ in range(2):
        said = compared(nowhere)
        assert said.startswith("mls: compiling kernels (about ")
        assert "NUMBA_CACHE_DIR" in said
        assert said.count("\n") == 1


CHANGED_NUMBA = """
from numba.core.compiler import CompileResult

del CompileResult._reduce
from mlscli.cli import main
main()
"""


def test_a_numba_that_keeps_kernels_in_another_way_is_told_of_and_nothing_is_kept(
    tmp_path: Path,
) -> None:
    path = tmp_path / "map.npz"
    mlscli.write_map(path, map_of([Patch(0, 0, 0.0, 0.0, 0, 1)]))
    kept = tmp_path / "kernels"
    for _ in range(2):
        run = subprocess.run(
            [sys.executable, "-c", CHANGED_NUMBA, "compare", str(path), str(path), "--json"],
            capture_output=True,
            text=True,
            env={**os.environ, "NUMBA_CACHE_DIR": str(kept)},
            check=True,
        )
        assert "in every run, for numba " in run.stderr
        assert "report this" in run.stderr
        assert run.stderr.count("\n") == 1
        assert not list(kept.rglob("*.kernel"))


def test_an_interrupt_while_kernels_are_compiled_ends_the_program(tmp_path: Path) -> None:
    mlscli.write_map(tmp_path / "map.npz", map_of([Patch(0, 0, 0.0, 0.0, 0, 1)]))
    with subprocess.Popen(
        [sys.executable, "-m", "mlscli", "compare", "map.npz", "map.npz"],
        stderr=subprocess.PIPE,
        text=True,
        cwd=tmp_path,
        env={**os.environ, **UNLIKE, "NUMBA_CACHE_DIR": str(tmp_path / "kernels")},
    ) as process:
        assert process.stderr is not None
        assert process.stderr.readline().startswith("mls: compiling kernels")
        process.send_signal(signal.SIGTERM)
        _, errors = process.communicate(timeout=60)
    assert (process.returncode, errors) == (143, "mls: interrupted\n")


SOURCES = {
    "third.py": "NUMBER = 1\n",
    "second.py": """
from mlscli.runtime.kernels import inner
from mlscli.third import NUMBER
@inner
def more(x):
    return x + NUMBER
""",
    "first.py": """
from mlscli.runtime.kernels import kernel
from mlscli.second import more
@kernel
def much(x):
    return more(x)
""",
}


def test_a_kernel_is_compiled_anew_when_what_is_built_into_it_has_changed(tmp_path: Path) -> None:
    folder = tmp_path / "mlscli"
    shutil.copytree(Path(mlscli.__file__).parent, folder, ignore=shutil.ignore_patterns("*.kernel"))
    for name, text in SOURCES.items():
        (folder / name).write_text(text)

    def answer() -> int:
        command = [sys.executable, "-c", "from mlscli.first import much; print(much(5))"]
        # Python tells by whole seconds and sizes whether its own code is up to date.
        told = {"PYTHONPATH": str(tmp_path), "PYTHONDONTWRITEBYTECODE": "1"}
        environment = {**os.environ, **told}
        return int(subprocess.check_output(command, env=environment, cwd=tmp_path))

    assert answer() == 5 + 1
    (folder / "third.py").write_text(SOURCES["third.py"].replace("= 1", "= 2"))
    assert answer() == 5 + 2
    (folder / "second.py").write_text(SOURCES["second.py"].replace("x +", "3 * x +"))
    assert answer() == 3 * 5 + 2
    (folder / "first.py").write_text(SOURCES["first.py"].replace("(x)\n", "(4 * x)\n"))
    assert answer() == 3 * 4 * 5 + 2


def test_kernels_run_as_python_where_nothing_is_to_be_compiled() -> None:
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    subprocess.run(
        [sys.executable, "-c", "import mlscli.maps.merging"], env=environment, check=True
    )
