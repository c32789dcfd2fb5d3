"""A map seen from the side, from its middle on: what walls show that a view from above cannot.

As an architect's section does, it cuts the map upright through its middle and looks at all that
lies behind: to the north, or to the east where the map is longer from south to north. What is
nearer hides what is farther, and is darker.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from mlscli.maps.surface_map import ARTIFICIAL, SurfaceMap
from mlscli.plot.relief import Frame
from mlscli.runtime.arrays import Float64, UInt8

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MOSTLY_WALLS = 0.3
"""A map is mostly walls from this share of vertical patches on."""

# Pixels from the bottom to the top, at most.
_MAX_TALL = 1000
_NEAR: Float64 = np.array([30.0, 46.0, 84.0])
_FAR: Float64 = np.array([205.0, 214.0, 224.0])


class Side(NamedTuple):
    """A view from the side.

    Attributes
    ----------
    image : uint8 (tall, width, 4)
        RGBA, from the bottom up; transparent where nothing is seen.
    extent : tuple of float
        Its least and greatest x (or y) and z, in the unit of the map.
    across : str
        The axis that runs to the right: ``x`` or ``y``.
    along : str
        The axis that is looked along.
    middle : float
        Where the map is cut, on that axis.
    """

    image: UInt8
    extent: tuple[float, float, float, float]
    across: str
    along: str
    middle: float


def is_mostly_walls(surface: SurfaceMap) -> bool:
    """Return whether so many patches are vertical that a view from above says little."""
    return surface.size > 0 and bool(np.mean(surface.depth > 0) >= MOSTLY_WALLS)


def side_of(surface: SurfaceMap, frame: Frame, red: Float64) -> Side:
    """Return a map as it looks from its middle to the north, or to the east.

    Parameters
    ----------
    surface : SurfaceMap
        With patches in the frame.
    frame : Frame
        The part of the plane that is shown.
    red : float64 (3,)
        The colour of artificial patches, 0 to 255.
    """
    column, row, inside = frame.pixels(surface)
    north = frame.width >= frame.length
    right, away = (column, row) if north else (frame.length - 1 - row, column)
    wide, deep = (frame.width, frame.length) if north else (frame.length, frame.width)
    cut = int(np.median(away[inside]))
    seen = np.flatnonzero(inside & (away >= cut))
    right, away = right[seen], away[seen]
    low, high = surface.low_end[seen], surface.height[seen]
    bottom, top = float(low.min()), float(high.max())
    pixel = max(frame.cells * frame.cell_size, (top - bottom) / _MAX_TALL)
    first, last = (np.floor((end - bottom) / pixel).astype(np.int64) for end in (low, high))
    # The farthest are painted first.
    order = np.lexsort((seen, -away))
    rows = (last - first + 1)[order]
    patch = np.repeat(order, rows)
    up = np.arange(len(patch)) - np.repeat(np.cumsum(rows) - rows, rows) + first[patch]
    share = ((away - cut) / max(deep - cut, 1))[:, None]
    colours = _NEAR + (_FAR - _NEAR) * share
    colours[surface.origin[seen] == ARTIFICIAL] = red
    image = np.zeros((int(last.max()) + 1, wide, 4), dtype=np.uint8)
    image[up, right[patch], :3] = np.rint(colours[patch])
    image[up, right[patch], 3] = 255
    west, east, south, north_end = frame.extent
    side = frame.cells * frame.cell_size
    across, middle = (
        ((west, east), south + cut * side) if north else ((north_end, south), west + cut * side)
    )
    extent = (*across, bottom, bottom + len(image) * pixel)
    return Side(image, extent, *(("x", "y") if north else ("y", "x")), middle)


def draw_side(axes: Axes, side: Side, ink: str) -> None:
    """Draw a view from the side, and say from where it is."""
    axes.imshow(side.image, extent=side.extent, origin="lower", interpolation="nearest", zorder=1)
    axes.set_facecolor("#eeeeea")
    axes.set_aspect("equal")
    axes.ticklabel_format(style="plain", useOffset=False)
    axes.tick_params(labelsize=8, colors=ink, length=3)
    towards = "north" if side.along == "y" else "east"
    axes.set_title(
        f"from the side: from the middle, {side.along} {side.middle:.2f}, to the {towards}; "
        "darker is nearer",
        fontsize=9,
        color=ink,
    )
    axes.set_ylabel("height", fontsize=8, color=ink)
    for spine in axes.spines.values():
        spine.set_color("#999999")
