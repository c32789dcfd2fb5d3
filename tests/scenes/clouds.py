"""Dense clouds made of random points on planes, for tests."""

from __future__ import annotations

import numpy as np

from mlscli.runtime.arrays import Float64

Range = tuple[float, float]


def level(count: int, x: Range, y: Range, z: float, seed: int = 1) -> Float64:
    """Return points on a level rectangle, (N, 3)."""
    rng = np.random.default_rng(seed)
    return np.column_stack((rng.uniform(*x, count), rng.uniform(*y, count), np.full(count, z)))


def upright(count: int, y: Range, z: Range, x: float, seed: int = 1) -> Float64:
    """Return points on an upright rectangle across the x axis, (N, 3)."""
    rng = np.random.default_rng(seed)
    return np.column_stack((np.full(count, x), rng.uniform(*y, count), rng.uniform(*z, count)))


def room(density: float, x: float, y: float, z: float) -> Float64:
    """Return points on the six sides of a box from the origin, so many on a unit of area."""
    floors = [level(int(density * x * y), (0, x), (0, y), h, seed=2) for h in (0.0, z)]
    walls = [upright(int(density * y * z), (0, y), (0, z), w, seed=3) for w in (0.0, x)]
    ends = [
        upright(int(density * x * z), (0, x), (0, z), w, seed=4)[:, [1, 0, 2]] for w in (0.0, y)
    ]
    return np.concatenate([*floors, *walls, *ends])
