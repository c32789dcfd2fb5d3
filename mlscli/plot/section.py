"""A map cut upright along a line: levels, depths, and the space between them."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from mlscli.errors import UsageError, expect
from mlscli.maps.surface_map import ARTIFICIAL, PLASTERED, SurfaceMap
from mlscli.mesh.colours import ARTIFICIAL_RED, ROUTE_GREEN, ColourBy, Paint, origin_colours
from mlscli.plot.above import (
    INK,
    add_colourbar,
    add_legend,
    as_colour,
    drawing_place,
    expect_drawing,
    route_of,
)
from mlscli.plot.cut import (
    Cut,
    Spaces,
    between_levels,
    cut,
    earth,
    in_words,
    narrowest,
    seen_through,
    stretches,
)
from mlscli.runtime.arrays import Float64

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.patches import Rectangle

# Positions of the craft are shown up to this many cells beside the cut.
ROUTE_WITHIN = 3

# Spaces at least this many cells long are labelled with their clearance.
LEAST_LABELLED = 3

_SPACE = "#dcebf5"
_EARTH = "#e4ded2"
_UNSEEN = "#c4c4c4"
_NARROWEST = "#b00050"
_WALL_ALPHA = 0.55


def plot_section(
    surface: SurfaceMap,
    start: tuple[float, float],
    end: tuple[float, float],
    *,
    colour: ColourBy = "height",
    artificial: bool = True,
    title: str = "",
    axes: Axes | None = None,
) -> Figure:
    """Return a picture of a map cut upright along a line.

    Patches are bars at their height, vertical ones filled down to their lower end. Each stretch
    between two levels is labelled with its clearance where that is least; the least of all is
    marked. Where the map knows free space, what was seen through is told from what never was, else
    the space between levels alone is tinted. What lies beneath the ground is shaded, but not what
    lies beneath a roof that is alone.

    Parameters
    ----------
    surface : SurfaceMap
        The map.
    start, end : tuple of float
        x and y of the line's ends, in the unit of the map.
    colour, artificial, title, axes
        As in `plot_above`.

    Returns
    -------
    matplotlib.figure.Figure
        As of `plot_above`.

    Raises
    ------
    UsageError
        As `cut`, and where the line meets no patch.
    """
    expect(surface, SurfaceMap, "surface", "a map (SurfaceMap)")
    for name, place in (("start", start), ("end", end)):
        expect(place, (tuple, list, np.ndarray), name, "x and y of an end of the line")
    expect_drawing(colour, title, axes)
    paint = Paint(surface, colour)
    if not artificial:
        surface = surface.take(surface.origin != ARTIFICIAL)
    met = cut(surface, start, end)
    if len(met.patch) == 0:
        raise UsageError(f"`section` {in_words(start, end)}: meets no patch of the map")
    low, high = surface.low_end[met.patch].min(), surface.height[met.patch].max()
    margin = max(0.08 * (high - low), 2 * surface.cell_size)
    length = math.dist(start, end)
    # One scale for both axes, unless the drawing would be too flat.
    exaggerated = (high - low + 2 * margin) / length < 0.12
    tall = 3.2 if exaggerated else min(8.5 * (high - low + 2 * margin) / length, 5.0)
    figure, axes, beneath = drawing_place(axes, 9.6, max(tall, 1.2) + 1.2)
    axes.set_ylim(low - margin, high + margin)
    axes.set_xlim(0, length)
    axes.set_aspect("auto" if exaggerated else "equal")
    drawn = [
        *_draw_space(axes, surface, met),
        *_draw_clearances(axes, surface, met),
        *_draw_patches(axes, surface, met, paint),
        *_draw_route(axes, surface, np.array(start), np.array(end)),
    ]
    axes.set_xlabel(
        f"along the cut from ({in_words(start, between=', ')}) to ({in_words(end, between=', ')})",
        fontsize=8,
        color=INK,
    )
    axes.set_ylabel("height" + (" (exaggerated)" if exaggerated else ""), fontsize=8, color=INK)
    axes.set_title(title, fontsize=10, color=INK)
    axes.tick_params(labelsize=8, colors=INK, length=3)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    add_legend(beneath, drawn)
    if colour != "height":
        add_colourbar(figure, axes, paint)
    return figure


def _draw_patches(axes: Axes, surface: SurfaceMap, met: Cut, paint: Paint) -> list[Artist]:
    """Draw patches as bars, and vertical ones as boxes down to their lower end, too."""
    from matplotlib.collections import LineCollection
    from matplotlib.patches import Patch

    patch = met.patch
    colours = paint(surface, patch, surface.height[patch]) / 255
    low, high = surface.low_end[patch], surface.height[patch]
    upright = low < high
    walls = Spaces(met.begin[upright], met.end[upright], low[upright], high[upright])
    _draw_boxes(axes, walls, facecolors="white", zorder=1.5)
    _draw_boxes(axes, walls, facecolors=colours[upright], alpha=_WALL_ALPHA, zorder=2)
    bars = np.stack((np.column_stack((met.begin, high)), np.column_stack((met.end, high))), axis=1)
    axes.add_collection(
        LineCollection(list(bars), colors=colours, linewidths=2.6, capstyle="butt", zorder=3)
    )
    if paint.by not in ("height", "origin"):
        return []
    plastered = tuple(origin_colours()[PLASTERED] / 255)
    kinds = (
        (ARTIFICIAL, as_colour(ARTIFICIAL_RED), "artificial"),
        (PLASTERED, plastered, "plastered"),
    )
    origins = surface.origin[patch]
    return [Patch(color=tint, label=name) for kind, tint, name in kinds if (origins == kind).any()]


def _draw_space(axes: Axes, surface: SurfaceMap, met: Cut) -> list[Artist]:
    """Tint what was seen through, or else the space between levels; shade what is beneath."""
    from matplotlib.patches import Patch

    bottom, top = axes.get_ylim()
    free, beneath = seen_through(surface, met), earth(surface, met, bottom)
    kinds: list[Artist] = []
    if free is None:
        _draw_boxes(axes, between_levels(surface, met), facecolors=_SPACE, zorder=1)
        kinds.append(Patch(color=_SPACE, label="between levels, seen or not"))
    else:
        unseen: dict[str, Any] = {
            "facecolor": "white",
            "edgecolor": _UNSEEN,
            "hatch": "////",
            "linewidth": 0,
        }
        axes.add_patch(_whole(axes.get_xlim(), (bottom, top), unseen))
        _draw_boxes(axes, free, facecolors=_SPACE, zorder=1)
        kinds += [Patch(color=_SPACE, label="seen through"), Patch(**unseen, label="never seen")]
    _draw_boxes(axes, beneath, facecolors=_EARTH, zorder=0.5)
    if len(beneath.begin):
        kinds.append(Patch(color=_EARTH, label="beneath the ground"))
    return kinds


def _whole(x: tuple[float, float], y: tuple[float, float], how: dict[str, Any]) -> Rectangle:
    """Return a rectangle as large as the drawing."""
    from matplotlib.patches import Rectangle

    return Rectangle((x[0], y[0]), x[1] - x[0], y[1] - y[0], zorder=0, **how)


def _draw_clearances(axes: Axes, surface: SurfaceMap, met: Cut) -> list[Artist]:
    """Label each stretch between two levels where it is narrowest; mark the narrowest of all."""
    from matplotlib.lines import Line2D

    spaces = between_levels(surface, met)
    least = LEAST_LABELLED * surface.cell_size
    runs = [run for run in stretches(spaces) if spaces.end[run[-1]] - spaces.begin[run[0]] >= least]
    found = sorted((narrowest(spaces, run) for run in runs), key=lambda one: one.high - one.low)
    for place, (along, low, high) in enumerate(found):
        tint = INK if place else _NARROWEST
        arrow = {"arrowstyle": "<->", "color": tint, "linewidth": 1 if place else 1.6}
        arrow |= {"shrinkA": 0, "shrinkB": 0}
        axes.annotate("", (along, low), xytext=(along, high), arrowprops=arrow, zorder=4)
        axes.annotate(
            f"{high - low:.3g}",
            (along, (low + high) / 2),
            xytext=(4, 0),
            textcoords="offset points",
            va="center",
            fontsize=8,
            color=tint,
            weight="normal" if place else "bold",
            zorder=4,
        )
    mark = Line2D([], [], color=_NARROWEST, linewidth=1.6, label="narrowest clearance")
    return [mark] if found else []


def _draw_boxes(axes: Axes, spaces: Spaces, **how: Any) -> None:
    """Draw spaces as boxes without an outline."""
    from matplotlib.collections import PolyCollection

    begin, end, low, high = spaces
    corners = ((begin, low), (end, low), (end, high), (begin, high))
    boxes = np.stack([np.column_stack(corner) for corner in corners], axis=1)
    axes.add_collection(PolyCollection(list(boxes), linewidths=0, **how))


def _draw_route(axes: Axes, surface: SurfaceMap, start: Float64, end: Float64) -> list[Artist]:
    """Draw the positions of the craft that are near the cut."""
    position = route_of(surface)
    along = (end - start) / np.linalg.norm(end - start)
    offset = position[:, :2] - start
    beside = np.abs(offset @ np.array((-along[1], along[0])))
    near = position[beside <= ROUTE_WITHIN * surface.cell_size]
    shown = axes.plot(
        (near[:, :2] - start) @ along,
        near[:, 2],
        linestyle="",
        marker="o",
        markersize=3.5,
        color=as_colour(ROUTE_GREEN),
        zorder=5,
        label="route",
    )
    return list(shown) if len(near) else []
