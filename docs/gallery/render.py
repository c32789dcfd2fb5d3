"""A mesh as a picture: a small renderer with parallel projection and a z-buffer.

Triangles are lit from above on both sides; at jumps in depth the nearer surface gets a thin dark
outline. Lines and points are drawn in front of the surfaces that they lie on.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from PIL import Image, ImageDraw

from mlscli.mesh import ROUTE, Mesh
from mlscli.plot.differences import RING
from mlscli.runtime.arrays import Float64, Int64, UInt8
from mlscli.runtime.kernels import kernel

FINER = 3
"""Pixels of the drawing along each side of a pixel of the picture."""

PAPER = 255
RADIUS = 11
_LIGHT = np.array((-0.45, -0.35, 0.82)) / np.linalg.norm((-0.45, -0.35, 0.82))


class View(NamedTuple):
    """The direction from which a mesh is seen.

    Attributes
    ----------
    azimuth : float
        Horizontal direction of view, in degrees from the x axis towards the y axis.
    elevation : float
        Angle of view below the horizontal, in degrees.
    """

    azimuth: float = 60.0
    elevation: float = 35.0

    def axes(self) -> Float64:
        """Return unit vectors to the right, up, and towards the viewer, float64 (3, 3)."""
        a, e = np.radians((self.azimuth, self.elevation))
        right = (np.sin(a), -np.cos(a), 0.0)
        towards = (-np.cos(a) * np.cos(e), -np.sin(a) * np.cos(e), np.sin(e))
        return np.array((right, np.cross(towards, right), towards))


def render(
    mesh: Mesh, width: int, view: View, most: int = 10_000, rings: Float64 | None = None
) -> UInt8:
    """Return a picture of a mesh, uint8 (height, width, 3).

    Parameters
    ----------
    mesh : Mesh
    width : int
        Width of the picture, in pixels.
    view : View
    most : int
        Greatest height of the picture, in pixels.
    rings : float64 (N, 3), optional
        Places in the map frame with a ring around them, drawn over all else.
    """
    seen = mesh.vertices @ view.axes().T
    low, high = seen.min(axis=0), seen.max(axis=0)
    margin = 4 * FINER
    scale = (FINER * width - 2 * margin) / (high[0] - low[0])
    scale = min(scale, (FINER * most - 2 * margin) / (high[1] - low[1]))
    height = int(np.ceil((scale * (high[1] - low[1]) + 2 * margin) / FINER))
    left = (FINER * width - scale * (high[0] - low[0])) / 2
    corner = np.array((low[0] - left / scale, high[1] + margin / scale, 0.0))
    flipped = np.array((scale, -scale, scale))
    place = (seen - corner) * flipped
    image = np.full((FINER * height, FINER * width, 3), float(PAPER))
    depth = np.full(image.shape[:2], -np.inf)
    a, b, c = np.moveaxis(mesh.vertices[mesh.triangles], 1, 0)
    normal = np.cross(b - a, c - a)
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
    normal *= np.where(normal @ view.axes()[2] < 0, -1, 1)[:, None]
    light = 0.5 + 0.5 * np.clip(normal @ _LIGHT, 0, 1) ** 0.8
    colours = mesh.colours.astype(np.float64)
    _fill(image, depth, place, mesh.triangles.astype(np.int64), colours, light)
    _outline(image, depth, 1.2 * FINER)
    is_route = (mesh.origin[mesh.lines] == ROUTE).all(axis=1)
    _stroke(image, depth, place, mesh.lines[~is_route].astype(np.int64), colours, 2, 1.0)
    _stroke(image, depth, place, mesh.lines[is_route].astype(np.int64), colours, FINER, 6.0 * FINER)
    spots = np.column_stack((mesh.points, mesh.points)).astype(np.int64)
    _stroke(image, depth, place, spots, colours, 2 * FINER - 1, 2.0)
    small = image.reshape(height, FINER, width, FINER, 3).mean(axis=(1, 3))
    picture: UInt8 = np.rint(small).astype(np.uint8)
    if rings is not None:
        picture = _ringed(picture, (rings @ view.axes().T - corner) * flipped / FINER)
    return picture


def _ringed(picture: UInt8, place: Float64) -> UInt8:
    """Draw rings around places (N, 3), whose first two columns are pixels of the picture."""
    image = Image.fromarray(picture)
    draw = ImageDraw.Draw(image)
    for x, y, _ in place.tolist():
        draw.ellipse((x - RADIUS, y - RADIUS, x + RADIUS, y + RADIUS), outline=RING, width=2)
    return np.asarray(image)


@kernel
def _fill(
    image: Float64,
    depth: Float64,
    place: Float64,
    triangles: Int64,
    colours: Float64,
    light: Float64,
) -> None:
    """Draw triangles, nearer ones over farther ones.

    Parameters
    ----------
    image : float64 (rows, columns, 3)
        The drawing, red, green, blue from 0 to 255; changed.
    depth : float64 (rows, columns)
        How near the thing drawn at each pixel is, in pixels, -inf: nothing; changed.
    place : float64 (V, 3)
        Column, row and nearness of each vertex, in pixels of the drawing.
    triangles : int64 (T, 3)
        Indices of vertices.
    colours : float64 (V, 3)
        Colours of vertices, 0 to 255.
    light : float64 (T,)
        Brightness of each triangle, 0 to 1.
    """
    rows, columns = depth.shape
    for t in range(len(triangles)):
        a, b, c = triangles[t]
        ax, ay, az = place[a]
        bx, by, bz = place[b]
        cx, cy, cz = place[c]
        double = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
        if abs(double) < 1e-9:
            continue
        for row in range(
            max(0, int(np.ceil(min(ay, by, cy)))), min(rows, int(max(ay, by, cy)) + 1)
        ):
            for column in range(
                max(0, int(np.ceil(min(ax, bx, cx)))), min(columns, int(max(ax, bx, cx)) + 1)
            ):
                v = ((column - ax) * (cy - ay) - (cx - ax) * (row - ay)) / double
                w = ((bx - ax) * (row - ay) - (column - ax) * (by - ay)) / double
                u = 1 - v - w
                if u < -1e-9 or v < -1e-9 or w < -1e-9:
                    continue
                z = u * az + v * bz + w * cz
                if z > depth[row, column]:
                    depth[row, column] = z
                    for k in range(3):
                        mixed = u * colours[a, k] + v * colours[b, k] + w * colours[c, k]
                        image[row, column, k] = mixed * light[t]


@kernel
def _outline(image: Float64, depth: Float64, jump: float) -> None:
    """Darken pixels that are nearer than one beside them by more than `jump`, in pixels."""
    rows, columns = depth.shape
    for row in range(1, rows - 1):
        for column in range(1, columns - 1):
            here = depth[row, column]
            if here == -np.inf:
                continue
            for dr, dc in ((0, 1), (0, -1), (1, 0), (-1, 0)):
                # A slope goes on to the other side; a jump does not.
                there, back = depth[row + dr, column + dc], depth[row - dr, column - dc]
                if here - there > jump and (back == -np.inf or here - there > 3 * abs(back - here)):
                    for k in range(3):
                        image[row, column, k] *= 0.45
                    break


@kernel
def _stroke(
    image: Float64,
    depth: Float64,
    place: Float64,
    lines: Int64,
    colours: Float64,
    width: int,
    bias: float,
) -> None:
    """Draw lines as chains of squares.

    Parameters
    ----------
    image, depth, place, colours
        As in `_fill`.
    lines : int64 (L, 2)
        Indices of vertices; a line has the colour of its first.
    width : int
        Side of the squares, in pixels of the drawing.
    bias : float
        Lines are hidden only by what is nearer by more than this, in pixels.
    """
    rows, columns = depth.shape
    for i in range(len(lines)):
        a, b = lines[i]
        steps = int(max(abs(place[b, 0] - place[a, 0]), abs(place[b, 1] - place[a, 1]))) + 1
        for step in range(steps + 1):
            share = step / steps
            x, y, z = place[a] + share * (place[b] - place[a])
            for row in range(int(y) - width // 2, int(y) - width // 2 + width):
                for column in range(int(x) - width // 2, int(x) - width // 2 + width):
                    if 0 <= row < rows and 0 <= column < columns and z + bias > depth[row, column]:
                        image[row, column] = colours[a]
                        depth[row, column] = max(depth[row, column], z)
