"""A yard that looks like no other place, and not the same from two sides, as points and as maps."""

from __future__ import annotations

import numpy as np

from mlscli.building.builder import MapBuilder
from mlscli.config import load
from mlscli.geometry.similarity import Similarity
from mlscli.keyframes.keyframe import Keyframe
from mlscli.maps.surface_map import SurfaceMap
from mlscli.runtime.arrays import Float64

# Corners of rectangles along the axes, low and high: a floor, walls, a block, and a deck.
YARD = (
    ((0, 0, 0), (12, 9, 0)),
    ((0, 0, 0), (0, 9, 2.5)),
    ((0, 9, 0), (7, 9, 2.5)),
    ((8, 2, 0), (8, 3.5, 1.5)),
    ((8, 2, 1.5), (10.5, 3.5, 1.5)),
    ((3, 5, 3.2), (6, 8, 3.2)),
)
CELL = 0.4


def cloud(seed: int = 1, sides: tuple[float, float] = (0, 12), parts: object = YARD) -> Float64:
    """Return points on the yard, (N, 3), 20 in each square of unit side, with x between `sides`."""
    rng = np.random.default_rng(seed)
    points = []
    for low, high in np.array(parts, dtype=np.float64):
        spans = np.sort(high - low)[1:]
        inside = rng.uniform(low, high, (int(20 * spans.prod()), 3))
        points.append(inside + rng.normal(0, 0.01, inside.shape))
    together = np.concatenate(points)
    chosen: Float64 = together[(together[:, 0] >= sides[0]) & (together[:, 0] <= sides[1])]
    return chosen


def map_of_points(points: Float64, cell_size: float = CELL) -> SurfaceMap:
    """Return the map of points, without filters, in cells of this size."""
    builder = MapBuilder(load("plain").with_cell_size(cell_size))
    builder.add(Keyframe(points))
    return builder.finish()


def off(fit: Similarity, true: Similarity, points: Float64) -> float:
    """Return how far a fit takes points from where they belong, at most."""
    return float(np.linalg.norm(fit.points(points) - true.points(points), axis=1).max())
