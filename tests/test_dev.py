"""`./dev` says what is missing, before it does anything."""

from __future__ import annotations

import os
import shutil
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


CALLS = """#!/bin/sh
echo "$(basename "$0") $*" >>"$CALLS"
"""


def ci(folder: Path, **programs: str) -> tuple[list[str], str]:
    """Run `.ci/run` where programs do as given; return what was called, and the errors."""
    (folder / ".ci").mkdir(parents=True)
    (folder / "bin").mkdir()
    (folder / ".ci/run").write_text((ROOT / ".ci/run").read_text())
    (folder / "os-release").write_text("ID=debian\n")
    given = {"id": "echo 0", "ldconfig": "true", "apt-get": "true"} | programs
    for name, does in given.items():
        (folder / "bin" / name).write_text(f"{CALLS}{does}\n")
    (folder / "dev").write_text(CALLS)
    for tool in ("sh", "grep", "dirname", "basename", "timeout"):
        found = shutil.which(tool)
        assert found is not None
        (folder / "bin" / tool).symlink_to(found)
    for file in (folder / "dev", *(folder / "bin" / name for name in given)):
        file.chmod(0o755)
    environment = {"PATH": str(folder / "bin"), "CALLS": str(folder / "calls")}
    environment["OS_RELEASE"] = str(folder / "os-release")
    done = subprocess.run(
        ["/bin/sh", str(folder / ".ci/run")],
        env=environment,
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    calls = (folder / "calls").read_text().splitlines()
    assert calls[-3:] == ["dev setup", "dev test", "dev demo"]
    return [call for call in calls if call.startswith("apt-get")], done.stderr


def test_a_fresh_machine_gets_the_browser_and_the_libraries(tmp_path: Path) -> None:
    calls, said = ci(tmp_path)
    assert [call.split()[1] for call in calls] == ["update", "install", "install"]
    assert " libusb-1.0-0 " in calls[1]
    assert calls[2].endswith(" chromium")
    assert said == ""


def test_a_machine_that_cannot_install_is_told_and_checked_all_the_same(tmp_path: Path) -> None:
    calls, said = ci(tmp_path / "offline", **{"apt-get": "exit 100"})
    assert len(calls) == 3
    assert "Chromium cannot be installed; the tests that need it are skipped" in said
    assert ci(tmp_path / "user", id="echo 1000") == ([], "")


def test_what_is_there_is_not_installed_again(tmp_path: Path) -> None:
    there = "echo libGL.so.1 libEGL.so.1 libX11.so.6 libusb-1.0.so.0 libgomp.so.1"
    assert ci(tmp_path / "all", ldconfig=there, chromium="true") == ([], "")
    calls, _ = ci(tmp_path / "no browser", ldconfig=there)
    assert [call.split()[-1] for call in calls] == ["-qq", "chromium"]
