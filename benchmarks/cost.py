"""What a whole build costs beside another version of the program, in time of the processors.

Run it as ``python -m benchmarks.cost OTHER``, where that is the Python of an environment in which
the other version is installed; it takes some minutes. Both build the same recordings in turns, with
their defaults, each in a new process; the first turn does not count. How time grows with the points
is told of clouds and of flights by themselves, and what sight lines cost of a flight that is built
batch by batch.
"""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from statistics import median

import click
import numpy as np

from benchmarks.clouds import cloud
from benchmarks.process import Ran, ran
from benchmarks.scans import DATA
from benchmarks.table import Timer, figure, lines
from mlscli.building.build import settled
from mlscli.building.builder import MapBuilder
from mlscli.config import load
from mlscli.io.reading.recording import open_recording
from mlscli.pipeline.parameters import Parameters
from mlscli.pipeline.report import Report

MOST, MOST_OF_MEDIAN = 1.3, 1.5
HEAD = ("what", "then, s", "now, s", "times", "its median", "")
# What a build reports of its stages is time of the processors, too. (-P: no module of this folder.)
MLS = "import time; time.perf_counter = time.process_time; from mlscli.cli import main; main()"
# The most that sight lines may add to a flight that is built batch by batch.
MOST_OF_SIGHTS, SIGHTS = 1.1, ("0", "6 cells")
# Recordings, beside the checkout where they are there.
RECORDINGS = {
    "footbridge": ("multilevel/footbridge_yup_dddmr_map.pcd", "--up", "y"),
    "building": ("multilevel/building_floors_cgal.ply",),
    "Tello flight": (
        *("sparse/tello_kf_pointData.csv", "--up", "-y"),
        *("--columns", "x,y,z,-,-,-,-,keyframe,cx,cy,cz"),
    ),
}
# Points of a cloud without positions; houses along a side of a village that was flown over.
CLOUDS, VILLAGES = (100_000, 300_000, 1_000_000), (6, 10, 18)


@click.command()
@click.argument("other", type=click.Path(exists=True, dir_okay=False))
@click.option("--repeats", type=click.IntRange(min=1), default=5, show_default=True)
def main(other: str, repeats: int) -> None:
    """Print the table, how time grows with the points, and what sight lines cost."""
    with tempfile.TemporaryDirectory() as folder:
        builds = {name: [str(DATA / path), *rest] for name, (path, *rest) in RECORDINGS.items()}
        builds = {name: each for name, each in builds.items() if Path(each[0]).exists()}
        builds |= {name: [str(path)] for name, path in written(Path(folder))}
        spent: dict[str, tuple[int, float]] = {}
        for line in lines(HEAD, rows(other, builds, repeats, Path(folder), spent)):
            click.echo(line)
        for kind in ("cloud", "flight"):
            some = [each for name, each in spent.items() if name.startswith(f"{kind} of")]
            points, seconds = zip(*some, strict=True)
            power = np.polyfit(np.log(points), np.log(seconds), 1)[0]
            click.echo(f"\n{kind}s of {points[0]:,} to {points[-1]:,} points: exponent {power:.2f}")
        flight = Path(folder, f"{VILLAGES[0]}.bag")
        without, with_them = seconds_by_batches(flight, repeats)
        times = with_them / without
        click.echo(
            f"\nbatch by batch, without and with sight lines: {without:.2f} s, {with_them:.2f} s, "
            f"{times:.2f} times; at most {MOST_OF_SIGHTS:g}: {_verdict(times <= MOST_OF_SIGHTS)}"
        )


def written(folder: Path) -> Iterator[tuple[str, Path]]:
    """Write clouds and flights, and yield their names and paths."""
    for size in CLOUDS:
        path = folder / f"{size}.ply"
        names = "".join(f"property double {axis}\n" for axis in "xyz")
        head = f"ply\nformat binary_little_endian 1.0\nelement vertex {size}\n{names}end_header\n"
        path.write_bytes(head.encode() + cloud(size, 4.0).xyz.astype("<f8").tobytes())
        yield f"cloud of {size:,}", path
    for side in VILLAGES:
        path = folder / f"{side}.bag"
        synth = ["synth", "--type", "village", "--size", str(side), "-o", str(path), "--json"]
        made = json.loads(ran([sys.executable, "-m", "mlscli", *synth]).output)
        yield f"flight of {made['points']:,}", path


def rows(
    other: str,
    builds: Mapping[str, Sequence[str]],
    repeats: int,
    folder: Path,
    spent: dict[str, tuple[int, float]],
) -> Iterator[tuple[str, ...]]:
    """Yield the cells of a row for each build; `spent` receives points and seconds (now)."""
    for name, source in builds.items():
        output = ["-o", str(folder / "map.npz"), "--overwrite", "--json"]
        runs = (list[Ran](), list[Ran]())
        for turn in range(repeats + 1):
            for python, each in zip((other, sys.executable), runs, strict=True):
                run = ran([python, "-P", "-c", MLS, "build", *source, *output])
                if turn:
                    each.append(run)
        then, now = (median(run.cpu for run in each) for each in runs)
        told = [[json.loads(run.output) for run in each] for each in runs]
        medians = [median(one["seconds"]["median"] for one in each) for each in told]
        spent[name] = told[1][0]["points"]["read"], now
        times, of_median = now / then, medians[1] / medians[0]
        reached = times <= MOST and of_median <= MOST_OF_MEDIAN
        yield name, *map(figure, (then, now, times, of_median)), _verdict(reached)


def seconds_by_batches(flight: Path, repeats: int) -> list[float]:
    """Return the time (s) to build a flight batch by batch, without and with sight lines."""
    keyframes = list(open_recording(flight))
    parameters = [
        settled(load(None, [f"plaster.sight={sight}"]), keyframes, Report()) for sight in SIGHTS
    ]

    def grown(chosen: Parameters) -> None:
        builder = MapBuilder(chosen, follow=lambda _: None)
        for keyframe in keyframes:
            builder.add(keyframe)
        builder.finish()

    return Timer(repeats, cpu=True).seconds(*(partial(grown, each) for each in parameters))


def _verdict(reached: bool) -> str:
    return "reached" if reached else "MISSED"


if __name__ == "__main__":
    main()
