"""What is said while kernels are compiled, and that they are compiled once.

How one could cheat: to say it whether anything is compiled or not, so a second run must not; to
keep nothing and say nothing, so the folder is looked into; to say it among the results.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest

import mlscli
from tests.maps import Patch, map_of

Compare = Callable[[Mapping[str, str]], str]


@pytest.fixture
def compared(tmp_path: Path) -> Compare:
    """Return what `mls compare` says on standard error; its kernels compile soonest."""
    path = tmp_path / "map.npz"
    mlscli.write_map(path, map_of([Patch(0, 0, 0.0, 0.0, 0, 1)]))

    def compare(environment: Mapping[str, str]) -> str:
        command = [sys.executable, "-m", "mlscli", "compare", str(path), str(path), "--json"]
        run = subprocess.run(
            command, capture_output=True, text=True, env={**os.environ, **environment}, check=True
        )
        assert isinstance(json.loads(run.stdout), dict)
        return run.stderr

    return compare


def test_compiling_is_told_once_and_what_is_compiled_is_loaded(
    compared: Compare, tmp_path: Path
) -> None:
    kept = {"NUMBA_CACHE_DIR": str(tmp_path / "kernels")}
    said = compared(kept)
    assert said.startswith("mls: compiling kernels, once (about ")
    assert said.count("\n") == 1
    assert list(Path(kept["NUMBA_CACHE_DIR"]).rglob("*.nbc"))
    assert compared(kept) == ""


def test_where_no_folder_can_be_written_every_run_says_what_would_help(compared: Compare) -> None:
    # Of the places that numba knows, the one that nobody has named.
    nowhere = {"NUMBA_CACHE_LOCATOR_CLASSES": "UserProvidedCacheLocator"}
    for _ in range(2):
        said = compared(nowhere)
        assert said.startswith("mls: compiling kernels (about ")
        assert "NUMBA_CACHE_DIR" in said
        assert said.count("\n") == 1
