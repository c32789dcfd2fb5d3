"""`cell_size: auto`: the size of cells that suits a cloud."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mlscli.errors import InputError
from mlscli.runtime.arrays import Float64
from mlscli.runtime.threads import in_ranges

NEIGHBOUR = 4


def auto_cell_size(xyz: Float64, progress: Callable[[int], None] | None = None) -> float:
    """Return twice the median 3D distance of a point to its fourth nearest neighbour.

    Neither the order of the points nor the grid's symmetries change it, and outliers hardly
    move it.

    Parameters
    ----------
    xyz : float64 (N, 3)
        All points of the recording, before any filter.
    progress : callable, optional
        Called with the number of points done, now and then.

    Returns
    -------
    float
        In the unit of the recording, rounded to two significant digits.

    Raises
    ------
    InputError
        Where there are too few points, or most of them coincide.
    """
    from scipy.spatial import cKDTree

    if len(xyz) <= NEIGHBOUR:
        raise InputError(
            f"cell_size: auto needs more than {NEIGHBOUR} points, and there are {len(xyz)}; "
            "set map.cell_size to a number"
        )
    tree = cKDTree(xyz)

    def nearest(begin: int, end: int) -> Float64:
        # In the order of the tree, the points of a range lie close together: that halves the time.
        # scipy's own threads would outlive an interrupt.
        distances, _ = tree.query(xyz[tree.indices[begin:end]], k=[NEIGHBOUR + 1])
        return np.asarray(distances)

    distances = np.concatenate(in_ranges(len(xyz), nearest, progress))
    size = float(f"{2 * float(np.median(distances)):.1e}")
    if not size > 0:
        raise InputError(
            f"cell_size: auto finds that most points coincide with {NEIGHBOUR} others; if each "
            "message repeats the whole cloud, say `cumulative`, else set map.cell_size to a number"
        )
    return size
