"""A map seen from above: which patch each pixel shows, and its colour in the light.

A pixel is a cell, or a square of cells where a map has more than a picture can show; it shows the
highest patch in them. Light falls from the north-west, at 45 degrees: slopes are shaded, and higher
patches throw shadows, so that decks, roofs and walls stand out.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mlscli.errors import UsageError
from mlscli.maps.surface_map import ARTIFICIAL, PLASTERED, SurfaceMap
from mlscli.mesh.colours import Paint, height_colours, origin_at
from mlscli.runtime.arrays import Bool, Float64, Int64, UInt8

# Pixels along the longer side, at most.
MAX_SIDE = 2000

# Shadows are shorter than this many pixels.
LONGEST_SHADOW = 12

# The red of artificial patches among many others.
SOFT_RED: Float64 = np.array([232.0, 120.0, 126.0])

_SHADING, _SHADOW = 0.6, 0.72


class Frame(NamedTuple):
    """The part of the plane that a picture shows.

    Attributes
    ----------
    ix, iy : int
        Least indices of its cells.
    width, length : int
        Pixels along x and y.
    cells : int
        Cells along each side of a pixel.
    cell_size : float
        In the unit of the map.
    """

    ix: int
    iy: int
    width: int
    length: int
    cells: int
    cell_size: float

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """The least and greatest x, and the least and greatest y, in the unit of the map."""
        pixel = self.cells * self.cell_size
        west, south = self.ix * self.cell_size, self.iy * self.cell_size
        return west, west + self.width * pixel, south, south + self.length * pixel

    def pixels(self, surface: SurfaceMap) -> tuple[Int64, Int64, Bool]:
        """Return the pixel of each patch.

        Returns
        -------
        column, row : int64 (P,)
        inside : bool (P,)
            Whether the pixel is in the picture.
        """
        column = (surface.ix.astype(np.int64) - self.ix) // self.cells
        row = (surface.iy.astype(np.int64) - self.iy) // self.cells
        inside = (column >= 0) & (column < self.width) & (row >= 0) & (row < self.length)
        return column, row, inside


def frame_of(*surfaces: SurfaceMap) -> Frame:
    """Return the part of the plane that shows maps of one grid.

    It holds all patches, unless these extend along an axis to more than four times the range that
    holds the middle 98 % of them: then it holds this range and a margin, so that a few stray
    patches do not shrink the rest to a point.

    Raises
    ------
    UsageError
        Where no map has patches.
    """
    bounds = []
    for name in ("ix", "iy"):
        index = np.concatenate([getattr(surface, name) for surface in surfaces]).astype(np.int64)
        if len(index) == 0:
            raise UsageError("the map has no patches to show")
        low, high = int(index.min()), int(index.max()) + 1
        near, far = (int(i) for i in np.percentile(index, (1, 99), method="nearest"))
        if high - low > 4 * (far + 1 - near) + 20:
            margin = (far + 1 - near) // 10 + 2
            low, high = max(low, near - margin), min(high, far + 1 + margin)
        bounds.append((low, high))
    (west, east), (south, north) = bounds
    cells = -(-max(east - west, north - south) // MAX_SIDE)
    width, length = (-(-side // cells) for side in (east - west, north - south))
    return Frame(west, south, width, length, cells, surfaces[0].cell_size)


def shown_patches(surface: SurfaceMap, frame: Frame, level: int | None = None) -> Int64:
    """Return the index of the patch that each pixel shows, int64 (length, width); -1: none.

    Parameters
    ----------
    surface : SurfaceMap
        The map.
    frame : Frame
        The part of the plane that is shown.
    level : int, optional
        Which patch of each cell is shown, counted from 1 from below; by default the highest.
    """
    chosen = np.arange(surface.size)
    if level is not None:
        start = surface.cells.start
        chosen = start[:-1][np.diff(start) >= level] + level - 1
    column, row, inside = frame.pixels(surface)
    chosen = chosen[inside[chosen]]
    # Ascending, so that the highest comes last and stays.
    chosen = chosen[np.argsort(surface.height[chosen], kind="stable")]
    shown = np.full((frame.length, frame.width), -1, dtype=np.int64)
    shown[row[chosen], column[chosen]] = chosen
    return shown


def picture(surface: SurfaceMap, shown: Int64, frame: Frame, paint: Paint) -> UInt8:
    """Return the picture, RGBA, uint8 (length, width, 4); transparent where no patch is shown.

    Parameters
    ----------
    surface : SurfaceMap
    shown : int64 (length, width)
        The patch that each pixel shows, as `shown_patches` returns it.
    frame : Frame
    paint : Paint
        Gives patches their colours.
    """
    there = shown >= 0
    patch = shown[there]
    height = np.full(shown.shape, np.nan)
    height[there] = surface.height[patch]
    pixel = frame.cells * frame.cell_size
    light = _light(height, pixel)[there]
    # Of what stands upright the top is seen, which has no slope that light could show.
    light[surface.depth[patch] > 0] = 1.0
    colours = np.zeros((*shown.shape, 4), dtype=np.uint8)
    lit = softened(paint, surface, patch) * light[:, None]
    colours[there, :3] = np.clip(np.rint(lit), 0, 255)
    colours[there, 3] = 255
    return colours


def softened(paint: Paint, surface: SurfaceMap, patch: Int64) -> Float64:
    """Return the colours of patches, float64 (N, 3), with inserted ones less loud than in meshes.

    A mesh has few of them in sight; from above, ragged maps would be all red and specks.
    """
    height = surface.height[patch]
    colours = paint(surface, patch, height).astype(np.float64)
    if paint.by == "region":
        return colours
    origin = origin_at(surface, patch, height)
    colours[origin == ARTIFICIAL] = SOFT_RED
    if paint.by == "height" and paint.scale is not None:
        plastered = origin == PLASTERED
        full = height_colours(height[plastered], paint.scale.low, paint.scale.high)
        colours[plastered] = (colours[plastered] + full) / 2
    return colours


def _light(height: Float64, pixel: float) -> Float64:
    """Return the brightness of each pixel, (length, width); 1 for a level one outside shadows.

    Parameters
    ----------
    height : float64 (length, width)
        NaN where no patch is shown.
    pixel : float
        Side of a pixel, in the unit of the map.
    """
    east, north = _slope(height, pixel, 1), _slope(height, pixel, 0)
    # The light comes from (-1, 1, sqrt(2)) / 2; a level surface has the cosine 1 / sqrt(2).
    cosine = (east - north + np.sqrt(2)) / 2 / np.sqrt(1 + east**2 + north**2)
    light: Float64 = 1 + _SHADING * (np.clip(cosine, 0, None) * np.sqrt(2) - 1)
    shadow = np.zeros(height.shape, dtype=np.bool_)
    for step in range(1, min(LONGEST_SHADOW, *height.shape)):
        caster, ground = height[step:, :-step], height[:-step, step:]
        shadow[:-step, step:] |= caster - ground > step * pixel * np.sqrt(2)
    light[shadow] *= _SHADOW
    return light


def _slope(height: Float64, pixel: float, axis: int) -> Float64:
    """Return the slope of heights (length, width) along an axis; 0 where it is not known."""
    step = np.diff(height, axis=axis) / pixel
    nothing = np.full_like(np.take(height, [0], axis=axis), np.nan)
    both = np.stack(
        (
            np.concatenate((nothing, step), axis=axis),
            np.concatenate((step, nothing), axis=axis),
        )
    )
    known = np.isfinite(both)
    total = np.where(known, np.clip(both, -2, 2), 0).sum(axis=0)
    slope: Float64 = total / np.maximum(known.sum(axis=0), 1)
    return slope
