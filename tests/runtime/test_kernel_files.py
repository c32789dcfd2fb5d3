"""Files of kernels: current wherever they were copied to, and never taken for what they are not.

How one could cheat: to load whatever lies there, so files are cut, changed and swapped; to compile
in each run, so loading is told from compiling; to look at times of change, so those are changed.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from numba.core import event

import mlscli
from mlscli.runtime import kernel_files
from mlscli.runtime.kernels import kernel


def twice(x: float) -> float:
    return 2 * x


def thrice(x: float) -> float:
    return 3 * x


def told(x: float) -> tuple[float, float, int]:
    """Return what two kernels answer that were not called before, and how many were compiled."""
    with event.install_recorder("numba:compile") as compiled:
        return kernel(twice)(x), kernel(thrice)(x), len(compiled.buffer) // 2


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder that kernels are kept in."""
    monkeypatch.setattr(kernel_files._config, "CACHE_DIR", str(tmp_path))
    return tmp_path


def test_what_is_kept_is_loaded_from_a_copy_of_any_age(
    folder: Path, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert told(21) == (42, 63, 2)
    assert told(21) == (42, 63, 0)
    copy = tmp_path_factory.mktemp("copies") / "deeper"
    shutil.copytree(folder, copy, copy_function=shutil.copyfile)
    for file in copy.iterdir():
        os.utime(file, (0, 0))
    monkeypatch.setattr(kernel_files._config, "CACHE_DIR", str(copy))
    assert told(21) == (42, 63, 0)


def test_a_file_for_other_types_is_another_file(folder: Path) -> None:
    assert told(21) == (42, 63, 2)
    assert told(1.5) == (3.0, 4.5, 2)
    assert len(list(folder.iterdir())) == 4
    assert told(1.5) == (3.0, 4.5, 0)


def test_what_is_cut_short_changed_or_swapped_is_compiled_anew_and_replaced(folder: Path) -> None:
    told(21)
    one, other = sorted(folder.iterdir())
    whole = one.read_bytes()
    for broken in (whole[:-100], b"", whole[:-1] + b"x", other.read_bytes()):
        one.write_bytes(broken)
        assert told(21) == (42, 63, 1)
        assert told(21) == (42, 63, 0)


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("module", ["numba", "llvmlite", "np"])
def test_what_another_version_has_compiled_is_not_loaded(
    module: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    told(21)
    monkeypatch.setattr(getattr(kernel_files, module), "__version__", "0.1.2")
    monkeypatch.setattr(kernel_files, "environment", kernel_files.environment.__wrapped__)
    assert told(21) == (42, 63, 2)
    assert told(21) == (42, 63, 0)


TWICE = """
from tests.runtime.test_kernel_files import told
print(*told(21))
"""


def test_programs_that_compile_at_once_leave_whole_files(folder: Path) -> None:
    root = Path(mlscli.__file__).parents[1]
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(folder)}
    both = [
        subprocess.Popen(
            [sys.executable, "-c", TWICE],
            env=environment,
            cwd=root,
            stdout=subprocess.PIPE,
            text=True,
        )
        for _ in range(2)
    ]
    assert [run.communicate()[0].split()[:2] for run in both] == [["42", "63"]] * 2
    assert {file.suffix for file in folder.iterdir()} == {".kernel"}
    # And what one process has compiled, another loads.
    assert told(21) == (42, 63, 0)


def test_numba_does_without_scipys_linear_algebra_until_somebody_calls_it() -> None:
    script = """
import sys
from numba.np import linalg
from mlscli.maps.strips import strips_of
import numpy as np
strips_of(np.zeros(2, dtype=np.uint64))
from numba.np import arraymath
print(arraymath._HAVE_BLAS, "scipy.linalg" in sys.modules)
linalg.ensure_blas()
print("scipy.linalg" in sys.modules)
"""
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert run.stdout.split() == ["True", "False", "True"]


def test_a_program_that_can_write_nowhere_loads_what_came_with_it(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told(21)
    monkeypatch.setattr(kernel_files, "OWN", folder)
    monkeypatch.setattr(kernel_files._config, "CACHE_DIR", "/dev/null/nowhere")
    assert kernel_files.folder() is None
    # Kernels of other packages do not come with it.
    assert told(21) == (42, 63, 2)
    monkeypatch.setattr(kernel_files, "__name__", __name__)
    assert told(21) == (42, 63, 0)


def test_where_a_folder_is_full_or_gone_the_work_is_done_all_the_same(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kernel_files._config, "CACHE_DIR", str(folder / "gone"))
    assert kernel_files.folder() == folder / "gone"
    (folder / "gone").rmdir()
    assert told(21) == (42, 63, 2)


def test_the_packages_own_folder_is_looked_into_first_for_its_own_kernels_alone(
    folder: Path,
) -> None:
    assert list(kernel_files._folders(is_own=True)) == [kernel_files.OWN, folder]
    assert list(kernel_files._folders(is_own=False)) == [folder]
    assert kernel_files.folder() == folder
