"""Whether a wheel needs no compiler: ``python -m benchmarks.installed`` (some minutes).

A wheel is built of the tree, as pip builds it, and put into a new environment elsewhere, which
finds the rest in this one. There the sample is built, exported and plotted; no folder for kernels
can be written. It prints CPU seconds of the first time and of the median of later ones, and fails
if a kernel was compiled, if one names a folder of this machine, or if the first time took more than
1.5 times as long.
"""

from __future__ import annotations

import os
import resource
import statistics
import subprocess
import sys
import sysconfig
import tempfile
import venv
import zipfile
from pathlib import Path

import click

ROOT = Path(__file__).resolve().parents[1]
SAMPLE = ROOT / "data/samples/bridge.txt"
COMMANDS = (
    f"build {SAMPLE} -o map.npz --overwrite",
    "export map.npz --format ply --overwrite",
    "plot map.npz -o map.png --overwrite",
)
LATER, MOST = 5, 1.5


@click.command()
@click.option("--wheel", type=click.Path(path_type=Path), help="One that was built already.")
def main(wheel: Path | None) -> None:
    """Build, install, try, and print the times."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        python = installed(wheel.resolve() if wheel else built(folder), folder / "new")
        first, *later = [seconds(python, folder) for _ in range(1 + LATER)]
    warm = statistics.median(later)
    click.echo(f"first {first:.2f} s of CPU, later {warm:.2f} s: {first / warm:.2f} times")
    if first > MOST * warm:
        sys.exit(f"more than {MOST} times")


def built(folder: Path) -> Path:
    """Return a wheel of the tree."""
    pip = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "-w", str(folder)]
    subprocess.run([*pip, str(ROOT)], check=True)
    return next(folder.glob("*.whl"))


def installed(wheel: Path, place: Path) -> Path:
    """Put a wheel into a new environment, read-only; return its interpreter."""
    venv.create(place, symlinks=True)
    packages = Path(sysconfig.get_path("purelib", "venv", {"base": str(place)}))
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(packages)
    (packages / "rest.pth").write_text(sysconfig.get_path("purelib"))
    for kernel in packages.rglob("*.kernel"):
        content = kernel.read_bytes()
        for told in (str(ROOT), str(Path.home()), sys.base_prefix, tempfile.gettempdir()):
            if told.encode() in content:
                sys.exit(f"{kernel.name} names {told}")
    for path in packages.rglob("*"):
        path.chmod(path.stat().st_mode & ~0o222)
    return place / "bin/python"


def seconds(python: Path, folder: Path) -> float:
    """Return the CPU time of the commands; end where one of them compiled a kernel."""
    nowhere = {"NUMBA_CACHE_DIR": "/dev/null/nowhere", "MPLCONFIGDIR": str(folder)}
    environment = {**os.environ, **nowhere}
    environment.pop("PYTHONPATH", None)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    for command in COMMANDS:
        run = subprocess.run(
            [python, "-m", "mlscli", *command.split()],
            cwd=folder,
            env={
                **environment,
                "NUMBA_CACHE_DIR": "/dev/null/nowhere",
                "MPLCONFIGDIR": str(folder),
            },
            capture_output=True,
            text=True,
            check=True,
        )
        if "compiling" in run.stderr:
            sys.exit(f"mls {command}: {run.stderr}")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


if __name__ == "__main__":
    main()
