"""``mls export``: write a map in the format of another program."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from mlscli.commands.formats import FORMATS, Order
from mlscli.commands.maps import the_one_map
from mlscli.commands.options import (
    as_json,
    coloured,
    least_lines,
    overwrite,
    refuse_given,
    say,
    tell,
    without_artificial,
)
from mlscli.errors import UsageError


@click.command()
@click.argument("source", required=False, metavar="[MAP]")
@click.option(
    "--format",
    "kind",
    type=click.Choice(tuple(FORMATS)),
    metavar="FORMAT",
    help=f"{', '.join(FORMATS)}; by default what -o ends in, or else ply.",
)
@click.option(
    "--style",
    type=click.Choice(("surface", "patches")),
    default="surface",
    show_default=True,
    help="Of meshes: surfaces and walls, or each patch as a point with a line for its depth.",
)
@click.option(
    "-o",
    "--output",
    metavar="FILE",
    help="Default: the map's name with the format's ending, in the current folder.",
)
@click.option(
    "--max-slope",
    type=float,
    metavar="CELLS",
    help="Join neighbouring patches up to this height difference, in cells.  [default: 1.5]",
)
@click.option(
    "--as-recorded",
    is_flag=True,
    help="Turn a mesh or cloud back into the frame of the recording: undo --up.",
)
@coloured
@without_artificial
@click.option(
    "--slope",
    type=float,
    metavar="DEGREES",
    help="Of nav2: the steepest slope that the robot climbs.  [default: 20]",
)
@click.option(
    "--step",
    metavar="LENGTH",
    help="Of nav2: the highest step that it climbs, a number or N cells.  [default: 0.5 cells]",
)
@click.option(
    "--headroom",
    metavar="LENGTH",
    help="Of nav2: how high the robot is, a number or N cells.  [default: the map's vehicle]",
)
@click.option(
    "--flying-height",
    type=float,
    metavar="Z",
    help="Of nav2: what a craft meets whose middle flies there, in place of storeys.",
)
@least_lines
@click.option(
    "--filled",
    is_flag=True,
    help="Of pcd and las: points all down the walls, at most half a cell apart.",
)
@click.option(
    "--crs",
    metavar="CRS",
    help="Of geotiff, netcdf and las: the reference system of the map frame, as EPSG:32632, where "
    "the map does not know it.",
)
@overwrite
@as_json
def command(source: str | None, as_json: bool, **options: Any) -> None:
    """Write a map for MeshLab, CloudCompare, Blender, a browser, or for a planner.

    Without MAP the one map (.npz) in the current folder is taken. OBJ comes with a file of
    materials (.mtl) beside it. MCAP holds the finished map, uncovered as the flight saw it, for
    Lichtblick, Foxglove and RViz. nav2 is what map_server reads, an image and a YAML file for each
    storey (NAME.1.yaml, ...) on which a robot can drive, or for a flying height; octomap is a .bt
    file of occupied, free and unknown space. pcd and las are its patches as points with fields;
    grid-map is a message of grid_map in MCAP; npz, netcdf and geotiff are layers by cell;
    sdf is a world for Gazebo, with its mesh (.obj, .mtl) beside it.
    """
    map_file = Path(source) if source is not None else the_one_map()
    output = options["output"]
    kind = options["kind"] = _format(options["kind"], output)
    chosen = FORMATS[kind]
    taken = {name for each in FORMATS.values() for name in each.takes}
    refuse_given(f"--format {kind} does not take it", *taken.difference(chosen.takes))
    target = Path(output) if output is not None else Path(map_file.stem + chosen.endings[0])

    from mlscli.io.writing.atomic import refuse_sources

    refuse_sources(target, [map_file])
    chosen.refuse(target, options)

    from mlscli.io.writing.npz import read_map

    written = chosen.write(Order(read_map(map_file), target, options))
    for note in written.notes:
        say(f"mls: {map_file}: {note}")
    if as_json:
        import json

        click.echo(json.dumps({"file": str(target), "format": kind, **written.told}))
    else:
        for line in written.lines:
            tell(line)


def _format(kind: str | None, output: str | None) -> str:
    """Return the format: `kind`, or by the output's ending, or ply; the first two must agree."""
    ending = "" if output is None else Path(output).suffix.lower()
    by_ending = [name for name, each in FORMATS.items() if ending in each.endings]
    if kind and by_ending and kind not in by_ending:
        raise UsageError(f"--format {kind}: {output} ends in {ending}; let them agree")
    if output is not None and not (kind or by_ending):
        *endings, last = dict.fromkeys(each.endings[0] for each in FORMATS.values())
        raise UsageError(
            f"{output}: does not end in {', '.join(endings)} or {last}; say which with --format"
        )
    return kind or next(iter(by_ending), "ply")
