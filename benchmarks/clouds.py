"""The clouds that are measured with."""

from __future__ import annotations

import numpy as np

from mlscli.keyframes import Points

CELL = 0.15


def cloud(size: int, density: float) -> Points:
    """Return points of hills, so many a cell, a third on a level above, a tenth outliers."""
    rng = np.random.default_rng(1)
    xy = rng.uniform(0, np.sqrt(size / density) * CELL, (size, 2))
    z = 3 * np.sin(xy[:, 0] / 7) * np.cos(xy[:, 1] / 9) + rng.normal(0, CELL / 3, size)
    z += np.where(rng.random(size) < 0.3, 2.5, 0.0)
    z += np.where(rng.random(size) < 0.1, rng.normal(0, 5 * CELL / 3, size), 0.0)
    return Points(np.column_stack((xy, z)), np.zeros(size, dtype=np.int32))
