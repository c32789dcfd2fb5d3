"""`cell_size: auto`: how large the cells should be for a cloud."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mlscli.errors import InputError
from mlscli.threads import in_ranges
from mlscli.typing import Bool, Float64

NEIGHBOUR = 4


def auto_cell_size(xyz: Float64, told: Callable[[int], None] | None = None) -> float:
    """Return twice the median 3D distance of a point to its fourth nearest neighbour.

    Neither the order of the points nor the grid's symmetries change it, and outliers hardly
    move it. It has two significant digits.

    Parameters
    ----------
    xyz : float64 (N, 3)
        All points of the recording, before any filter.
    told : callable, optional
        Called with how many of them are done, now and then.

    Raises
    ------
    InputError
        Where there are too few points, or most of them coincide.
    """
    require_enough(len(xyz))
    return cell_size_for(float(np.median(neighbour_distances(xyz, told=told))))


def require_enough(points: int) -> None:
    """Refuse a cloud in which no point has a fourth neighbour."""
    if points <= NEIGHBOUR:
        raise InputError(
            f"cell_size: auto needs more than {NEIGHBOUR} points, and there are {points}; "
            "set map.cell_size to a number"
        )


def cell_size_for(distance: float) -> float:
    """Return the size of cells where this is the median distance to a fourth neighbour."""
    size = float(f"{2 * distance:.1e}")
    if not size > 0:
        raise InputError(
            f"cell_size: auto finds that most points coincide with {NEIGHBOUR} others; if each "
            "message repeats the whole cloud, say --cumulative, else set map.cell_size to a number"
        )
    return size


def neighbour_distances(
    xyz: Float64, which: Bool | None = None, told: Callable[[int], None] | None = None
) -> Float64:
    """Return the distance of each point to its fourth nearest neighbour, in any order.

    Parameters
    ----------
    xyz : float64 (N, 3)
    which : bool (N,), optional
        Of these points only; all count as neighbours.
    told : callable, optional
        Called with how many are done, now and then.

    Returns
    -------
    float64
        Infinite where there are not so many others.
    """
    from scipy.spatial import cKDTree

    tree = cKDTree(xyz)
    # In the order of the tree, points of a range lie together: that halves the time.
    order = tree.indices if which is None else tree.indices[which[tree.indices]]

    def nearest(begin: int, end: int) -> Float64:
        # Threads of scipy's own would outlive an interrupt.
        distances, _ = tree.query(xyz[order[begin:end]], k=[NEIGHBOUR + 1])
        return np.asarray(distances).ravel()

    return np.concatenate(in_ranges(len(order), nearest, told))
