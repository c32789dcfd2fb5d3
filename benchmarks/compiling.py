"""How long all kernels take to compile: ``python -m benchmarks.compiling`` (a minute).

Commands that use every kernel run in a new folder, with an empty cache. It prints the sum of the
times from the beginning of each compilation to its end, and the kernels that no command used.

``python -m benchmarks.compiling --list > mlscli/runtime/kernels.txt`` lists the kernels that were
called, and the types of their arguments: those that are compiled ahead.
"""

from __future__ import annotations

import os
import pkgutil
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import redirect_stdout
from importlib import import_module
from io import StringIO
from pathlib import Path
from typing import NamedTuple

import click
import laspy
import numba
import numpy as np
from numba.core import event

from mlscli.runtime import kernel_files
from mlscli.runtime.kernel_types import written

ROOT = Path(__file__).resolve().parents[1]
BRIDGE = ROOT / "data/samples/bridge.txt"
SYNTH = "synth --type bridge-walls --grid 0.2 -o flight.txt"
EVERY = (
    "rays: {noise: 0.01}",
    "median",
    "orphans",
    "walls: {pieces: 9 cells}",
    "plaster: {sight: 6 cells}",
    "pyramids",
    "regions: {snap: true}",
)
COMMANDS = (
    *(SYNTH, f"{SYNTH} --holes 2,0.5 --overwrite", "synth --type stair --grid 0.5 -o stair.txt"),
    "build flight.txt --cumulative -c every.yaml --set map.cell_size=0.2",
    "synth --type planes --grid 0.2 --noise slam -o slam.mcap",
    "build slam.mcap -c every.yaml --set map.cell_size=0.2 --free-space -o free.npz",
    "build flight.txt -o sequential.npz --set mode=sequential --set map.cell_size=0.2",
    "build flight.txt -o growing.npz --growing",
    "build cloud.pcd -c plain --set map.cell_size=1",
    "build faces.ply -c plain --set map.cell_size=1",
    "build boxed.las -c plain --set map.cell_size=1",
    "build long.txt -c plain --set map.cell_size=1",
    "explore free.npz --craft 0.3,0.3",
    "compare flight.npz sequential.npz",
    "compare flight.npz --truth flight.truth.npz",
    "export flight.npz --format ply",
    "export flight.npz --format obj --style patches",
    f"build {BRIDGE} -c every.yaml -o bridge.npz",
    "export bridge.npz --format nav2 --slope 45",
    "compare flight.npz --cloud flight.txt --flight flight.txt --within 0.5",
    f"synth --cloud {BRIDGE} -o scan.txt --features 20",
)


class Compiled(NamedTuple):
    """How long kernels took to compile.

    Attributes
    ----------
    seconds : float
        Time of all compilations.
    kernels : int
        How many kernels the program has.
    unused : list of str
        Names of the kernels that no command used.
    called : list of str
        The kernels that were called, each with the types of its arguments.
    """

    seconds: float
    kernels: int
    unused: list[str]
    called: list[str]


def compiled(clock: Callable[[], float]) -> Compiled:
    """Run the commands in the current folder; the process must not have compiled anything yet."""
    import mlscli
    from mlscli.cli import Run, commands
    from mlscli.pipeline.stages import ordering, sights

    stopwatch = _Stopwatch(clock)
    event.register("numba:compile", stopwatch)  # type: ignore[no-untyped-call, unused-ignore]
    _write_clouds()
    Path("every.yaml").write_text("pipeline:\n" + "".join(f"- {stage}\n" for stage in EVERY))
    for command in COMMANDS:
        commands.main(command.split(), standalone_mode=False, obj=Run())
    _ask_for_space("free.npz")
    # What is for many points does for few.
    sights._FEW, ordering._IN_BAND = 0, 1024
    commands.main(
        f"build {BRIDGE} -o bridge.npz --overwrite".split(), standalone_mode=False, obj=Run()
    )
    modules = [
        import_module(module.name)
        for module in pkgutil.walk_packages(mlscli.__path__, "mlscli.")
        if not module.name.endswith("__main__")
    ]
    kernels = {
        f"{module.__name__}.{name}": value
        for module in modules
        for name, value in vars(module).items()
        if hasattr(value, "py_func") and value.__module__ == module.__name__
    }
    unused = [name for name, value in kernels.items() if not value.signatures]
    called = [
        f"{name}({', '.join(map(written, types))})"
        for name, value in kernels.items()
        for types in value.signatures
    ]
    return Compiled(stopwatch.seconds, len(kernels), unused, sorted(called))


class _Stopwatch(event.Listener):
    """Adds up the time of compilations; one within another counts once."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._depth, self._began = 0, 0.0
        self.seconds = 0.0

    def on_start(self, event: event.Event) -> None:  # noqa: ARG002
        if not self._depth:
            self._began = self._clock()
        self._depth += 1

    def on_end(self, event: event.Event) -> None:  # noqa: ARG002
        self._depth -= 1
        if not self._depth:
            self.seconds += self._clock() - self._began


def _write_clouds() -> None:
    """Write a compressed PCD, a PLY whose records have no fixed length, a LAS, and a long text."""
    points = struct.pack("<9f", *range(9))
    # Literal runs of up to 32 bytes, each after its length less one.
    runs = [points[begin : begin + 32] for begin in (0, 32)]
    packed = b"".join(bytes([len(run) - 1]) + run for run in runs)
    head = "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 3\nHEIGHT 1\n"
    head += "POINTS 3\nDATA binary_compressed\n"
    sizes = struct.pack("<2I", len(packed), len(points))
    Path("cloud.pcd").write_bytes(head.encode() + sizes + packed)
    head = "ply\nformat binary_little_endian 1.0\nelement vertex 3\n"
    head += "".join(f"property float {name}\n" for name in "xyz")
    head += "property list uchar uchar seen\nend_header\n"
    rows = (points[begin : begin + 12] + b"\1\7" for begin in (0, 12, 24))
    Path("faces.ply").write_bytes(head.encode() + b"".join(rows))
    boxed = laspy.create()
    boxed.x = boxed.y = boxed.z = np.arange(3.0)
    boxed.write("boxed.las")
    Path("long.txt").write_text("".join(f"{n % 9}.5 {n % 7} {n % 5}e-1\n" for n in range(100_000)))


def _ask_for_space(path: str) -> None:
    """Ask a map about places and a way, and put its free space together with itself."""
    from mlscli import clearance, read_map, space_at

    surface = read_map(path)
    assert surface.free is not None
    space_at(surface, np.zeros((1, 3)))
    clearance(surface, np.zeros((1, 3)), 0.2, 0.2)
    surface.free.union(surface.free)


@click.command()
@click.option("--cpu", is_flag=True, help="Measure CPU time, not wall time.")
@click.option("--list", "listed", is_flag=True, help="List the kernels that were called instead.")
def main(cpu: bool, listed: bool) -> None:
    """Print how long it took, how many kernels there are, and which were not used."""
    with tempfile.TemporaryDirectory() as folder, redirect_stdout(StringIO()):
        os.chdir(folder)
        if not listed:
            # What the package has compiled lies there.
            kernel_files.OWN = Path(folder, "kernels")
            numba.config.CACHE_DIR = folder  # type: ignore[attr-defined, unused-ignore]
        found = compiled(time.process_time if cpu else time.perf_counter)
    if not listed:
        click.echo(f"{found.seconds:.2f} {found.kernels} {' '.join(found.unused)}")
    elif found.seconds:
        # Kernels that others call were compiled with these; once these are kept, they are not.
        again = [sys.executable, "-m", "benchmarks.compiling", "--list"]
        sys.exit(subprocess.call(again, cwd=ROOT))
    else:
        click.echo("\n".join(found.called))


if __name__ == "__main__":
    main()
