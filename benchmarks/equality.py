"""The same map however it is made: ``python -m benchmarks.equality`` (15 minutes or more).

Maps of recorded clouds grow in batches of many sizes, in the order recorded and shuffled, and are
made in tiles of many sizes by several threads. On the way and at the end, each is compared with the
map that one pass over the same points makes, patch by patch and bit for bit.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import click
import numpy as np

from mlscli.building.builder import MapBuilder
from mlscli.config import load
from mlscli.io.reading.recording import open_recording
from mlscli.keyframes.batches import Points, gather
from mlscli.keyframes.keyframe import Keyframe
from mlscli.maps.change import Change
from mlscli.maps.records import records_of
from mlscli.maps.surface_map import SurfaceMap
from mlscli.pipeline.parameters import Parameters
from mlscli.pipeline.pipeline import Pipeline
from mlscli.pipeline.report import Report
from mlscli.pipeline.tilewise.blocks import PointBlocks
from mlscli.pipeline.tilewise.tiles import Threads, evaluate_tiles, join, tiles_of
from mlscli.runtime.arrays import Float64

TELLO = {"columns": "x,y,z,-,-,-,-,keyframe,cx,cy,cz", "up": "-y"}


class Recorded(NamedTuple):
    """A recording and the size of cells for it.

    Attributes
    ----------
    path : str
        The file, in the folder of data.
    cell_size : float
        In the unit of the recording; small enough for gaps to be closed.
    options : mapping
        Arguments of `open_recording`.
    """

    path: str
    cell_size: float
    options: Mapping[str, Any] = {}

    def points(self, data: Path) -> Float64:
        """Return all points, z up, float64 (N, 3); `data` is the folder of data."""
        keyframes = open_recording(data / self.path, **self.options).keyframes()
        return np.concatenate([keyframe.points for keyframe in keyframes])

    @property
    def parameters(self) -> Parameters:
        """The default parameters with its cell size."""
        return load(None, [f"map.cell_size={self.cell_size}"])


RECORDED = {
    "Tello": Recorded("sparse/tello_kf_pointData.csv", 0.029, TELLO),
    "EuRoC, Vicon room": Recorded("sparse/euroc_orb2_MapPoints.txt", 0.12),
    "EuRoC, machine hall": Recorded("sparse/euroc_orb3_pointcloud.txt", 0.09),
    "bridge": Recorded("multilevel/als_bridge_samp21.pcd", 1.5),
    "building": Recorded("multilevel/building_floors_cgal.ply", 0.25),
}
SIZES = (20, 52, 80, 300, 1000)
# Width of tiles, as a power of two in cells, and how many threads make them.
TILES = ((0, 2), (1, 8), (3, 3), (5, 1))
LOOKS = 10


class Row(NamedTuple):
    """A map that was made in pieces, compared with those made in one pass.

    Attributes
    ----------
    how : str
        How it was made, in words.
    pieces : int
        How many batches or tiles it was made of.
    patches : int
        How many patches it has.
    compared : int
        How many times it was compared.
    differing : int
        How many patches differed, summed over these.
    seconds : float
        Wall time of making it.
    """

    how: str
    pieces: int
    patches: int
    compared: int
    differing: int
    seconds: float

    def cells(self) -> tuple[str, ...]:
        """Return the row's cells."""
        return (
            self.how,
            f"{self.pieces:,}",
            f"{self.patches:,}",
            str(self.compared),
            f"{self.differing:,}",
            f"{self.seconds:.1f}",
        )


def part(xyz: Float64, size: int) -> Float64:
    """Return the `size` points (N, 3) of a square around the median x and y, in their order."""
    far = np.abs(xyz[:, :2] - np.median(xyz[:, :2], axis=0)).max(axis=1)
    return xyz[np.sort(np.argsort(far, kind="stable")[:size])]


def rows(
    xyz: Float64, parameters: Parameters, sizes: Sequence[int] = SIZES, looks: int = LOOKS
) -> Iterator[Row]:
    """Yield a row for each size of batches, in either order, and for each size of tiles.

    Parameters
    ----------
    xyz : float64 (N, 3)
        The points, z up.
    parameters : Parameters
    sizes : sequence of int
        Points in a batch; all points as one batch are added.
    looks : int
        How many times a map that grows is compared, besides at the end.
    """
    shuffled = np.random.default_rng(1).permutation(xyz)
    for order, points in (("as recorded", xyz), ("shuffled", shuffled)):
        for size in (*sizes, len(xyz)):
            what = "all" if size == len(xyz) else f"{size:,}"
            yield grown(f"batches of {what}, {order}", points, size, parameters, looks)
    for shift, threads in TILES:
        cells = 2**shift
        yield map_in_tiles(
            f"tiles of {cells} x {cells} cells, {threads} at a time",
            xyz,
            shift,
            threads,
            parameters,
        )
    yield map_in_tiles("one tile", xyz, 0, 1, parameters, most=len(xyz))


def grown(how: str, xyz: Float64, size: int, parameters: Parameters, looks: int = LOOKS) -> Row:
    """Grow a map in batches of `size` points; compare it at most `looks` times, and at the end."""
    keyframes = [Keyframe(xyz[begin : begin + size]) for begin in range(0, len(xyz), size)]
    compared = set(np.linspace(0, len(keyframes), looks + 1).round().astype(int).tolist())
    builder = MapBuilder(parameters)
    seconds, differing = 0.0, 0
    # The changes that the builder reports must add up to the map as well.
    told = builder.surface
    for number, keyframe in enumerate(keyframes, 1):
        begin = time.perf_counter()
        change = builder.process_cloud(keyframe.points)
        seconds += time.perf_counter() - begin
        told = change.applied_to(told)
        if number in compared:
            expected = one_pass(keyframes[:number], parameters)
            differing += differ(builder.surface, expected) + differ(told, expected)
    surface = builder.finish()
    differing += differ(surface, one_pass(keyframes, parameters))
    return Row(how, len(keyframes), surface.size, len(compared), differing, seconds)


def map_in_tiles(
    how: str, xyz: Float64, shift: int, threads: int, parameters: Parameters, most: int = 0
) -> Row:
    """Make a map in tiles and compare it.

    Parameters
    ----------
    how : str
        How it is made, in words.
    xyz : float64 (N, 3)
        The points, z up.
    shift : int
        Tiles are at least ``2**shift`` cells wide.
    threads : int
        How many threads make tiles at a time.
    parameters : Parameters
    most : int
        Tiles of more points, those of their margin included, are divided.
    """
    pipeline = Pipeline(parameters, "map", Report())
    points = gather([Keyframe(xyz)]).points
    begin = time.perf_counter()
    blocks = PointBlocks(pipeline.cell_size, shift=shift)
    blocks.add(points)
    tiles = tiles_of(blocks, pipeline.reach, most)
    surface = join(pipeline.grid, list(evaluate_tiles(pipeline, blocks, tiles, Threads(threads))))
    seconds = time.perf_counter() - begin
    differing = differ(surface, one_pass([Keyframe(xyz)], parameters))
    return Row(how, len(tiles), surface.size, 1, differing, seconds)


def one_pass(keyframes: Sequence[Keyframe], parameters: Parameters) -> SurfaceMap:
    """Return the map of all points, each stage run once."""
    pipeline = Pipeline(parameters, "map", Report())
    points: Points = gather(keyframes).points
    return pipeline.run_final_stages(pipeline.run_map_stages(pipeline.filter_and_group(points)))


def differ(one: SurfaceMap, other: SurfaceMap) -> int:
    """Count the patches that only one of two maps has."""
    change = Change.between(records_of(one), records_of(other), one.grid)
    return change.removed.size + change.added.size


@click.command()
@click.option("--data", "folder", type=Path, default=Path("../shared/data"), show_default=True)
@click.argument("names", nargs=-1, type=click.Choice(list(RECORDED)))
def main(folder: Path, names: tuple[str, ...]) -> None:
    """Print a table for each recording."""
    for name in names or RECORDED:
        xyz = RECORDED[name].points(folder)
        click.echo(f"\n{name}: {len(xyz):,} points, cells of {RECORDED[name].cell_size}\n")
        click.echo("| how | pieces | patches | compared | patches that differ | seconds |")
        click.echo("|:--|--:|--:|--:|--:|--:|")
        for row in rows(xyz, RECORDED[name].parameters):
            click.echo(f"| {' | '.join(row.cells())} |")


if __name__ == "__main__":
    main()
