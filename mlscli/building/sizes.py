"""`cell_size: auto` and `gap_size: auto`: the lengths of a map that suit a recording.

A cell is twice as wide as points usually lie from their fourth neighbour. What a sensor saw again
and again, from the same place or on another pass, does not shrink it:

- equal points count once;
- where one keyframe alone seems to cover more than twice what all cover together (its points times
  the square of their distance), the keyframes saw the same points again, a little off: the distance
  is that of a usual keyframe;
- where points lie in clusters, far apart beside their width, it is that of the clusters.

Where points spread farther across surfaces than such a cell can hold, and no stage moves them along
their rays, it is made wider, until it holds them.

What tells levels apart depends on walls: see `mlscli.building.gap_size`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import NoneType
from typing import Any

import numpy as np

from mlscli.building.gap_size import REACH, roughness_of, two_digits, with_gap_size
from mlscli.errors import InputError, expect, expect_items
from mlscli.geometry.roughness import Roughness, roughness
from mlscli.geometry.spacing import (
    NEIGHBOUR,
    Neighbourhoods,
    Spacing,
    of_one_look,
    spacing,
    without_clusters,
)
from mlscli.keyframes.keyframe import Keyframe, require_points
from mlscli.pipeline.parameters import AUTO, Parameters
from mlscli.runtime.arrays import Array, Float64
from mlscli.words import some

# The scene is what lies between these shares of the points, in x and in y.
_OUTSIDE = 0.01
# A map of so many cells along its longer side shows nothing of so many points, and a gap so many
# times as high as the vehicle hides what it could fly through.
_FEW_CELLS, _MANY_POINTS, _MANY_TIMES = 2, 100, 3.0
# Cells are coarse beyond this share of the scene's longer side.
_COARSE = 0.1
# So are steps of coordinates beyond this share of a cell.
_COARSE_STEP = 0.1
# And the scene has too many of them beyond this number.
_MOST_CELLS = 1e8
# Noise that is even over a cell has a standard deviation of 1 / sqrt(12) of it. A little more of it
# than that leaves nothing of the cell's own.
_MOST_NOISE = 1.3
# Cells widen by such steps until they are as wide as what noise spreads over, where floors hardly
# ever turn into walls any more. What so many times the width does not hold is no surface.
_WIDER, _WIDEST = 1.2, 5.0


@dataclass(frozen=True)
class FittedSizes:
    """Parameters whose sizes suit a recording.

    Attributes
    ----------
    parameters : Parameters
        With numbers for what was ``auto``.
    reasons : dict of str to str
        Why `cell_size` and `gap_size` were chosen, a line each; without those that were given.
    doubts : list of str
        Where a size is beyond reason, a line each.
    """

    parameters: Parameters
    reasons: dict[str, str]
    doubts: list[str]


def fit_sizes(
    clouds: Array | Iterable[Keyframe],
    parameters: Parameters | None = None,
    progress: Callable[[int], None] | None = None,
) -> FittedSizes:
    """Choose the sizes of a map that are ``auto``, by the points that it will be made of.

    Neither the order of the points nor the grid's symmetries change them.

    Parameters
    ----------
    clouds : iterable of Keyframe, or array (N, 3)
        All points of the recording, before any filter: its keyframes, or points without any.
    parameters : Parameters, optional
        By default ``Parameters()``.
    progress : callable, optional
        Called with the number of points done, now and then.

    Returns
    -------
    FittedSizes

    Raises
    ------
    TypeError
        Where an argument is of a wrong type.
    InputError
        Where there are too few distinct points.
    ConfigError
        Where a size contradicts the other parameters.

    Examples
    --------
    >>> import mlscli
    >>> import numpy as np
    >>> points = np.random.default_rng(1).uniform(0, 4, (2000, 3)) * (1, 1, 0.1)
    >>> fitted = mlscli.fit_sizes(points)
    >>> fitted.parameters.map.cell_size
    0.22
    """
    parameters = Parameters() if parameters is None else parameters
    expect(parameters, Parameters, "parameters", "Parameters")
    expect(progress, (Callable, NoneType), "progress", "a function")
    looks = _looks(clouds)
    if not parameters.lacks_sizes:
        return FittedSizes(parameters, {}, [])
    if isinstance(size := parameters.map.cell_size, int | float):
        settled, why = with_gap_size(parameters, size, roughness_of(looks, size))
        return FittedSizes(settled, {"gap_size": why}, [])
    whole = np.concatenate(looks) if looks else np.empty((0, 3))
    sides = _sides(whole)
    found, why = _distance(whole, looks, progress)
    del whole
    cell_size = two_digits(2 * found.distance)
    rough = roughness(found.cloud, REACH * cell_size)
    reason = f"auto: twice the usual distance of a point to its fourth {why}"
    doubts = []
    if _too_rough(cell_size, rough) and not parameters.moves_along_rays:
        held = _holding_noise(found.cloud, cell_size, _COARSE * sides[0])
        if held is not None:
            finer, (cell_size, rough) = cell_size, held
            usual = f"{finer:g}, {reason.removeprefix('auto: ')}, would be finer"
            reason = f"auto: as wide as noise spreads across surfaces; {usual}"
            doubts.append(f"{_finer(finer, rough)}; {cell_size:g} is taken")
    reasons = {"cell_size": reason}
    settled = parameters.with_cell_size(cell_size)
    if parameters.map.gap_size == AUTO:
        settled, reasons["gap_size"] = with_gap_size(parameters, cell_size, rough)
    return FittedSizes(settled, reasons, [*doubts, *_doubts(cell_size, rough, sides)])


def given_size_doubts(
    described: Mapping[str, Any], vehicle_height: float, step: float = 0.0
) -> list[str]:
    """Return what is doubtful of sizes that were given, now that the map is there.

    Parameters
    ----------
    described : mapping
        The map, as `mlscli.maps.summary.describe` has it, its ``sizes``, the reasons for those that
        were found, and its ``points``.
    vehicle_height : float
        In the unit of the map.
    step : float
        To how much the coordinates of points were rounded.
    """
    doubts = []
    size, gap = described["cell_size"], described["gap_size"]
    sides = [high - low for low, high in (described["extent"][axis] for axis in "xy")]
    few = max(sides) <= _FEW_CELLS * size and described["points"]["kept"] >= _MANY_POINTS
    if few and "cell_size" not in described["sizes"]:
        doubts.append(
            f"map.cell_size {size:g}: all of the map lies in {some(described['cells'], 'cell')}; "
            "sizes are in the unit of the recording, and auto finds one that suits"
        )
    if step > _COARSE_STEP * size:
        doubts.append(
            f"map.cell_size {size:g}: a coordinate lies on steps of {step:g}, as float32 has them "
            "so far from 0; its digits are lost: store doubles, or coordinates nearer to 0"
        )
    if gap > _MANY_TIMES * vehicle_height:
        doubts.append(
            f"map.gap_size {gap:g}: is more than {_MANY_TIMES:g} times the height of the vehicle, "
            f"{vehicle_height:g}; levels that it could fly between become one"
        )
    return doubts


def auto_cell_size(xyz: Float64) -> float:
    """Return the size of cells that suits points by how far apart they lie; see `fit_sizes`.

    Parameters
    ----------
    xyz : float64 (N, 3)
        All points of a recording, before any filter.

    Returns
    -------
    float
        In the unit of the recording, rounded to two significant digits.

    Raises
    ------
    InputError
        Where there are too few distinct points.
    """
    found, _ = _distance(xyz.copy(), [xyz], None)
    return two_digits(2 * found.distance)


def _looks(clouds: Array | Iterable[Keyframe]) -> list[Float64]:
    """Return the points of each keyframe; points without keyframes are one."""
    if isinstance(clouds, np.ndarray):
        require_points(clouds, "clouds")
        points = np.asarray(clouds, dtype=np.float64)
        return [points[np.isfinite(points).all(axis=1)]]
    expected = "keyframes, or points as an array (N, 3)"
    expect_items(clouds, "clouds", expected)
    looks = []
    for keyframe in clouds:
        expect(keyframe, Keyframe, "clouds", expected)
        looks.append(keyframe.points)
    return looks


def _distance(
    whole: Float64, looks: Sequence[Float64], progress: Callable[[int], None] | None
) -> tuple[Spacing, str]:
    """Return how far apart what is distinct lies, and of what that is the distance, in words."""
    found = spacing(whole, progress)
    if found is None:
        raise InputError(
            f"cell_size: auto needs more than {NEIGHBOUR} distinct points, and there are "
            f"{len(np.unique(whole, axis=0))}; set map.cell_size to a number"
        )
    words = ["neighbour"]
    equal = len(whole) - len(found.cloud.points)
    if equal:
        words.append(f"without {some(equal, 'point')} that equal others")
    if (one := of_one_look(found, looks)) is not None:
        found = one
        words.append("in one keyframe, as they see the same again")
    clusters = without_clusters(found, _COARSE * _sides(whole)[0] / 2)
    if clusters is not found:
        words.append(f"where {len(clusters.cloud.points):,} clusters of points count as one each")
    return clusters, ", ".join(words)


def _even(rough: Roughness) -> float:
    """Return over how much noise spreads across surfaces, if it does so evenly."""
    return 12**0.5 * rough.noise


def _too_rough(cell_size: float, rough: Roughness) -> bool:
    return _even(rough) > _MOST_NOISE * cell_size


def _finer(cell_size: float, rough: Roughness) -> str:
    return (
        f"cell_size: auto: {cell_size:g} is finer than the noise of the points, which spread over "
        f"{_even(rough):.2g} across surfaces"
    )


def _holding_noise(
    cloud: Neighbourhoods, cell_size: float, widest: float
) -> tuple[float, Roughness] | None:
    """Return the first wider cells that noise does not spread beyond, and the noise; else None.

    The wider the cells, the fewer of the points are asked: else the nearest neighbours of a point
    would all lie with it in the midst of the noise, and show little of it.

    Parameters
    ----------
    cloud : Neighbourhoods
    cell_size : float
        That is finer than the noise.
    widest : float
        The widest cells that are believed, in the unit of the recording.
    """
    points, wider = cloud.points, two_digits(_WIDER * cell_size)
    while wider <= min(widest, _WIDEST * cell_size):
        # As many lie in a cube of such cells as did in one of the finer ones.
        size = max(int(len(points) * (cell_size / wider) ** 3), 1)
        asked = Neighbourhoods(points[cloud.some(size)], is_distinct=True)
        rough = roughness(asked, REACH * wider)
        if 0 < _even(rough) <= wider:
            return wider, rough
        wider = two_digits(_WIDER * wider)
    return None


def _sides(points: Float64) -> tuple[float, float]:
    """Return how long and how wide the scene is, in x or in y, without its outermost points."""
    outside = int(_OUTSIDE * len(points))
    last = len(points) - 1 - outside
    if last < outside:
        return 0.0, 0.0
    x, y = (np.partition(axis, [outside, last]) for axis in points.T[:2])
    length, width = sorted((float(axis[last] - axis[outside]) for axis in (x, y)), reverse=True)
    return length, width


def _doubts(cell_size: float, rough: Roughness, sides: tuple[float, float]) -> Iterator[str]:
    """Yield where a size of cells is beyond reason, and what would be right.

    Parameters
    ----------
    cell_size : float
    rough : Roughness
        Of the surfaces.
    sides : tuple of float
        Those of the scene, the longer first.
    """
    if _too_rough(cell_size, rough):
        least = _even(rough) / _MOST_NOISE
        yield f"{_finer(cell_size, rough)}; set map.cell_size to {least:.2g} or more"
    length, width = sides
    scene = f"a scene of {length:.4g} by {width:.4g}"
    cells = (length / cell_size + 1) * (width / cell_size + 1)
    if cells > _MOST_CELLS:
        fit = (length * width / _MOST_CELLS) ** 0.5
        yield (
            f"cell_size: auto: {cell_size:g} makes {cells:.2g} cells of {scene}; crop it, or set "
            f"map.cell_size to {fit:.2g} or more"
        )
    if cell_size > _COARSE * length:
        yield (
            f"cell_size: auto: {cell_size:g} is coarse for {scene}, whose points lie far apart; "
            f"set map.cell_size to {_COARSE * length:.2g} or less"
        )
