"""``mls export``: write a map as a mesh."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias, get_args

import click

from mlscli.commands.maps import the_one_map
from mlscli.commands.options import as_json, coloured, overwrite, without_artificial
from mlscli.errors import UsageError

if TYPE_CHECKING:
    from mlscli.maps.surface_map import SurfaceMap
    from mlscli.mesh.colours import ColourBy

Format: TypeAlias = Literal["ply", "obj", "glb", "mcap"]
FORMATS: tuple[Format, ...] = get_args(Format)


@click.command()
@click.argument("source", required=False, metavar="[MAP]")
@click.option(
    "--format",
    "kind",
    type=click.Choice(FORMATS),
    help="Default: what -o ends in, or else ply.",
)
@click.option(
    "--style",
    type=click.Choice(("surface", "patches")),
    default="surface",
    show_default=True,
    help="Surfaces and walls, or each patch as a point with a line for its depth.",
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
    help="Turn the mesh back into the frame of the recording: undo --up.",
)
@coloured
@without_artificial
@overwrite
@as_json
def command(
    source: str | None,
    kind: Format | None,
    style: Literal["surface", "patches"],
    output: str | None,
    max_slope: float | None,
    as_recorded: bool,
    colour: ColourBy,
    no_artificial: bool,
    overwrite: bool,
    as_json: bool,
) -> None:
    """Write a map as a mesh, for MeshLab, CloudCompare, Blender, a browser and the like.

    Without MAP the one map (.npz) in the current folder is taken. OBJ comes with a file of
    materials (.mtl) beside it. MCAP holds the finished map, uncovered as the flight saw it, for
    Foxglove Studio and RViz.
    """
    map_file = Path(source) if source is not None else the_one_map()
    kind = _format(kind, output)
    target = Path(output) if output is not None else Path(f"{map_file.stem}.{kind}")

    from mlscli.io.writing.atomic import refuse_existing

    refuse_existing(target, overwrite=overwrite, sources=[map_file])

    from mlscli.io.writing.glb import write_glb
    from mlscli.io.writing.npz import read_map

    if kind == "mcap":
        drawn = style != "surface" or max_slope is not None or no_artificial or as_recorded
        if drawn or colour != "height":
            raise UsageError("--format mcap: holds all of the map; leave out how it is to be drawn")
        surface = read_map(map_file)
        _replay(target, surface, overwrite=overwrite)
        _report(target, kind, {"patches": surface.size}, as_json=as_json)
        return

    from mlscli.io.writing.obj import write_obj
    from mlscli.io.writing.ply import write_ply
    from mlscli.mesh import MAX_SLOPE, build_mesh

    mesh = build_mesh(
        read_map(map_file),
        style,
        max_slope=MAX_SLOPE if max_slope is None else max_slope,
        artificial=not no_artificial,
        colour=colour,
        as_recorded=as_recorded,
    )
    write = {"ply": write_ply, "obj": write_obj, "glb": write_glb}[kind]
    write(target, mesh, overwrite=overwrite)
    counts = {
        "vertices": len(mesh.vertices),
        "triangles": len(mesh.triangles),
        "lines": len(mesh.lines),
    }
    _report(target, kind, counts, as_json=as_json)


def _replay(target: Path, surface: SurfaceMap, *, overwrite: bool) -> None:
    """Write the map as a replay: its patches appear as the flight measured them."""
    from mlscli.maps.uncovering import growth
    from mlscli.view.replay import write_replay

    write_replay(target, surface, growth(surface), overwrite=overwrite)


def _report(target: Path, kind: str, counts: dict[str, int], *, as_json: bool) -> None:
    if as_json:
        import json

        click.echo(json.dumps({"file": str(target), "format": kind, **counts}))
    else:
        held = ", ".join(f"{count} {name}" for name, count in counts.items())
        click.echo(f"{target}: {held}")


def _format(kind: Format | None, output: str | None) -> Format:
    """Return the format: `kind`, or by the output's ending, or ply; the first two must agree."""
    ending = None if output is None else Path(output).suffix.lower()
    by_ending = next((name for name in FORMATS if ending == f".{name}"), None)
    if kind and by_ending and kind != by_ending:
        raise UsageError(f"--format {kind}: {output} ends in .{by_ending}; let them agree")
    if output is not None and not (kind or by_ending):
        raise UsageError(
            f"{output}: does not end in .ply, .obj, .glb or .mcap; say which with --format"
        )
    return kind or by_ending or "ply"
