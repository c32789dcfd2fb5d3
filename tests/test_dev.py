"""`./dev` says what is missing, before it does anything."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


def dev(*arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [str(ROOT / "dev"), *arguments],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


def test_without_a_word_it_says_what_it_can_do() -> None:
    done = dev()
    assert done.returncode == 2
    assert "./dev demo" in done.stderr
    assert "./dev test" in done.stderr
    assert dev("help").returncode == 0


@pytest.mark.parametrize("python", ["false", "/no/such/python"])
def test_a_python_too_old_or_missing_is_named(tmp_path: Path, python: str) -> None:
    venv = tmp_path / "venv"
    done = dev("demo", PYTHON=python, MLS_VENV=str(venv))
    assert done.returncode == 1
    assert f"PYTHON={python} is not a Python of 3.11 or newer" in done.stderr
    assert not venv.exists()


def test_a_python_without_venv_is_told_what_to_install(tmp_path: Path) -> None:
    # It passes for a Python of the right age, and can import nothing.
    python = tmp_path / "python"
    python.write_text('#!/bin/sh\ncase "$2" in *version_info*) exit 0 ;; *) exit 1 ;; esac\n')
    python.chmod(0o755)
    done = dev("test", PYTHON=str(python), MLS_VENV=str(tmp_path / "venv"))
    assert done.returncode == 1
    assert "python3-venv" in done.stderr
