"""A map from above: shaded relief, the route, a scale bar."""

from __future__ import annotations

import math
from collections.abc import Sequence
from numbers import Integral
from types import NoneType
from typing import TYPE_CHECKING, Any

import numpy as np

from mlscli.errors import UsageError, expect
from mlscli.maps.surface_map import ARTIFICIAL, MEASURED, PLASTERED, SurfaceMap
from mlscli.mesh.colours import (
    COLOURS,
    ROUTE_GREEN,
    ColourBy,
    Paint,
    height_scale,
    origin_at,
    origin_colours,
)
from mlscli.plot.relief import SOFT_RED, Frame, frame_of, picture, shown_patches
from mlscli.plot.side import draw_side, is_mostly_walls, side_of
from mlscli.runtime.arrays import Float64, Int64

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PAPER = "#ffffff"
INK = "#222222"

# Fewer pixels together get no dotted line.
LEAST_OUTLINED = 6

# Inches along the longer side of the drawing.
LONGER_SIDE = 7.5


def plot_above(
    surface: SurfaceMap,
    *,
    level: int | None = None,
    colour: ColourBy = "height",
    artificial: bool = True,
    title: str = "",
    axes: Axes | None = None,
) -> Figure:
    """Return a picture of a map from above.

    Beneath it, a map that is mostly walls is seen from the side, too: see `mlscli.plot.side`.

    Parameters
    ----------
    surface : SurfaceMap
        The map.
    level : int, optional
        Which patch of each cell is shown, counted from 1 from below; by default the highest. A
        dotted line runs around cells with another patch beneath the one shown.
    colour : str
        What colours stand for, as in meshes.
    artificial : bool
        Whether artificial patches are shown.
    title : str
        The title above the picture.
    axes : matplotlib.axes.Axes, optional
        Draw there, instead of in a figure of its own, and nothing from the side.

    Returns
    -------
    matplotlib.figure.Figure
        The figure that it is drawn in; notebooks show it.

    Raises
    ------
    UsageError
        Where the map has no patches to show, or no cell has as many levels.
    """
    expect(surface, SurfaceMap, "surface", "a map (SurfaceMap)")
    expect(level, (Integral, NoneType), "level", "a whole number")
    expect_drawing(colour, title, axes)
    paint = Paint(surface, colour)
    if not artificial:
        surface = surface.take(surface.origin != ARTIFICIAL)
    frame = frame_of(surface)
    shown = shown_patches(surface, frame, level)
    if not (shown >= 0).any():
        most = int(np.diff(surface.cells.start).max())
        raise UsageError(f"`level` {level}: no cell has as many; this map has up to {most}")
    width, length = size_of(frame)
    if axes is None and level is None and is_mostly_walls(surface):
        side = side_of(surface, frame, SOFT_RED)
        left, right, low, high = side.extent
        tall = float(np.clip((high - low) / abs(right - left) * width, 1.0, 5.0))
        figure = new_figure(width + 1.9, length + tall + 1.9)
        axes, below = figure.subplots(2, 1, height_ratios=(length, tall))
        draw_side(below, side, INK)
        beneath: Figure | Axes = figure
    else:
        figure, axes, beneath = drawing_place(axes, width + 1.9, length + 1.3)
    draw_above(axes, surface, shown, frame, paint)
    axes.set_title(title, fontsize=10, color=INK)
    add_legend(beneath, _kinds(surface, shown, frame, paint))
    add_colourbar(figure, axes, paint)
    return figure


def expect_drawing(colour: object, title: object, axes: object) -> None:
    """Refuse what is no colouring, no title, or no axes of matplotlib; see `expect`."""
    expect(colour, str, "colour", f"one of {', '.join(COLOURS)}")
    expect(title, str, "title", "a text")
    expect_axes(axes)


def expect_axes(axes: object) -> None:
    """Refuse what is neither axes of matplotlib nor None; see `expect`."""
    if axes is not None:
        from matplotlib.axes import Axes

        expect(axes, Axes, "axes", "axes of matplotlib (Axes)")


def drawing_place(
    axes: Axes | None, width: float, length: float
) -> tuple[Figure, Axes, Figure | Axes]:
    """Return where to draw: the figure, the axes, and beneath what a legend goes.

    Parameters
    ----------
    axes : matplotlib.axes.Axes or None
        What the caller wants it drawn in; None: in a new figure.
    width, length : float
        The size of a new figure, in inches.
    """
    if axes is None:
        figure = new_figure(width, length)
        return figure, figure.add_subplot(), figure
    within: Any = axes.get_figure(root=True)
    return within, axes, axes


def size_of(frame: Frame) -> tuple[float, float]:
    """Return width and length of the drawing of a frame, in inches."""
    west, east, south, north = frame.extent
    side = LONGER_SIDE / max(east - west, north - south)
    return max((east - west) * side, 2.5), max((north - south) * side, 2.0)


def new_figure(width: float, length: float) -> Figure:
    """Return an empty figure of a size in inches, with a little padding."""
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    from mlscli.plot.picture import Picture

    layout = ConstrainedLayoutEngine(h_pad=0.1, w_pad=0.1)
    return Picture(figsize=(width, length), facecolor=PAPER, layout=layout)


def draw_above(axes: Axes, surface: SurfaceMap, shown: Int64, frame: Frame, paint: Paint) -> None:
    """Draw the patches shown, the route over them, and a scale bar.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    surface : SurfaceMap
    shown : int64 (length, width)
        The patch that each pixel shows, as `shown_patches` returns it.
    frame : Frame
    paint : Paint
        Gives patches their colours.
    """
    extent = frame.extent
    image = picture(surface, shown, frame, paint)
    axes.imshow(image, extent=extent, origin="lower", interpolation="nearest", zorder=1)
    axes.set_facecolor("#eeeeea")
    _draw_beneath(axes, surface, shown, frame)
    position = route_of(surface)
    axes.plot(position[:, 0], position[:, 1], color="white", linewidth=2.6, zorder=3)
    axes.plot(position[:, 0], position[:, 1], color=as_colour(ROUTE_GREEN), linewidth=1.5, zorder=4)
    axes.set_xlim(extent[0], extent[1])
    axes.set_ylim(extent[2], extent[3])
    axes.set_aspect("equal")
    # Coordinates of a survey in full, not as what is to be added to a number in the corner.
    axes.ticklabel_format(style="plain", useOffset=False)
    axes.tick_params(labelsize=8, colors=INK, length=3)
    for spine in axes.spines.values():
        spine.set_color("#999999")
    _add_scale_bar(axes, extent)


def route_of(surface: SurfaceMap) -> Float64:
    """Return the known positions of the craft, float64 (K, 3)."""
    position = surface.route[:, 1:]
    return position[np.isfinite(position).all(axis=1)]


def as_colour(rgb: tuple[int, int, int]) -> tuple[float, float, float]:
    """Return a colour, 0 to 255 for each channel, as matplotlib takes it, 0 to 1."""
    return rgb[0] / 255, rgb[1] / 255, rgb[2] / 255


def add_colourbar(figure: Figure, axes: Axes | list[Axes], paint: Paint) -> None:
    """Add a colour bar, where colours stand for a range of values."""
    if paint.scale is None or not paint.scale.high > paint.scale.low:
        return
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import ListedColormap, Normalize

    colours = ScalarMappable(
        Normalize(paint.scale.low, paint.scale.high), ListedColormap(height_scale() / 255)
    )
    bar = figure.colorbar(colours, ax=axes, shrink=0.75, aspect=28, pad=0.02)
    bar.set_label(paint.scale.label, fontsize=8, color=INK)
    bar.ax.tick_params(labelsize=8, colors=INK, length=3)
    bar.outline.set_linewidth(0)


def _draw_beneath(axes: Axes, surface: SurfaceMap, shown: Int64, frame: Frame) -> None:
    """Draw a dotted line around the pixels whose patch has another one beneath it.

    Around `LEAST_OUTLINED` of them and more, that is: around single cells of ragged maps dots would
    hide more than they tell.
    """
    from matplotlib.collections import LineCollection
    from scipy.ndimage import label

    first = np.repeat(surface.cells.start[:-1], np.diff(surface.cells.start))
    over = (shown >= 0) & (shown > np.append(first, 0)[shown])
    part, _ = label(over, np.ones((3, 3)))
    over &= np.bincount(part.ravel())[part] >= LEAST_OUTLINED
    padded = np.pad(over, 1)
    west, east, south, north = frame.extent
    x = np.linspace(west, east, frame.width + 1)
    y = np.linspace(south, north, frame.length + 1)
    row, column = np.nonzero(padded[1:-1, 1:] != padded[1:-1, :-1])
    upright = np.column_stack((x[column], y[row], x[column], y[row + 1]))
    row, column = np.nonzero(padded[1:, 1:-1] != padded[:-1, 1:-1])
    level = np.column_stack((x[column], y[row], x[column + 1], y[row]))
    segments = list(np.concatenate((upright, level)).reshape(-1, 2, 2))
    axes.add_collection(
        LineCollection(segments, colors=INK, linewidths=0.8, linestyles=(0, (1, 1.2)), zorder=2)
    )


def _add_scale_bar(axes: Axes, extent: tuple[float, float, float, float]) -> None:
    """Add a bar of a round length, at most a quarter of the width."""
    from matplotlib import patheffects

    west, east, south, north = extent
    length = round_length((east - west) / 4)
    x = west + (east - west) * 0.04
    y = south + (north - south) * 0.045
    halo = [patheffects.withStroke(linewidth=3, foreground="white")]
    axes.plot(
        [x, x + length], [y, y], color=INK, linewidth=3, solid_capstyle="butt", zorder=6,
        path_effects=[patheffects.withStroke(linewidth=5.5, foreground="white")],
    )  # fmt: skip
    axes.annotate(
        f"{length:g}",
        (x + length / 2, y),
        xytext=(0, 4),
        textcoords="offset points",
        ha="center",
        va="bottom",
        fontsize=8,
        color=INK,
        path_effects=halo,
        zorder=6,
    )


def round_length(most: float) -> float:
    """Return the greatest number up to `most`, above 0, of 1, 2 or 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(most))
    return max(power * digit for digit in (1, 2, 5) if power * digit <= most * (1 + 1e-9))


def add_legend(place: Figure | Axes, kinds: Sequence[Artist]) -> None:
    """Add a legend beneath a picture, or a part of it, of what is to be seen there, if anything."""
    from matplotlib.axes import Axes
    from matplotlib.transforms import ScaledTranslation

    beneath: dict[str, Any] = {"loc": "outside lower center"}
    if isinstance(place, Axes):
        # Under the numbers and the words of the axis, however high the axes are.
        points = 32 if place.get_xlabel() else 18
        figure: Any = place.get_figure(root=True)
        down = ScaledTranslation(0, -points / 72, figure.dpi_scale_trans)
        beneath = {
            "loc": "upper center",
            "bbox_to_anchor": (0.5, 0),
            "bbox_transform": place.transAxes + down,
            "borderaxespad": 0,
        }
    if kinds:
        place.legend(
            handles=list(kinds),
            **beneath,
            ncols=3 if isinstance(place, Axes) else 5,
            fontsize=8,
            frameon=False,
            labelcolor=INK,
            handlelength=1.4,
            columnspacing=1.2,
        )


def _kinds(surface: SurfaceMap, shown: Int64, frame: Frame, paint: Paint) -> list[Artist]:
    """Return examples of origins, route and dotted lines, as far as the picture has them."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    patch = shown[shown >= 0]
    origins = set(origin_at(surface, patch, surface.height[patch]).tolist())
    measured, plastered, _ = (tuple(colour / 255) for colour in origin_colours())
    kinds: list[Artist] = []
    if paint.by == "origin" and MEASURED in origins:
        kinds.append(Patch(color=measured, label="measured"))
    if PLASTERED in origins and paint.by in ("height", "origin"):
        paler = 0.5 if paint.by == "height" else 1.0
        pale = tuple((1 - paler) * np.array(measured) + paler * np.array(plastered))
        kinds.append(Patch(color=pale, label="plastered"))
    if ARTIFICIAL in origins and paint.by != "region":
        kinds.append(Patch(color=tuple(SOFT_RED / 255), label="artificial"))
    west, east, south, north = frame.extent
    x, y, _ = route_of(surface).T
    if ((west <= x) & (x <= east) & (south <= y) & (y <= north)).any():
        kinds.append(Line2D([], [], color=as_colour(ROUTE_GREEN), linewidth=2, label="route"))
    if np.diff(surface.cells.start).max(initial=0) > 1:
        dots = Line2D([], [], color=INK, linewidth=1, linestyle=(0, (1, 1.2)))
        dots.set_label("another level beneath")
        kinds.append(dots)
    return kinds
