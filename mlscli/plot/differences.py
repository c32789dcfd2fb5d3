"""Two maps side by side and their differences in height, with rings (thesis, figure 6.9)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from scipy.ndimage import binary_dilation, find_objects, label

from mlscli.errors import UsageError, expect, expect_items
from mlscli.maps.surface_map import ARTIFICIAL, SurfaceMap
from mlscli.mesh.colours import ColourBy, Paint
from mlscli.plot.above import (
    INK,
    add_colourbar,
    add_legend,
    draw_above,
    expect_axes,
    expect_drawing,
    new_figure,
    size_of,
)
from mlscli.plot.relief import Frame, frame_of, shown_patches
from mlscli.runtime.arrays import Bool, Float64
from mlscli.scoring.comparison import matches, require_same_cells
from mlscli.words import some

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Patches whose heights differ by more cells than this get a ring; less cannot be seen in a picture.
TOLERANCE = 0.5

# Pixels with at most two between them share a ring; spots longer than this many pixels are cut into
# squares of this side, each with a ring of its own.
LARGEST_SPOT = 16

# More rings than this hide the maps that they are drawn on.
MOST_RINGS = 24

RING = "#d4006e"
_ONE_ALONE, _OTHER_ALONE = (0.0, 0.0, 0.0), (0.1, 0.6, 0.3)


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
    axes: Sequence[Axes] | None = None,
) -> Figure:
    """Return a picture of two maps of one grid from above, and of how much they differ.

    The third part shows by how much the other map is higher or lower, of several levels where that
    is most, and which cells have a patch that one map only has. A ring surrounds patches that only
    one map has, that differ by more than half a cell in height, or that are artificial in one map
    only; where there are more than `MOST_RINGS`, they are counted and not drawn.

    Parameters
    ----------
    one, other : SurfaceMap
        The maps.
    colour, artificial
        As in `plot_above`.
    titles : tuple of str
        The title above each map.
    axes : sequence of three matplotlib.axes.Axes, optional
        Draw there, the two maps and the difference, instead of in a figure of its own.

    Returns
    -------
    matplotlib.figure.Figure
        As of `plot_above`.

    Raises
    ------
    UsageError
        Where `axes` are not three, cell size or gap size differ, or neither map has patches.
    """
    for name, surface in (("one", one), ("other", other)):
        expect(surface, SurfaceMap, name, "a map (SurfaceMap)")
    expect_items(titles, "titles", "two texts")
    for title in titles:
        expect_drawing(colour, title, None)
    if axes is not None:
        expect_items(axes, "axes", "three axes of matplotlib")
        for each in axes:
            expect_axes(each)
    require_same_cells(one, other)
    paint = Paint(one if one.size else other, colour)
    if not artificial:
        one, other = (each.take(each.origin != ARTIFICIAL) for each in (one, other))
    frame = frame_of(one, other)
    circles = rings(differing(one, other, frame), frame)
    figure, parts = _three(frame) if axes is None else _given(axes)
    for part, surface, title in zip(parts, (one, other), titles, strict=False):
        draw_above(part, surface, shown_patches(surface, frame), frame, paint)
        part.set_title(title, fontsize=10, color=INK)
    _draw_differences(figure, parts[2], one, other, frame, titles)
    if len(circles) <= MOST_RINGS:
        for part in parts:
            _draw_rings(part, circles)
    said = f"{some(len(circles), 'place')} where the maps differ"
    if axes is None:
        figure.supxlabel(said, fontsize=9, color=RING if circles else INK)
    else:
        parts[2].set_xlabel(said, fontsize=9, color=RING if circles else INK)
    add_colourbar(figure, list(parts[:2]), paint)
    return figure


def _three(frame: Frame) -> tuple[Figure, Sequence[Axes]]:
    """Return a new figure with three axes, beside or above each other as fits the maps."""
    width, length = size_of(frame)
    beside = width <= 1.1 * length
    size = (2.5 * width + 2, 0.85 * length + 1) if beside else (width + 1.6, 3 * length + 1.4)
    figure = new_figure(*size)
    return figure, figure.subplots(*((1, 3) if beside else (3, 1)), sharex=True, sharey=True)


def _given(axes: Sequence[Axes]) -> tuple[Figure, Sequence[Axes]]:
    if len(axes) != 3:
        raise UsageError(
            f"`axes`: {len(axes)} are given; expected 3, two maps and their difference"
        )
    figure: Any = axes[0].get_figure(root=True)
    return figure, axes


def _draw_rings(axes: Axes, circles: list[Ring]) -> None:
    from matplotlib.patches import Circle

    for ring in circles:
        for line, edge in ((3.4, "white"), (1.8, RING)):
            axes.add_patch(
                Circle((ring.x, ring.y), ring.radius, fill=False, linewidth=line, edgecolor=edge,
                       zorder=7)
            )  # fmt: skip


def _draw_differences(
    figure: Figure,
    axes: Axes,
    one: SurfaceMap,
    other: SurfaceMap,
    frame: Frame,
    titles: tuple[str, str],
) -> None:
    """Draw by how much the other map is higher, and what one of them only has.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
    axes : matplotlib.axes.Axes
        The part of the figure to draw in.
    one, other : SurfaceMap
    frame : Frame
        The part of the plane that is shown.
    titles : tuple of str
        The names of the maps.
    """
    from matplotlib.patches import Patch

    found = changes(one, other, frame)
    there = np.isfinite(found.higher)
    size = np.abs(found.higher[there])
    # What cannot be seen on the maps is pale, and a few great differences do not pale the rest.
    most = max(float(np.percentile(size, 98)) if len(size) else 0.0, TOLERANCE * one.cell_size)
    image = axes.imshow(
        found.higher,
        extent=frame.extent,
        origin="lower",
        interpolation="nearest",
        cmap="RdBu_r",
        vmin=-most,
        vmax=most,
    )
    kinds = []
    names = [title or which for title, which in zip(titles, ("the one", "the other"), strict=True)]
    for alone, tint, name in zip(
        (found.in_one, found.in_other), (_ONE_ALONE, _OTHER_ALONE), names, strict=True
    ):
        if alone.any():
            pixels = np.zeros((*alone.shape, 4))
            pixels[alone] = (*tint, 1.0)
            axes.imshow(pixels, extent=frame.extent, origin="lower", interpolation="nearest")
            kinds.append(Patch(color=tint, label=f"in {name} only"))
    axes.set_facecolor("#eeeeea")
    axes.set_title("difference", fontsize=10, color=INK)
    axes.tick_params(labelsize=8, colors=INK, length=3)
    add_legend(axes, kinds)
    bar = figure.colorbar(image, ax=axes, shrink=0.75, aspect=28, pad=0.02, extend="both")
    bar.set_label(f"{names[1]} is higher by", fontsize=8, color=INK)
    bar.ax.tick_params(labelsize=8, colors=INK, length=3)
    bar.outline.set_linewidth(0)


class Changes(NamedTuple):
    """How two maps differ, pixel by pixel.

    Attributes
    ----------
    higher : float64 (length, width)
        By how much the other map is higher, where patches match, in the unit of the maps: of
        several the difference that is greatest in size; NaN where none match.
    in_one, in_other : bool (length, width)
        Which pixels hold a patch that only one of the maps has.
    """

    higher: Float64
    in_one: Bool
    in_other: Bool


def changes(one: SurfaceMap, other: SurfaceMap, frame: Frame) -> Changes:
    """Return how two maps of the same cells differ."""
    in_one, in_other = matches(one, other)
    higher = np.full((frame.length, frame.width), np.nan)
    by = other.height[in_other] - one.height[in_one]
    column, row, inside = (part[in_one] for part in frame.pixels(one))
    # The greatest come last and stay; of equal ones the same in any order.
    order = np.lexsort((by, np.abs(by)))
    order = order[inside[order]]
    higher[row[order], column[order]] = by[order]
    alone = []
    for surface, matched in ((one, in_one), (other, in_other)):
        column, row, inside = frame.pixels(surface)
        inside[matched] = False
        pixels = np.zeros(higher.shape, dtype=np.bool_)
        pixels[row[inside], column[inside]] = True
        alone.append(pixels)
    return Changes(higher, *alone)


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
