"""A map cut upright along a line: levels, depths, and the space between them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from mlscli.errors import UsageError
from mlscli.maps.cells import on_grid, pack
from mlscli.maps.surface_map import ARTIFICIAL, SurfaceMap
from mlscli.mesh.colours import ROUTE_GREEN, ColourBy, Paint
from mlscli.plot.above import INK, add_colourbar, as_colour, new_figure, route_of
from mlscli.runtime.arrays import Float64, Int64

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# The cells of longer cuts would be narrower than a pixel.
MAX_SECTION_CELLS = 200_000

# Positions of the craft are shown up to this many cells beside the cut.
ROUTE_WITHIN = 3

# Spaces at least this many cells long are labelled with their clearance.
LEAST_LABELLED = 3

_SPACE = "#dcebf5"
_EARTH = "#efece6"
_WALL_ALPHA = 0.55


class Cut(NamedTuple):
    """The patches along a line, from its start on.

    Attributes
    ----------
    patch : int64 (S,)
        Indices of the patches; those of one cell follow one another from below.
    begin, end : float64 (S,)
        Distances along the line at which the patch's cell begins and ends, in the unit of the map.
    """

    patch: Int64
    begin: Float64
    end: Float64


def cut(surface: SurfaceMap, start: tuple[float, float], end: tuple[float, float]) -> Cut:
    """Return the patches in the cells that a line runs through.

    Parameters
    ----------
    surface : SurfaceMap
    start, end : tuple of float
        x and y of the line's ends, in the unit of the map.

    Raises
    ------
    UsageError
        Where the line has no length, leaves the grid, or runs through too many cells.
    """
    line = np.array([start, end], dtype=np.float64)
    length = math.dist(start, end)
    words = _in_words(start, end)
    if not 0 < length < math.inf or not on_grid(line, surface.cell_size).all():
        raise UsageError(f"`section` {words}: expected two different places on the grid")
    if length / surface.cell_size > MAX_SECTION_CELLS:
        raise UsageError(
            f"`section` {words}: runs through {length / surface.cell_size:.3g} cells; "
            f"expected at most {MAX_SECTION_CELLS}"
        )
    crossings = [np.array([0.0, 1.0])]
    for a, b in line.T / surface.cell_size:
        edges = np.arange(math.ceil(min(a, b)), math.floor(max(a, b)) + 1)
        crossings.append((edges - a) / (b - a) if a != b else np.empty(0))
    share = np.unique(np.clip(np.concatenate(crossings), 0, 1))
    middle = line[0] + (share[:-1, None] + share[1:, None]) / 2 * (line[1] - line[0])
    cell = np.floor(middle / surface.cell_size).astype(np.int32)
    ix, iy, first = surface.cells
    keys, sought = pack(ix, iy), pack(cell[:, 0], cell[:, 1])
    place = np.minimum(np.searchsorted(keys, sought), max(len(keys) - 1, 0))
    step = np.flatnonzero(keys[place] == sought) if len(keys) else np.empty(0, dtype=np.int64)
    count = first[place[step] + 1] - first[place[step]]
    column = np.repeat(step, count)
    within = np.arange(len(column)) - np.repeat(np.cumsum(count) - count, count)
    return Cut(first[place[column]] + within, share[column] * length, share[column + 1] * length)


def _in_words(*places: tuple[float, float], between: str = ",") -> str:
    """Return coordinates as text, with nine digits: those of UTM to the centimetre."""
    return between.join(f"{number:.9g}" for place in places for number in place)


def plot_section(
    surface: SurfaceMap,
    start: tuple[float, float],
    end: tuple[float, float],
    *,
    colour: ColourBy = "height",
    artificial: bool = True,
    title: str = "",
) -> Figure:
    """Return a picture of a map cut upright along a line.

    Patches are bars at their height, vertical ones filled down to their lower end. The space
    between two levels is tinted, and labelled with the clearance in the middle of each stretch.

    Parameters
    ----------
    surface : SurfaceMap
        The map.
    start, end : tuple of float
        x and y of the line's ends, in the unit of the map.
    colour, artificial, title
        As in `plot_above`.

    Raises
    ------
    UsageError
        As `cut`, and where the line meets no patch.
    """
    paint = Paint(surface, colour)
    if not artificial:
        surface = surface.take(surface.origin != ARTIFICIAL)
    met = cut(surface, start, end)
    if len(met.patch) == 0:
        raise UsageError(f"`section` {_in_words(start, end)}: meets no patch of the map")
    low, high = surface.low_end[met.patch].min(), surface.height[met.patch].max()
    margin = max(0.08 * (high - low), 2 * surface.cell_size)
    length = math.dist(start, end)
    # One scale for both axes, unless the drawing would be too flat.
    exaggerated = (high - low + 2 * margin) / length < 0.12
    tall = 3.2 if exaggerated else min(8.5 * (high - low + 2 * margin) / length, 5.0)
    figure = new_figure(9.6, max(tall, 1.2) + 1.2)
    axes = figure.add_subplot()
    axes.set_ylim(low - margin, high + margin)
    axes.set_xlim(0, length)
    axes.set_aspect("auto" if exaggerated else "equal")
    _draw_earth(axes, surface, met)
    _draw_space(axes, surface, met)
    _draw_patches(axes, surface, met, paint)
    _draw_route(axes, surface, np.array(start), np.array(end))
    axes.set_xlabel(
        f"along the cut from ({_in_words(start, between=', ')}) "
        f"to ({_in_words(end, between=', ')})",
        fontsize=8,
        color=INK,
    )
    axes.set_ylabel("height" + (" (exaggerated)" if exaggerated else ""), fontsize=8, color=INK)
    axes.set_title(title, fontsize=10, color=INK)
    axes.tick_params(labelsize=8, colors=INK, length=3)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    if colour != "height":
        add_colourbar(figure, axes, paint)
    return figure


def _draw_patches(axes: Axes, surface: SurfaceMap, met: Cut, paint: Paint) -> None:
    """Draw patches as bars, and vertical ones as boxes down to their lower end, too."""
    from matplotlib.collections import LineCollection, PolyCollection

    patch = met.patch
    colours = paint(surface, patch, surface.height[patch]) / 255
    low, high = surface.low_end[patch], surface.height[patch]
    upright = low < high
    boxes = _boxes(met.begin[upright], met.end[upright], low[upright], high[upright])
    axes.add_collection(
        PolyCollection(
            boxes, facecolors=colours[upright], alpha=_WALL_ALPHA, linewidths=0, zorder=2
        )
    )
    bars = np.stack((np.column_stack((met.begin, high)), np.column_stack((met.end, high))), axis=1)
    axes.add_collection(
        LineCollection(list(bars), colors=colours, linewidths=2.6, capstyle="butt", zorder=3)
    )


def _draw_space(axes: Axes, surface: SurfaceMap, met: Cut) -> None:
    """Tint the space between two levels; label each stretch with the clearance in its middle."""
    from matplotlib.collections import PolyCollection

    over = np.flatnonzero(met.begin[1:] == met.begin[:-1]) + 1
    floor, ceiling = surface.height[met.patch[over - 1]], surface.low_end[met.patch[over]]
    begin, end = met.begin[over], met.end[over]
    boxes = _boxes(begin, end, floor, ceiling)
    axes.add_collection(PolyCollection(boxes, facecolors=_SPACE, linewidths=0, zorder=1))
    for run in _stretches(begin, end, floor, ceiling):
        middle = run[len(run) // 2]
        if end[run[-1]] - begin[run[0]] < LEAST_LABELLED * surface.cell_size:
            continue
        x, low, high = begin[middle], floor[middle], ceiling[middle]
        arrow = {"arrowstyle": "<->", "color": INK, "linewidth": 0.8, "shrinkA": 0, "shrinkB": 0}
        axes.annotate("", (x, low), xytext=(x, high), arrowprops=arrow, zorder=4)
        axes.annotate(
            f"{high - low:.3g}",
            (x, (low + high) / 2),
            xytext=(4, 0),
            textcoords="offset points",
            va="center",
            fontsize=8,
            color=INK,
            zorder=4,
        )


def _draw_earth(axes: Axes, surface: SurfaceMap, met: Cut) -> None:
    """Shade what lies beneath the lowest patch of each cell."""
    from matplotlib.collections import PolyCollection

    lowest = np.append(True, met.begin[1:] != met.begin[:-1])
    ground = surface.low_end[met.patch[lowest]]
    bottom = np.full(len(ground), axes.get_ylim()[0])
    boxes = _boxes(met.begin[lowest], met.end[lowest], bottom, ground)
    axes.add_collection(PolyCollection(boxes, facecolors=_EARTH, linewidths=0, zorder=0))


def _boxes(begin: Float64, end: Float64, low: Float64, high: Float64) -> list[Float64]:
    """Return the corners of boxes in the plane of the cut, float64 (4, 2) each.

    Parameters
    ----------
    begin, end : float64 (N,)
        Distances along the line.
    low, high : float64 (N,)
        Heights.
    """
    corners = ((begin, low), (end, low), (end, high), (begin, high))
    return list(np.stack([np.column_stack(corner) for corner in corners], axis=1))


def _stretches(
    begin: Float64, end: Float64, floor: Float64, ceiling: Float64
) -> Iterator[list[int]]:
    """Yield stretches of spaces that open into one another: indices, in order along the cut.

    Parameters
    ----------
    begin, end : float64 (N,)
        Distances along the line at which each space begins and ends; `begin` ascends.
    floor, ceiling : float64 (N,)
        Heights of its ends.
    """
    open_runs: list[list[int]] = []
    for space in range(len(begin)):
        for run in [run for run in open_runs if end[run[-1]] < begin[space]]:
            open_runs.remove(run)
            yield run
        for run in open_runs:
            last = run[-1]
            overlap = min(ceiling[last], ceiling[space]) - max(floor[last], floor[space])
            if end[last] == begin[space] and overlap > 0:
                run.append(space)
                break
        else:
            open_runs.append([space])
    yield from open_runs


def _draw_route(axes: Axes, surface: SurfaceMap, start: Float64, end: Float64) -> None:
    """Draw the positions of the craft that are near the cut."""
    position = route_of(surface)
    along = (end - start) / np.linalg.norm(end - start)
    offset = position[:, :2] - start
    beside = np.abs(offset @ np.array((-along[1], along[0])))
    near = position[beside <= ROUTE_WITHIN * surface.cell_size]
    axes.plot(
        (near[:, :2] - start) @ along,
        near[:, 2],
        linestyle="",
        marker="o",
        markersize=3.5,
        color=as_colour(ROUTE_GREEN),
        zorder=5,
    )
