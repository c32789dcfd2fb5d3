"""Points of a grid on every surface, and holes in the texture, where no feature is found."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mlscli.errors import UsageError
from mlscli.runtime.arrays import Bool, Float64, Int32
from mlscli.scenes.surfaces import Rectangle, Scene, Surface

MAX_POINTS = 200_000_000


@dataclass(frozen=True, eq=False)
class Samples:
    """Points on surfaces, without noise.

    Attributes
    ----------
    xyz : float64 (N, 3)
        Coordinates in the unit of the scene.
    surface : int32 (N,)
        Index of the surface of the scene that each point is on.
    texture : float64 (N,)
        Probability, 0 to 1, that a camera finds a feature at the point.
    """

    xyz: Float64
    surface: Int32
    texture: Float64


def sample(scene: Scene, spacing: float) -> Samples:
    """Return the points of a grid on every surface.

    The steps of the grid are at most `spacing` and divide the edges evenly; it begins half a step
    from each edge.

    Raises
    ------
    UsageError
        Where `spacing` is not above 0, or so small that the points are too many.
    """
    if not (math.isfinite(spacing) and spacing > 0):
        raise UsageError(f"`grid` {spacing:g}: expected a spacing above 0")
    counts = [_steps(surface, spacing) for surface in scene.surfaces]
    # As floats, as the whole number may be beyond them.
    total = sum(float(rows) * float(columns) for rows, columns in counts)
    if total > MAX_POINTS:
        raise UsageError(
            f"`grid` {spacing:g}: makes {total:.3g} points of {scene.name}, expected at most "
            f"{MAX_POINTS}; choose a wider spacing"
        )
    parts = [_grid(surface, *count) for surface, count in zip(scene.surfaces, counts, strict=True)]
    xyz = np.concatenate([points for points, _ in parts])
    texture = np.concatenate([chance for _, chance in parts])
    numbers = np.arange(len(parts), dtype=np.int32)
    return Samples(xyz, np.repeat(numbers, [len(points) for points, _ in parts]), texture)


def outside_holes(
    scene: Scene, xyz: Float64, count: int, diameter: float, rng: np.random.Generator
) -> Bool:
    """Return which points lie outside all holes in the texture, bool (N,).

    Parameters
    ----------
    scene : Scene
    xyz : float64 (N, 3)
        The points, in the unit of the scene.
    count : int
        How many holes there are: balls with centres uniform over the area of all surfaces.
    diameter : float
        Diameter of the balls, in the unit of the scene.
    rng : numpy.random.Generator
    """
    if not count:
        return np.ones(len(xyz), dtype=np.bool_)
    areas = np.array([math.hypot(*surface.normal) for surface in scene.surfaces])
    chosen = rng.choice(len(areas), size=count, p=areas / areas.sum())
    centres = [
        np.array(around.corner) + a * np.array(around.along) + b * np.array(around.across)
        for surface, (a, b) in zip(chosen, rng.random((count, 2)), strict=True)
        for around in [scene.surfaces[surface]]
    ]
    return outside_balls(xyz, np.array(centres), diameter)


def outside_balls(xyz: Float64, centres: Float64, diameter: float) -> Bool:
    """Return which points (N, 3) lie outside all balls with centres (M, 3), bool (N,)."""
    kept = np.ones(len(xyz), dtype=np.bool_)
    for centre in centres:
        near = np.flatnonzero((np.abs(xyz - centre) < diameter / 2).all(axis=1))
        inside = ((xyz[near] - centre) ** 2).sum(axis=1) < (diameter / 2) ** 2
        kept[near[inside]] = False
    return kept


def _steps(surface: Surface, spacing: float) -> tuple[int, int]:
    """Return how many points the grid of a surface has along its two edges."""
    along, across = (max(1, math.ceil(length / spacing - 1e-9)) for length in surface.lengths)
    return along, across


def _grid(surface: Surface, along: int, across: int) -> tuple[Float64, Float64]:
    """Return the points of a surface, (N, 3), and the texture at each, (N,)."""
    u = np.repeat((np.arange(along) + 0.5) / along, across)
    v = np.tile((np.arange(across) + 0.5) / across, along)
    open_ = _inside(surface, surface.openings, u, v)
    u, v = u[~open_], v[~open_]
    bare = _inside(surface, surface.textureless, u, v)
    corner, edge_u, edge_v = (
        np.array(vector) for vector in (surface.corner, surface.along, surface.across)
    )
    xyz = corner + u[:, None] * edge_u + v[:, None] * edge_v
    return xyz + 0.0, np.where(bare, 0.0, surface.texture)


def _inside(surface: Surface, parts: tuple[Rectangle, ...], u: Float64, v: Float64) -> Bool:
    """Return which points, given as shares u, v (N,) of the edges, lie in one of the parts."""
    length, width = surface.lengths
    a, b = u * length, v * width
    inside = np.zeros(len(u), dtype=np.bool_)
    for part in parts:
        inside |= (part.a_low < a) & (a < part.a_high) & (part.b_low < b) & (b < part.b_high)
    return inside
