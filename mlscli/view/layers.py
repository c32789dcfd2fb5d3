"""Layers of triangles, lines and points to draw of a map, sorted by when their elements appear.

The elements visible at any keyframe are thus the first ones of their layer: to play the flight, no
element needs a test of its own.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mlscli.io.writing.explored import drawing
from mlscli.io.writing.way import way_colours
from mlscli.maps.cells import cell_indices, on_grid, pack
from mlscli.maps.surface_map import ARTIFICIAL, SurfaceMap
from mlscli.maps.uncovering import appearing, patch_places
from mlscli.mesh import ROUTE, Mesh, build_mesh
from mlscli.mesh.colours import height_colours, height_range, origin_at, patch_colours
from mlscli.queries.clearance import Clearance
from mlscli.queries.exploration import Exploration
from mlscli.runtime.arrays import Float64, Int32, Int64, UInt8

# A triangle is upright if at most this share of its area is seen from above.
UPRIGHT = 1e-6

# More points than this are thinned out: browsers can hold them, but draw them slowly.
MOST_POINTS = 1_000_000

TRACK_GREY = (128, 128, 136)


class Vertices(NamedTuple):
    """Positions and colours that the elements of layers refer to.

    Attributes
    ----------
    position : float64 (V, 3)
        Coordinates in the map frame.
    colour : uint8 (V, 3)
        Red, green, blue.
    patch : int32 (V,), optional
        The patch of the map that each vertex belongs to; -1: none. None: no vertex belongs to one.
    """

    position: Float64
    colour: UInt8
    patch: Int32 | None = None


@dataclass(frozen=True, eq=False)
class Layer:
    """Elements that are shown or hidden together.

    Attributes
    ----------
    name : str
    vertices : str
        The name of its vertices in `Picture.vertices`.
    elements : int64 (E, K)
        Indices of vertices: 3 of a triangle, 2 of a line, 1 of a point.
    when : int32 (E,)
        The keyframe with which each element appears, ascending.
    shown : bool
        Whether the layer is shown at first.
    """

    name: str
    vertices: str
    elements: Int64
    when: Int32
    shown: bool = True


class Picture(NamedTuple):
    """All that can be shown of a map.

    Attributes
    ----------
    vertices : dict of str to Vertices
        The vertices of the layers, by name.
    layers : list of Layer
    """

    vertices: dict[str, Vertices]
    layers: list[Layer]


def picture(
    surface: SurfaceMap,
    points: Float64 | None = None,
    mesh: Mesh | None = None,
    explored: Exploration | None = None,
    fitted: Clearance | None = None,
) -> Picture:
    """Return the layers of a map.

    Parameters
    ----------
    surface : SurfaceMap
    points : float64 (N, 3), optional
        Points to show with the map, in the map frame; of more than `MOST_POINTS`, every n-th.
    mesh : Mesh, optional
        The map's surfaces and walls; by default as `build_mesh` makes them.
    explored : Exploration, optional
        Views of the map to show with it.
    fitted : Clearance, optional
        The way of a craft to show, coloured by its clearance.
    """
    when = appearing(surface)
    mesh = build_mesh(surface) if mesh is None else mesh
    vertices = {"mesh": Vertices(mesh.vertices, mesh.colours, mesh.patch)}
    layers = [*_triangles(mesh, when), _ground_route(surface, mesh)]
    vertices["patches"], patches = _patches(surface, when)
    vertices["track"], track = _track(surface)
    layers += [track, *patches]
    if points is not None:
        vertices["points"], cloud = _points(surface, points)
        layers.append(cloud)
    # These are of the finished map.
    last = max(len(surface.route) - 1, 0)
    if explored is not None and explored.views:
        lines = drawing(explored)
        vertices["views"] = Vertices(lines.vertices, lines.colours)
        layers.append(_at("views", lines.ends, last))
    if fitted is not None:
        vertices["clearance"], way = _fitted(fitted)
        layers.append(_at("clearance", way, last))
    return Picture(vertices, layers)


def faces(mesh: Mesh) -> dict[str, Int32]:
    """Return the triangles of a mesh, int32 (N, 3): surface, walls, and artificial ones of both."""
    a, b, c = (mesh.vertices[mesh.triangles[:, corner]] for corner in range(3))
    normal = np.cross(b - a, c - a)
    upright = np.abs(normal[:, 2]) <= UPRIGHT * np.linalg.norm(normal, axis=1)
    artificial = mesh.group(mesh.triangles) == ARTIFICIAL
    return {
        "surface": mesh.triangles[~artificial & ~upright],
        "walls": mesh.triangles[~artificial & upright],
        "artificial": mesh.triangles[artificial],
    }


def _triangles(mesh: Mesh, appears: Int32) -> list[Layer]:
    """Return the layers of surfaces, walls, and artificial triangles of both."""
    # The 0 stands for vertices of no patch (-1), which are not corners of triangles.
    when = np.append(appears, np.int32(0))[mesh.patch]
    return [
        _sorted(name, "mesh", triangles, when[triangles].max(axis=1, initial=0))
        for name, triangles in faces(mesh).items()
    ]


def _ground_route(surface: SurfaceMap, mesh: Mesh) -> Layer:
    """Return the route on the ground; each leg appears with the keyframe that it leads to."""
    rows: dict[tuple[float, float], list[int]] = {}
    for row, (_, x, y, _) in enumerate(surface.route.tolist()):
        rows.setdefault((x, y), []).append(row)
    # The route's vertices are in order; between those of keyframes there can be others.
    when = np.zeros(len(mesh.vertices), dtype=np.int32)
    reached, waiting = 0, []
    for vertex in np.flatnonzero(mesh.origin == ROUTE).tolist():
        x, y = mesh.vertices[vertex, :2].tolist()
        later = [row for row in rows.get((x, y), ()) if row >= reached]
        waiting.append(vertex)
        if later:
            reached = later[0]
            when[waiting] = reached
            waiting = []
    when[waiting] = reached
    legs = mesh.lines[mesh.group(mesh.lines) == ROUTE]
    return _sorted("route", "mesh", legs, when[legs].max(axis=1, initial=0))


def _track(surface: SurfaceMap) -> tuple[Vertices, Layer]:
    """Return the route in the air."""
    known = np.flatnonzero(np.isfinite(surface.route[:, 1:]).all(axis=1))
    legs = np.column_stack((np.arange(len(known) - 1), np.arange(1, len(known))))
    colour = np.tile(np.array(TRACK_GREY, dtype=np.uint8), (len(known), 1))
    vertices = Vertices(surface.route[known, 1:], colour)
    return vertices, _sorted("track", "track", legs, known[1:].astype(np.int32))


def _patches(surface: SurfaceMap, appears: Int32) -> tuple[Vertices, list[Layer]]:
    """Return each patch as a point at its height, and each depth as a line beneath it."""
    upright = np.flatnonzero(surface.depth > 0)
    top = patch_places(surface)
    foot = np.column_stack((top[upright, :2], surface.low_end[upright]))
    height = np.concatenate((top, foot))
    number = np.arange(surface.size)
    origin = origin_at(surface, np.concatenate((number, upright)), height[:, 2])
    colour = patch_colours(height[:, 2], origin, *height_range(surface))
    lines = np.column_stack((upright, surface.size + np.arange(len(upright))))
    patch = np.concatenate((number, upright)).astype(np.int32)
    return Vertices(height, colour, patch), [
        _sorted("patches", "patches", number[:, None], appears, shown=False),
        _sorted("depths", "patches", lines, appears[upright], shown=False),
    ]


def _points(surface: SurfaceMap, points: Float64) -> tuple[Vertices, Layer]:
    """Return the layer of points; each appears with the first patch of its cell."""
    points = points[:: -(-len(points) // MOST_POINTS) or 1]
    vertices = Vertices(points, height_colours(points[:, 2], *height_range(surface)))
    ix, iy, start = surface.cells
    when = np.zeros(len(points), dtype=np.int32)
    on_cells = on_grid(points, surface.cell_size)
    if surface.size:
        appears = np.minimum.reduceat(appearing(surface), start[:-1])
        keys = pack(ix, iy)
        own = pack(*cell_indices(points[on_cells, :2], surface.cell_size).astype(np.int32).T)
        place = np.minimum(np.searchsorted(keys, own), len(keys) - 1)
        when[on_cells] = np.where(keys[place] == own, appears[place], 0)
    return vertices, _sorted("points", "points", np.arange(len(points))[:, None], when)


def _fitted(fitted: Clearance) -> tuple[Vertices, Int64]:
    """Return the way of a craft as lines, and at each piece one as high as the craft."""
    place, half = fitted.pieces.place, np.array([0, 0, fitted.height / 2])
    middle = (place[:-1] + place[1:]) / 2
    ends = np.stack((place[:-1], place[1:], middle - half, middle + half), axis=1).reshape(-1, 3)
    colours = np.repeat(way_colours(fitted), 4, axis=0)
    return Vertices(ends, colours), np.arange(len(ends)).reshape(-1, 2)


def _at(name: str, lines: Int32 | Int64, keyframe: int) -> Layer:
    """Return lines between vertices of the layer's name that all appear with a keyframe."""
    return _sorted(name, name, lines, np.full(len(lines), keyframe, dtype=np.int32))


def _sorted(
    name: str, vertices: str, elements: Int32 | Int64, when: Int32, *, shown: bool = True
) -> Layer:
    """Return a layer with its elements in the order in which they appear."""
    order = np.argsort(when, kind="stable")
    return Layer(name, vertices, elements[order].astype(np.int64), when[order], shown)
