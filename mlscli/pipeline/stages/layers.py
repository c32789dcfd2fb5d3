"""Layers of all points around a point: whether its own is much thinner than others, or a pole's.

The rule stands in `mlscli.pipeline.stages.median`, under `layer_share`. It leaves out poles over a
floor, which holds more points than their layers. Their ends have hardly any neighbours, or those of
dense ones so many that the nearest spread no farther in height than sideways, as on a floor. Poles
are told from outliers and floors by what stands beside them: nothing. A point is of a pole if

- of the points at most the thickness of a layer above or below it, three at least, itself counted,
  stand close about it, at horizontal distances of at most half of `level`, and no more than
  2,048 in its layer and two above and below;
- what stands close about it goes on, at any height, through two layers at least that follow its own
  without a gap, those above and below added up;
- half as many at most, and never more than 8, stand beside it, more than 1.5 times `level` away
  and at most the radius. Where the column goes on both above and below the point, those of its
  layer count, else those at most the thickness of a layer above or below it: so the foot of a pole
  may stand on a floor, and no outlier on a wall.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from mlscli.pipeline.stages.point_grid import PointGrid, between, corner, part
from mlscli.runtime.arrays import Int64
from mlscli.runtime.kernels import inner

# Layers this far above or below a point's own, and beyond, are one.
_FARTHEST_LAYER = 31
_LAYERS = 2 * _FARTHEST_LAYER + 1
# Close about a point of a pole, at most this share of `level` away, stand so many points at least;
# and no more in five layers: of more an end is plain, and to count all takes their square.
_CLOSE, _FEWEST, _MOST = 0.5, 3, 2048
# Beside it, so many times `level` away and more, stand so many at most, and at most this share of
# those close about it.
_WIDE, _MOST_BESIDE, _BESIDE = 1.5, 8, 0.5


@inner
def stands_out(
    grid: PointGrid, around: Int64, i: int, radius: float, level: float, least: float
) -> bool:
    """Return whether enough of all points around point i lie in its layer, or it is of a pole.

    Parameters
    ----------
    grid : PointGrid
    around : int64
        The point's column, and those that touch it.
    i : int
        Place of the point in the grid.
    radius : float
        Points at horizontal distances of at most this count.
    level : float
        Half the thickness of a layer.
    least : float
        The share of the mean layer that the point's own must hold.
    """
    return bool(
        _is_enough(grid, around, i, radius, level, least)
        or is_pole(grid, around, i, grid.xyz[i, 2], radius, level)
    )


@inner
def is_pole(grid: PointGrid, around: Int64, i: int, z: float, radius: float, level: float) -> bool:
    """Return whether point i, as if it were at height z, is of a pole.

    Parameters
    ----------
    grid, around, i, radius, level
        As in `stands_out`.
    z : float
        Where the point is taken to lie.
    """
    x, y = grid.xyz[i, 0], grid.xyz[i, 1]
    narrow = min(_CLOSE * level, radius)
    close, layers = _close_about(grid, around, (x, y, z), narrow, level)
    if not _FEWEST <= close <= _MOST:
        return False
    beside, level_with = _beside(grid, around, (x, y, z), _WIDE * level, radius, level)
    if level_with > min(_BESIDE * close, _MOST_BESIDE):
        return False
    alone = beside <= min(_BESIDE * close, _MOST_BESIDE)
    # Two above, two below, or one on each side.
    return bool(layers & 6 == 6 or (alone and (layers & 12 == 12 or layers & 3 == 3)))


@inner
def _close_about(
    grid: PointGrid,
    around: Int64,
    place: tuple[float, float, float],
    distance: float,
    level: float,
) -> tuple[int, int]:
    """Count what stands close about a place, at most the thickness of a layer above or below it.

    Returns
    -------
    close : int
        How many; more than `_MOST` where so many stand in its layer and the two above and below.
    layers : int
        Which of these hold any, as bits: the second below, the first below, the first above, the
        second above.
    """
    xyz, fine, side = grid.xyz, grid.fine, grid.side
    x, y, z = place
    # The margins outweigh rounding.
    far = distance + 1e-6 * side
    reach = 1.001 * (5.0 * level) + 1e-9 * abs(z)
    close = several = layers = 0
    for column in around:
        left, lower = corner(grid.keys[column], side)
        if abs(x - left - side / 2) > side / 2 + far or abs(y - lower - side / 2) > side / 2 + far:
            continue
        divisions = grid.divisions[column]
        lowest, highest = (
            part(y - far - lower, side, divisions),
            part(y + far - lower, side, divisions),
        )
        for ix in range(
            part(x - far - left, side, divisions), part(x + far - left, side, divisions) + 1
        ):
            row = grid.first[column] + ix * divisions
            for number in range(row + lowest, row + highest + 1):
                begin, end = between(xyz, fine[number], fine[number + 1], z - reach, z + reach)
                for j in range(begin, end):
                    dx, dy, above = xyz[j, 0] - x, xyz[j, 1] - y, xyz[j, 2] - z
                    if dx * dx + dy * dy <= distance * distance and abs(above) <= reach:
                        close += abs(above) <= 2.0 * level
                        layer = _layer(above, level)
                        if layer and abs(layer) <= 2:
                            layers |= 1 << int(layer + 2 - (layer > 0))
                        several += 1
                        if several > _MOST:
                            return _MOST + 1, layers
    return close, layers


@inner
def _beside(
    grid: PointGrid,
    around: Int64,
    place: tuple[float, float, float],
    nearest: float,
    radius: float,
    level: float,
) -> tuple[int, int]:
    """Count what stands beside a place, at most the thickness of a layer above or below it.

    Parameters
    ----------
    grid : PointGrid
    around : int64
        The place's column, in the middle, and those that touch it.
    place : (x, y, z)
    nearest, radius : float
        What lies farther away horizontally than the one, and no farther than the other, counts.
    level : float
        Half the thickness of a layer.

    Returns
    -------
    beside, level_with : int
        How many, and how many of them in its layer; fewer than there are, once these are too many.
    """
    xyz, fine, first = grid.xyz, grid.fine, grid.first
    x, y, z = place
    near = 1.001 * (2.0 * level) + 1e-9 * abs(z)
    farthest, wide = radius * radius, nearest * nearest
    beside = level_with = 0
    for k in range(len(around)):
        # The place's own column, in the middle, comes first: on a floor it is enough.
        column = around[(k + len(around) // 2) % len(around)]
        for number in range(first[column], first[column + 1]):
            begin, end = between(xyz, fine[number], fine[number + 1], z - near, z + near)
            for j in range(begin, end):
                if abs(xyz[j, 2] - z) <= 2.0 * level:
                    dx, dy = xyz[j, 0] - x, xyz[j, 1] - y
                    squared = dx * dx + dy * dy
                    is_beside = (wide < squared) & (squared <= farthest)
                    beside += is_beside
                    level_with += is_beside & (abs(xyz[j, 2] - z) <= level)
            if level_with > _MOST_BESIDE:
                return beside, level_with
    return beside, level_with


@inner
def _is_enough(
    grid: PointGrid, around: Int64, i: int, radius: float, level: float, least: float
) -> bool:
    """Return whether enough of all points around point i lie in its layer.

    Parameters
    ----------
    grid, around, i, radius, level, least
        As in `stands_out`.
    """
    xyz, fine, first = grid.xyz, grid.fine, grid.first
    x, y, z = xyz[i, 0], xyz[i, 1], xyz[i, 2]
    beside = 0
    # The margin outweighs rounding.
    near = 1.001 * level + 1e-9 * abs(z)
    for column in around:
        for number in range(first[column], first[column + 1]):
            begin, end = between(xyz, fine[number], fine[number + 1], z - near, z + near)
            for j in range(begin, end):
                above = xyz[j, 2] - z
                if abs(above) <= near and _layer(above, level) == 0:
                    dx, dy = xyz[j, 0] - x, xyz[j, 1] - y
                    beside += dx * dx + dy * dy <= radius * radius
    everything, occupied = 0, np.int64(0)
    for column in around:
        for number in range(first[column], first[column + 1]):
            for j in range(fine[number], fine[number + 1]):
                dx, dy = xyz[j, 0] - x, xyz[j, 1] - y
                if dx * dx + dy * dy <= radius * radius:
                    everything += 1
                    occupied |= np.int64(1) << (_layer(xyz[j, 2] - z, level) + _FARTHEST_LAYER)
                    # Even if there were something in every layer, this would be too much.
                    if beside * _LAYERS < least * everything:
                        return False
    layers = 0
    while occupied:
        occupied &= occupied - 1  # The lowest bit goes.
        layers += 1
    return bool(beside * layers >= least * everything)


@inner
def _layer(above: float, level: float) -> np.signedinteger[Any]:
    """Return the layer of what lies so far above a point."""
    layer = np.rint(above / (2.0 * level))
    return np.int64(min(max(layer, -_FARTHEST_LAYER), _FARTHEST_LAYER))
