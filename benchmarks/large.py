"""A cloud larger than memory: ``python -m benchmarks.large --memory 2G``.

A survey flight over a hilly plain is written as a ROS 1 bag, lane by lane; its map is built with
``--memory``. It prints the time and the greatest resident size of the process.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import click
import numpy as np
from numpy.lib.recfunctions import unstructured_to_structured

from benchmarks.process import ran
from mlscli.io.writing.bag_messages import CLOUD_TYPE, BagWriter

CELL, POINTS_PER_CELL, MESSAGE, LANES = 0.1, 10, 200_000, 20
# A neighbourhood with the usual number of points, although cells hold many.
SETTINGS = {"default": ("--set", "median.nb_radius=1 cell"), "plain": ()}


def write_survey(path: Path, points: int) -> None:
    """Write a bag with about `points` points of a plain, flown over in lanes along x."""
    rng = np.random.default_rng(1)
    side = (points / POINTS_PER_CELL) ** 0.5 * CELL
    messages = max(LANES, points // MESSAGE)
    with BagWriter(path, "ros1", {"/cloud": CLOUD_TYPE}) as bag:
        for number in range(messages):
            lane, along = divmod(number * LANES / messages, 1)
            x = side * (along + rng.uniform(0, LANES / messages, points // messages))
            y = side / LANES * (lane + rng.uniform(-0.2, 1.2, len(x)))
            z = 3 * np.sin(x / 20) * np.cos(y / 30) + rng.normal(0, CELL / 5, len(x))
            xyz = unstructured_to_structured(np.column_stack((x, y, z)), names=list("xyz"))
            bag.cloud("/cloud", number * 10**8, "map", xyz)


@click.command()
@click.option("--points", type=float, default=100e6, show_default=True)
@click.option("--memory", default="2G", show_default=True)
@click.option("--preset", type=click.Choice(list(SETTINGS)), default="default", show_default=True)
@click.option("--jobs", type=int, default=2, show_default=True)
def main(points: float, memory: str, preset: str, jobs: int) -> None:
    """Write the flight, build its map, and print time and memory."""
    with tempfile.TemporaryDirectory() as folder:
        bag = Path(folder, "survey.bag")
        write_survey(bag, int(points))
        command = [sys.executable, "-m", "mlscli", "build", str(bag), "-o", f"{folder}/map.npz"]
        command += ["--memory", memory, "--jobs", str(jobs), "--scratch", folder, "-c", preset]
        command += ["--set", f"map.cell_size={CELL}", *SETTINGS[preset]]
        run = ran(command)
        sizes = [path.stat().st_size / 2**30 for path in (bag, Path(folder, "map.npz"))]
    click.echo(run.output)
    click.echo(f"{run.seconds:.0f} s, {points / run.seconds:,.0f} points/s")
    click.echo(f"{run.peak / 2**30:.2f} GB resident at most, of {memory}")
    click.echo(f"bag {sizes[0]:.2f} GB, map {sizes[1]:.2f} GB")


if __name__ == "__main__":
    main()
