"""Two maps side by side, with rings around their differences (thesis, figure 6.9)."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.ndimage import binary_dilation, find_objects, label

from mlscli.maps.surface_map import ARTIFICIAL, SurfaceMap
from mlscli.mesh.colours import ColourBy, Paint
from mlscli.plot.above import INK, add_colourbar, draw_above, new_figure, size_of
from mlscli.plot.relief import Frame, frame_of, shown_patches
from mlscli.runtime.arrays import Bool
from mlscli.scoring.comparison import matches, require_same_cells
from mlscli.words import some

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Patches whose heights differ by more cells than this get a ring; less cannot be seen in a picture.
TOLERANCE = 0.5

# Pixels with at most two between them share a ring; spots longer than this many pixels are cut into
# squares of this side, each with a ring of its own.
LARGEST_SPOT = 16

RING = "#d4006e"


class Ring(NamedTuple):
    """A circle in the plane of the map.

    Attributes
    ----------
    x, y : float
        Its centre, in the unit of the map.
    radius : float
        In the unit of the map.
    """

    x: float
    y: float
    radius: float


def plot_differences(
    one: SurfaceMap,
    other: SurfaceMap,
    *,
    colour: ColourBy = "height",
    artificial: bool = True,
    titles: tuple[str, str] = ("", ""),
) -> Figure:
    """Return a picture of two maps of one grid from above, with rings where they differ.

    A ring surrounds patches that only one map has, that differ by more than half a cell in height,
    or that are artificial in one map only.

    Parameters
    ----------
    one, other : SurfaceMap
        The maps.
    colour, artificial
        As in `plot_above`.
    titles : tuple of str
        The title above each map.

    Raises
    ------
    UsageError
        Where cell size or gap size differ, or neither map has patches to show.
    """
    from matplotlib.patches import Circle

    require_same_cells(one, other)
    paint = Paint(one if one.size else other, colour)
    if not artificial:
        one, other = (each.take(each.origin != ARTIFICIAL) for each in (one, other))
    frame = frame_of(one, other)
    circles = rings(differing(one, other, frame), frame)
    width, length = size_of(frame)
    beside = width <= 1.6 * length
    size = (1.7 * width + 1.6, 0.85 * length + 1) if beside else (width + 1.6, 2 * length + 1.2)
    figure = new_figure(*size)
    axes = figure.subplots(*((1, 2) if beside else (2, 1)), sharex=True, sharey=True)
    for place, surface, title in zip(axes, (one, other), titles, strict=True):
        draw_above(place, surface, shown_patches(surface, frame), frame, paint)
        place.set_title(title, fontsize=10, color=INK)
        for ring in circles:
            for line, edge in ((3.4, "white"), (1.8, RING)):
                place.add_patch(
                    Circle((ring.x, ring.y), ring.radius, fill=False, linewidth=line,
                           edgecolor=edge, zorder=7)
                )  # fmt: skip
    said = f"{some(len(circles), 'place')} where the maps differ"
    figure.supxlabel(said, fontsize=9, color=RING if circles else INK)
    add_colourbar(figure, list(axes), paint)
    return figure


def differing(one: SurfaceMap, other: SurfaceMap, frame: Frame) -> Bool:
    """Return which pixels hold a patch that differs between the maps, bool (length, width)."""
    in_one, in_other = matches(one, other)
    apart = np.abs(one.height[in_one] - other.height[in_other]) > TOLERANCE * one.cell_size
    apart |= (one.origin[in_one] == ARTIFICIAL) != (other.origin[in_other] == ARTIFICIAL)
    found = np.zeros((frame.length, frame.width), dtype=np.bool_)
    for surface, matched in ((one, in_one), (other, in_other)):
        differs = np.ones(surface.size, dtype=np.bool_)
        differs[matched] = apart
        column, row, inside = frame.pixels(surface)
        differs &= inside
        found[row[differs], column[differs]] = True
    return found


def rings(found: Bool, frame: Frame) -> list[Ring]:
    """Return rings around groups of pixels; `found`, bool (length, width), says which pixels."""
    near = np.ones((3, 3), dtype=np.bool_)
    number, count = label(binary_dilation(found, near), near)
    number[~found] = 0
    tiles = np.indices(found.shape) // LARGEST_SPOT
    tile = tiles[0] * (found.shape[1] // LARGEST_SPOT + 1) + tiles[1]
    for part, place in enumerate(find_objects(number)):
        if place is not None and max(side.stop - side.start for side in place) > LARGEST_SPOT:
            own = number[place] == part + 1
            number[place][own] = count + 1 + tile[place][own]
            count += int(tile.max()) + 1
    west, _, south, _ = frame.extent
    pixel = frame.cells * frame.cell_size
    circles = []
    for place in find_objects(number):
        if place is None:
            continue
        rows, columns = place
        x, y = ((part.start + part.stop) / 2 for part in (columns, rows))
        half = np.hypot(columns.stop - columns.start, rows.stop - rows.start) / 2
        circles.append(Ring(west + x * pixel, south + y * pixel, float(half + 1.5) * pixel))
    return circles
