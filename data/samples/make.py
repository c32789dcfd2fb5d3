"""Make the sample flight `bridge.txt`: a creek, a bridge over it and a house, seen by a drone.

Run it as ``python data/samples/make.py``; it writes the same file beside itself every time. Points
lie on the surfaces of a simple scene, with noise, outliers in z, and places without texture. They
are grouped by the keyframe that saw them.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mlscli.runtime.arrays import Bool, Float64

SIGMA_XY, SIGMA_Z = 0.03, 0.04
OUTLIERS, OUTLIER_SIGMA = 0.04, 1.2
DENSITY = 16.0  # points per square metre
RANGE = 5.5  # how far a keyframe sees, horizontally, in metres

GROUND = (-10.0, 10.0, -7.0, 7.0)
CREEK, DEPTH = (-2.0, 2.0), 2.0
DECK = (-3.0, 3.0, -1.0, 1.0)
DECK_HEIGHT = 0.6
HOUSE = (4.5, 8.5, 1.5, 5.5)
EAVES = 2.6


def scattered(rng: np.random.Generator, area: tuple[float, float, float, float]) -> Float64:
    """Return points, float64 (N, 2), uniform over a rectangle (x0, x1, y0, y1)."""
    x0, x1, y0, y1 = area
    size = int(DENSITY * (x1 - x0) * (y1 - y0))
    return rng.uniform((x0, y0), (x1, y1), (size, 2))


def inside(xy: Float64, area: tuple[float, float, float, float]) -> Bool:
    x0, x1, y0, y1 = area
    return (xy[:, 0] > x0) & (xy[:, 0] < x1) & (xy[:, 1] > y0) & (xy[:, 1] < y1)


def wall(
    rng: np.random.Generator, begin: tuple[float, float], end: tuple[float, float], low: float,
    high: float,
) -> Float64:  # fmt: skip
    """Return points, float64 (N, 3), on a wall from (x, y) to (x, y), from `low` to `high`."""
    start, along = np.array(begin), np.subtract(end, begin)
    size = int(DENSITY * 1.5 * np.hypot(*along) * (high - low))
    xy = start + rng.uniform(0, 1, (size, 1)) * along
    return np.column_stack((xy, rng.uniform(low, high, size)))


def surfaces(rng: np.random.Generator) -> Float64:
    """Return points, float64 (N, 3), on all surfaces, without noise."""
    ground = scattered(rng, GROUND)
    ground = ground[~inside(ground, HOUSE)]
    in_creek = (ground[:, 0] > CREEK[0]) & (ground[:, 0] < CREEK[1])
    parts = [np.c_[ground, np.where(in_creek, -DEPTH, 0.0)]]
    deck = scattered(rng, DECK)
    parts.append(np.c_[deck, np.full(len(deck), DECK_HEIGHT)])
    roof = scattered(rng, HOUSE)
    # A part of the roof is white in the sun: it has no points.
    roof = roof[~inside(roof, (6.0, 7.2, 2.6, 4.4))]
    parts.append(np.c_[roof, np.full(len(roof), EAVES)])
    for x in CREEK:
        parts.append(wall(rng, (x, GROUND[2]), (x, GROUND[3]), -DEPTH, 0.0))
    x0, x1, y0, y1 = HOUSE
    corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
    for begin, end in zip(corners, corners[1:] + corners[:1], strict=True):
        parts.append(wall(rng, begin, end, 0.0, EAVES))
    return np.concatenate(parts)


def main() -> None:
    rng = np.random.default_rng(2010)
    points = surfaces(rng)
    # An area of even grass, without texture.
    points = points[~inside(points[:, :2], (-7.5, -6.4, -3.5, -2.3))]
    points += rng.normal(0, (SIGMA_XY, SIGMA_XY, SIGMA_Z), points.shape)
    outlier = rng.random(len(points)) < OUTLIERS
    points[outlier, 2] += rng.normal(0, OUTLIER_SIGMA, np.count_nonzero(outlier))

    legs = [(-4.5, 1.0), (0.0, -1.0), (4.5, 1.0)]
    route = np.array(
        [(x * way, y, 6.0) for y, way in legs for x in np.linspace(-9.0, 9.0, 10)]
    ) + rng.normal(0, 0.1, (30, 3))
    # A point belongs to the first keyframe that is near enough to see it.
    apart = np.hypot(*(points[:, None, :2] - route[None, :, :2]).transpose(2, 0, 1))
    first = np.argmax(apart < RANGE, axis=1)
    seen = apart.min(axis=1) < RANGE

    path = Path(__file__).with_name("bridge.txt")
    with path.open("w", encoding="ascii") as file:
        file.write("# A synthetic flight over a creek, a bridge and a house; see make.py.\n")
        file.write("x y z keyframe cx cy cz\n")
        for number, position in enumerate(route):
            for point in points[seen & (first == number)]:
                x, y, z = point
                cx, cy, cz = position
                file.write(f"{x:.3f} {y:.3f} {z:.3f} {number} {cx:.2f} {cy:.2f} {cz:.2f}\n")


if __name__ == "__main__":
    main()
