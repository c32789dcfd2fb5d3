"""The formats of ``mls export``: what each is called, which options it takes, how it is written."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from mlscli.words import some

if TYPE_CHECKING:
    from mlscli.maps.georeference import Georeference
    from mlscli.maps.surface_map import SurfaceMap

NOT_SEEN = (
    "the map does not say what was seen through, so nothing is free; build it with `free_space`"
)


class Order(NamedTuple):
    """What is to be written.

    Attributes
    ----------
    surface : SurfaceMap
    target : Path
        The file to write.
    options : dict
        The values of all options, by the names under which the command takes them.
    """

    surface: SurfaceMap
    target: Path
    options: dict[str, Any]

    @property
    def overwrite(self) -> bool:
        """Whether what exists may be replaced."""
        return bool(self.options["overwrite"])


class Written(NamedTuple):
    """What was written.

    Attributes
    ----------
    lines : list of str
        For the reader.
    told : dict
        The same, ready for JSON.
    notes : list of str
        What the user should know, on standard error.
    """

    lines: list[str]
    told: dict[str, Any]
    notes: list[str]


class Format(NamedTuple):
    """A format.

    Attributes
    ----------
    endings : tuple of str
        Those of its files, the usual one first.
    takes : tuple of str
        The options that it takes beside those of all formats.
    write : callable
    refuse : callable
        Refuses to replace what exists, before any work is done: ``refuse(target, options)``.
    """

    endings: tuple[str, ...]
    takes: tuple[str, ...]
    write: Callable[[Order], Written]
    refuse: Callable[[Path, dict[str, Any]], None]


def _refuse_file(target: Path, options: dict[str, Any]) -> None:
    from mlscli.io.writing.atomic import refuse_existing

    refuse_existing(target, overwrite=options["overwrite"])


def _counted(order: Order, counts: dict[str, int], notes: list[str] | None = None) -> Written:
    held = ", ".join(f"{count:,} {name}" for name, count in counts.items())
    return Written([f"{order.target}: {held}"], {**counts}, notes or [])


# --- meshes, and the replay ---

DRAWN = ("style", "max_slope", "as_recorded", "colour", "no_artificial")


def _mesh(order: Order) -> Written:
    from mlscli.io.writing.glb import write_glb
    from mlscli.io.writing.obj import write_obj
    from mlscli.io.writing.ply import write_ply
    from mlscli.mesh import MAX_SLOPE, build_mesh

    options = order.options
    slope = options["max_slope"]
    mesh = build_mesh(
        order.surface,
        options["style"],
        max_slope=MAX_SLOPE if slope is None else slope,
        artificial=not options["no_artificial"],
        colour=options["colour"],
        as_recorded=options["as_recorded"],
    )
    write = {"ply": write_ply, "obj": write_obj, "glb": write_glb}[options["kind"]]
    write(order.target, mesh, overwrite=order.overwrite)
    counts = {
        "vertices": len(mesh.vertices),
        "triangles": len(mesh.triangles),
        "lines": len(mesh.lines),
    }
    return _counted(order, counts)


def _replay(order: Order) -> Written:
    """Write the map as a replay: its patches appear as the flight measured them."""
    from mlscli.maps.uncovering import growth
    from mlscli.view.replay import write_replay

    surface = order.surface
    write_replay(order.target, surface, growth(surface), overwrite=order.overwrite)
    return _counted(order, {"patches": surface.size})


# --- for planners ---

ROBOT = ("slope", "step", "headroom")


def _nav2(order: Order) -> Written:
    from mlscli.io.writing.nav2 import write_nav2
    from mlscli.rasters.robot import Robot

    options = order.options
    flying = options["flying_height"]
    robot = Robot.of(**{name: options[name] for name in ROBOT})
    sheets, left_out = write_nav2(
        order.target,
        order.surface,
        robot,
        flying_height=flying,
        least=options["least"],
        overwrite=order.overwrite,
    )
    told = [sheet._asdict() | {"file": str(sheet.file)} for sheet in sheets]
    lines = [
        f"{sheet.file}: {sheet.what}: {sheet.free:,} free, {sheet.occupied:,} occupied, "
        f"{sheet.unknown:,} unknown"
        for sheet in sheets
    ]
    notes = [NOT_SEEN] if flying is not None and order.surface.free is None else []
    if left_out:
        notes.append(f"{some(left_out, 'cell')} with a floor too small for a storey of its own")
    return Written(lines, {"sheets": told, "left_out": left_out}, notes)


def _refuse_sheets(target: Path, options: dict[str, Any]) -> None:
    from mlscli.io.writing.nav2 import refuse_sheets

    refuse_sheets(target, overwrite=options["overwrite"], numbered=options["flying_height"] is None)


def _octomap(order: Order) -> Written:
    from mlscli.io.writing.octomap import write_octomap

    written = write_octomap(
        order.target,
        order.surface,
        artificial=not order.options["no_artificial"],
        least=order.options["least"],
        overwrite=order.overwrite,
    )
    notes = [NOT_SEEN] if order.surface.free is None else []
    line = (
        f"{order.target}: {written.occupied:,} occupied voxels, {written.free:,} free, in "
        f"{written.nodes:,} nodes; cubes of {written.side:g}"
    )
    return Written([line], written._asdict(), notes)


def _grid_map(order: Order) -> Written:
    from mlscli.io.writing.grid_map import MOST_LEVELS, write_grid_map

    written = write_grid_map(order.target, order.surface, overwrite=order.overwrite)
    line = (
        f"{order.target}: {written.rows:,} x {written.columns:,} cells, "
        f"layers {', '.join(written.layers)}"
    )
    more = some(written.left_out, "patch")
    notes = [f"{more} above level {MOST_LEVELS}: no layer of their own"] if written.left_out else []
    return Written([line], written._asdict(), notes)


def _layers(order: Order) -> Written:
    from mlscli.io.crs import NO_PYPROJ, wkt_of
    from mlscli.io.writing.raster import write_layers
    from mlscli.maps.georeference import georeference_of, map_georeference

    options = order.options
    written = write_layers(
        order.target,
        order.surface,
        options["kind"],
        crs=options["crs"],
        overwrite=order.overwrite,
    )
    place = map_georeference(order.surface.meta, options["crs"])
    size, names = written.extent, list(written.layers)
    line = f"{order.target}: {size.width:,} x {size.height:,} cells, layers {', '.join(names)}"
    told = {"columns": size.width, "rows": size.height, "layers": names}
    notes = []
    if options["kind"] != "npz":
        told["georeference"] = None if place is None else place.to_dict()
        if options["kind"] == "geotiff" or georeference_of(order.surface.meta) is not None:
            notes += _unplaced(order.surface, place)
        if place is not None:
            line = f"{line}; {place}"
        if options["kind"] == "netcdf" and place is not None and wkt_of(place.crs) is None:
            notes.append(f"the file holds the code {place.crs} alone: its text {NO_PYPROJ}")
    return Written([line], told, notes)


def _unplaced(surface: SurfaceMap, place: Georeference | None) -> list[str]:
    """Return why a file does not say where it lies on Earth, if it does not."""
    if place is not None:
        return []
    from mlscli.maps.georeference import georeference_of

    known = georeference_of(surface.meta)
    if known is None:
        return ["the file names no reference system; `crs` says which, as EPSG:32632"]
    return [
        f"the file names no reference system: the map was turned out of {known} so that z is up"
    ]


def _sdf(order: Order) -> Written:
    from mlscli.io.writing.sdf import write_sdf
    from mlscli.mesh import MAX_SLOPE, build_mesh

    options = order.options
    slope = options["max_slope"]
    mesh = build_mesh(
        order.surface,
        max_slope=MAX_SLOPE if slope is None else slope,
        artificial=not options["no_artificial"],
        colour=options["colour"],
    )
    world = write_sdf(order.target, mesh, overwrite=order.overwrite)
    line = f"{order.target}: a world, {world.triangles} triangles in {world.files[1]}"
    told = {"triangles": world.triangles, "place": world.place}
    return Written([line], told | {"files": [str(file) for file in world.files]}, [])


def _refuse_world(target: Path, options: dict[str, Any]) -> None:
    for ending in (target.suffix, ".obj", ".mtl"):
        _refuse_file(target.with_suffix(ending), options)


# --- clouds ---


def _cloud(order: Order) -> Written:
    from mlscli.io.crs import NO_PYPROJ
    from mlscli.io.writing.clouds import place_of_points, write_cloud
    from mlscli.maps.georeference import georeference_of

    options = order.options
    points, off = write_cloud(
        order.target,
        order.surface,
        options["kind"],
        filled=options["filled"],
        artificial=not options["no_artificial"],
        as_recorded=options["as_recorded"],
        crs=options["crs"],
        overwrite=order.overwrite,
    )
    notes = []
    if off > order.surface.cell_size / 100:
        why = "PCL's points are float32" if options["kind"] == "pcd" else "they span so much"
        notes.append(f"coordinates are rounded by up to {off:.3g}: {why}")
    known = georeference_of(order.surface.meta)
    if options["kind"] == "las" and (known is not None or options["crs"] is not None):
        as_recorded = options["as_recorded"]
        place, wkt = place_of_points(order.surface, options["crs"], as_recorded=as_recorded)
        if place is not None and wkt is None:
            notes.append(f"the file does not say that it lies in {place}, which {NO_PYPROJ}")
        elif place is None and as_recorded:
            notes.append(f"as recorded, points are not in {known}, to which an offset leads")
        elif place is None:
            notes += _unplaced(order.surface, place)
    return _counted(order, {"points": points}, notes)


FORMATS = {
    "ply": Format((".ply",), DRAWN, _mesh, _refuse_file),
    "obj": Format((".obj",), DRAWN, _mesh, _refuse_file),
    "glb": Format((".glb",), DRAWN, _mesh, _refuse_file),
    "mcap": Format((".mcap",), (), _replay, _refuse_file),
    "nav2": Format((".yaml", ".yml"), (*ROBOT, "flying_height", "least"), _nav2, _refuse_sheets),
    "octomap": Format((".bt",), ("no_artificial", "least"), _octomap, _refuse_file),
    "grid-map": Format((".mcap",), (), _grid_map, _refuse_file),
    "sdf": Format(
        (".sdf", ".world"), ("max_slope", "colour", "no_artificial"), _sdf, _refuse_world
    ),
    "npz": Format((".layers.npz", ".npz"), (), _layers, _refuse_file),
    "netcdf": Format((".nc",), ("crs",), _layers, _refuse_file),
    "geotiff": Format((".tif", ".tiff"), ("crs",), _layers, _refuse_file),
    "pcd": Format((".pcd",), ("filled", "no_artificial", "as_recorded"), _cloud, _refuse_file),
    "las": Format(
        (".las", ".laz"), ("filled", "no_artificial", "as_recorded", "crs"), _cloud, _refuse_file
    ),
}
