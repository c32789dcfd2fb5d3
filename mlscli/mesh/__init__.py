"""A mesh of a map: surfaces and walls, or patches as points and lines (thesis, chapter 2).

The modules `triangulation` and `walls` define how patches become triangles. The thesis lost every
patch with fewer than two neighbours; here nothing in the map is invisible. A horizontal patch that
no triangle uses is drawn as a square half a cell wide. The part of a vertical patch that no wall
shows is drawn as two upright quads that cross, with such a square on top where no surface meets it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from numbers import Real
from typing import Literal, NamedTuple, TypeAlias, get_args

import numpy as np

from mlscli.errors import InputError, UsageError, expect
from mlscli.maps.recorded import as_recorded as turned_back
from mlscli.maps.surface_map import ARTIFICIAL, ORIGINS, SurfaceMap
from mlscli.mesh.colours import COLOURS, ROUTE_GREEN, ColourBy, Paint, origin_at
from mlscli.mesh.ground import route_on_ground
from mlscli.mesh.orientation import oriented
from mlscli.mesh.triangulation import NONE, Nodes, links, nodes_of, surface_triangles
from mlscli.mesh.walls import measured_ends, walls_of
from mlscli.parameters.lengths import ALIKE
from mlscli.runtime.arrays import Float64, Int32, Int64, UInt8

Style: TypeAlias = Literal["surface", "patches"]
STYLES: tuple[Style, ...] = get_args(Style)

# The groups of vertices: one for each origin of patches, and one for the route.
ROUTE = len(ORIGINS)
GROUPS = (*ORIGINS, "route")

# Half the default gap of three cells: patches farther apart may be nearer to another level.
MAX_SLOPE = 1.5

MAX_VERTICES = 2**31 - 1

# The route runs this many cells above the ground, so as not to be hidden in it.
ROUTE_LIFT = 0.1

# The quads of patches drawn alone: offsets of the corners from the cell's centre, in cells.
_SQUARE = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) / 4
_ALONG_X = np.array([(-1, 0), (1, 0), (1, 0), (-1, 0)]) / 4
_ALONG_Y = np.array([(0, -1), (0, 1), (0, 1), (0, -1)]) / 4
_TWO_TRIANGLES = np.array([(0, 1, 2), (0, 2, 3)])


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles, lines and points over shared vertices.

    Attributes
    ----------
    vertices : float64 (V, 3)
        Coordinates in the map frame, or in that of the recording, in the unit of the recording.
    colours : uint8 (V, 3)
        Red, green, blue.
    origin : uint8 (V,)
        Index into `GROUPS`: the origin of the vertex's patch, or `ROUTE`. Where a measured patch
        lies beyond its points, drawn out or moved, it is shown as plastered.
    triangles : int32 (T, 3)
        Indices of vertices; surfaces run counter-clockwise seen from above.
    lines : int32 (L, 2)
        Indices of vertices.
    points : int32 (N,)
        Indices of vertices that are drawn as points.
    patch : int32 (V,)
        Index of the vertex's patch in the map, counted without artificial patches if these were
        left out; -1: the vertex belongs to the route.
    """

    vertices: Float64
    colours: UInt8
    origin: UInt8
    triangles: Int32
    lines: Int32
    points: Int32
    patch: Int32

    def group(self, elements: Int32) -> UInt8:
        """Return the group of each element, uint8 (E,): the greatest of its vertices.

        A triangle with an artificial corner is artificial: it spans a region of uncertainty.

        Parameters
        ----------
        elements : int32 (E, K)
            Indices of vertices.
        """
        group: UInt8 = self.origin[elements].max(axis=1)
        return group


def mesh_of(shape: Mesh | SurfaceMap) -> Mesh:
    """Return a mesh as it is, and of a map the one that `build_mesh` makes by default.

    Raises
    ------
    TypeError
        It is neither.
    """
    expect(shape, (Mesh, SurfaceMap), "mesh", "a map (SurfaceMap) or a mesh (Mesh)")
    return build_mesh(shape) if isinstance(shape, SurfaceMap) else shape


def build_mesh(
    surface: SurfaceMap,
    style: Style = "surface",
    *,
    max_slope: float = MAX_SLOPE,
    artificial: bool = True,
    colour: ColourBy = "height",
    as_recorded: bool = False,
) -> Mesh:
    """Make a mesh of a map.

    Parameters
    ----------
    surface : SurfaceMap
    style : {"surface", "patches"}
        ``surface``: surfaces and walls; ``patches``: each patch as a point at its height and
        each depth as a line beneath it (thesis, figure 2.3). In both the route is a line on the
        ground.
    max_slope : float
        Patches of neighbouring cells belong together up to this difference in height, in cells.
    artificial : bool
        Whether artificial patches are drawn.
    colour : str
        What the colours stand for, one of `COLOURS`. With ``height``, plastered patches are
        lighter; with all but ``region``, artificial ones are red.
    as_recorded : bool
        Whether the mesh is turned back into the frame of the recording, where z need not be up.

    Raises
    ------
    UsageError
        Where the style or the colouring is unknown, or the slope is not a finite number of 0 or
        more.
    InputError
        Where the mesh would have more than `MAX_VERTICES` vertices, or coordinates beyond float64,
        or the map's meta holds no turn.
    """
    expect(surface, SurfaceMap, "surface", "a map (SurfaceMap)")
    expect(style, str, "style", f"one of {', '.join(STYLES)}")
    expect(colour, str, "colour", f"one of {', '.join(COLOURS)}")
    expect(max_slope, Real, "max_slope", "a finite number of 0 or more")
    if style not in STYLES:
        raise UsageError(f"style: is {style!r}; it must be one of {', '.join(STYLES)}")
    if colour not in COLOURS:
        raise UsageError(f"colour: is {colour!r}; it must be one of {', '.join(COLOURS)}")
    if not math.isfinite(max_slope) or max_slope < 0:
        raise UsageError(f"`max_slope` {max_slope!r}: expected a finite number of 0 or more")
    paint = Paint(surface, colour)
    if not artificial:
        surface = surface.take(surface.origin != ARTIFICIAL)
    # Lengths within 1e-9 of a cell are equal: heights that rounding tells apart make no sliver.
    reach = (max_slope + ALIKE) * surface.cell_size
    nodes = nodes_of(surface, reach if style == "surface" else math.inf)
    if style == "surface":
        mesh = _assemble(surface, paint, _drawn(surface, nodes, reach))
    else:
        nodes, depths = _depths(surface, nodes)
        mesh = _assemble(surface, paint, [_nodes(nodes)], depths, nodes.top)
    if not as_recorded:
        return mesh
    return replace(mesh, vertices=turned_back(mesh.vertices, surface.meta))


def _depths(surface: SurfaceMap, nodes: Nodes) -> tuple[Nodes, Int64]:
    """Return the nodes, with the ends of what was measured, and the lines beneath patches (D, 2).

    A patch that is drawn out beyond its points has a line for each part.
    """
    patch, height = measured_ends(surface)
    upright = np.flatnonzero(nodes.foot != NONE)
    ends = np.concatenate((nodes.top[upright], nodes.foot[upright]))
    node = np.concatenate((ends, len(nodes.patch) + np.arange(len(patch))))
    grown = nodes._replace(
        patch=np.concatenate((nodes.patch, patch)), height=np.concatenate((nodes.height, height))
    )
    # From the top of each patch down.
    node = node[np.lexsort((-grown.height[node], grown.patch[node]))]
    of = grown.patch[node]
    return grown, np.column_stack((node[:-1], node[1:]))[of[:-1] == of[1:]]


class _Piece(NamedTuple):
    """Vertices, placed relative to the cells of their patches, and triangles over them.

    Attributes
    ----------
    patch : int64 (V,)
        Index of the patch that each vertex belongs to.
    height : float64 (V,)
        Height of each vertex, in the unit of the recording.
    offset : float64 (V, 2)
        Distance in x and y from the centre of the patch's cell, in cells.
    triangles : int64 (T, 3)
        Indices of vertices.
    """

    patch: Int64
    height: Float64
    offset: Float64
    triangles: Int64


def _drawn(surface: SurfaceMap, nodes: Nodes, reach: float) -> list[_Piece]:
    """Return the surfaces and walls of a map, and squares and quads for what these do not show."""
    flat = surface_triangles(links(surface, nodes, reach), nodes.height, nodes.is_joint)
    nodes, walls, bare = walls_of(surface, nodes, reach)
    on_surface = np.zeros(len(nodes.patch), dtype=np.bool_)
    on_surface[flat] = True
    open_top = nodes.top[~on_surface[nodes.top]]
    is_bare = (nodes.foot == NONE)[nodes.patch]
    is_bare[bare[:, 1]] = True
    level = open_top[is_bare[open_top]]
    upright = nodes.height[bare[:, [0, 0, 1, 1]]]
    patch = nodes.patch[bare[:, 0]]
    return [
        _nodes(nodes, np.concatenate((flat, oriented(walls, flat)))),
        _quads(nodes.patch[level], np.repeat(nodes.height[level, None], 4, axis=1), _SQUARE),
        _quads(patch, upright, _ALONG_X),
        _quads(patch, upright, _ALONG_Y),
    ]


def _nodes(nodes: Nodes, triangles: Int64 | None = None) -> _Piece:
    """Return triangles (T, 3) with the nodes that they use; without triangles, all nodes."""
    if triangles is None:
        used = np.ones(len(nodes.patch), dtype=np.bool_)
        triangles = np.empty((0, 3), dtype=np.int64)
    else:
        used = np.zeros(len(nodes.patch), dtype=np.bool_)
        used[triangles] = True
    offset = np.zeros((np.count_nonzero(used), 2))
    if used.all():
        return _Piece(nodes.patch, nodes.height, offset, triangles)
    number = np.cumsum(used) - 1
    return _Piece(nodes.patch[used], nodes.height[used], offset, number[triangles])


def _quads(patch: Int64, height: Float64, offset: Float64) -> _Piece:
    """Return a quad for each patch (Q,): heights of corners (Q, 4), offsets of corners (4, 2)."""
    first = 4 * np.arange(len(patch))[:, None, None]
    return _Piece(
        np.repeat(patch, 4),
        height.ravel(),
        np.tile(offset, (len(patch), 1)),
        (first + _TWO_TRIANGLES).reshape(-1, 3),
    )


def _assemble(
    surface: SurfaceMap,
    paint: Paint,
    pieces: Sequence[_Piece],
    depths: Int64 | None = None,
    points: Int64 | None = None,
) -> Mesh:
    """Return the mesh of all pieces and the route.

    The lines `depths` (D, 2) and the `points` (N,) are indices of the first piece's vertices.
    """
    route, legs = route_on_ground(surface)
    sizes = [len(piece.patch) for piece in pieces]
    if sum(sizes) + len(route) > MAX_VERTICES:
        raise InputError(
            f"the mesh would have {sum(sizes) + len(route)} vertices; "
            f"at most {MAX_VERTICES} can be numbered: crop the map"
        )
    first = np.cumsum([0, *sizes])
    patch = np.concatenate([piece.patch for piece in pieces])
    height = np.concatenate([piece.height for piece in pieces])
    offset = np.concatenate([piece.offset for piece in pieces])
    # Counted in place, and narrowed as they are put together: there may be millions.
    triangles = np.concatenate(
        [piece.triangles for piece in pieces], dtype=np.int32, casting="unsafe"
    )
    ends = np.cumsum([len(piece.triangles) for piece in pieces])
    for n, begin, end in zip(first[1:-1].tolist(), ends[:-1], ends[1:], strict=True):
        triangles[begin:end] += np.int32(n)
    lift = np.array((0, 0, ROUTE_LIFT * surface.cell_size))
    vertices = np.empty((len(patch) + len(route), 3))
    with np.errstate(over="ignore", invalid="ignore"):
        for axis, index in enumerate((surface.ix, surface.iy)):
            placed = index[patch] + 0.5 + offset[:, axis]
            np.multiply(placed, surface.cell_size, out=vertices[: len(patch), axis])
        vertices[: len(patch), 2] = height
        vertices[len(patch) :] = route + lift
        vertices += 0.0
    if not np.isfinite(vertices).all():
        raise InputError(
            "the mesh reaches beyond float64: the map's heights or cells are too large"
        )
    origin = origin_at(surface, patch, height)
    lines = first[-1] + legs
    if depths is not None:
        lines = np.concatenate((depths, lines))
    return Mesh(
        vertices=vertices,
        colours=np.concatenate(
            (
                paint(surface, patch, height),
                np.tile(np.array(ROUTE_GREEN, dtype=np.uint8), (len(route), 1)),
            )
        ),
        origin=np.concatenate((origin, np.full(len(route), ROUTE, dtype=np.uint8))),
        triangles=triangles,
        lines=lines.astype(np.int32),
        points=(np.empty(0) if points is None else points).astype(np.int32),
        patch=np.concatenate((patch, np.full(len(route), NONE))).astype(np.int32),
    )
