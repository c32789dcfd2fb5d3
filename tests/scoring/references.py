"""The definitions of the scores as plain loops over patches: slow, and obvious to read."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np

from mlscli.maps.surface_map import SurfaceMap
from mlscli.runtime.arrays import Float64
from tests.helpers.maps import GAP, Patch, apart, map_of, patches_of


def altered(rng: np.random.Generator, surface: SurfaceMap) -> SurfaceMap:
    """Return a map like another, with patches moved, stretched, renamed, gone and new.

    Heights in coarse steps stay so, and limits are met exactly; others meet none but by rounding,
    on which the rules may differ, and so they are moved by odd lengths.
    """
    coarse = not np.any(surface.height * 4 % 1)
    patches = []
    for patch in patches_of(surface):
        if rng.random() < 0.1:
            continue
        steps = [0, 0, 0.25, -0.25, 0.125, 1] if coarse else [0, rng.normal(0, 0.2), 1.01]
        height = patch.height + rng.choice(steps)
        depth = max(0.0, patch.depth + rng.choice([0, 0, 0.5, -0.5, -5]))
        origin = int(rng.choice([patch.origin, patch.origin, 0, 1, 2]))
        ix, iy = patch.cell + rng.choice([0, 0, 0, 0, 1, -1, 2], 2)
        count = 0 if origin else max(patch.count, 1)
        patches.append(Patch(int(ix), int(iy), float(height), float(depth), origin, count))
        if rng.random() < 0.2:
            above = rng.choice([0, 0.5, 1]) if coarse else rng.uniform(0, 1)
            patches.append(patches[-1]._replace(height=float(height + above)))
    return map_of(patches)


# --- statistics ---


def root_mean_square(values: Sequence[float]) -> float | None:
    return math.sqrt(math.fsum(v * v for v in values) / len(values)) if values else None


def percentile_95(values: Sequence[float]) -> float | None:
    """Return the value that 95 % do not exceed, on a straight line between the two at that."""
    if not values:
        return None
    ascending = sorted(map(abs, values))
    place = 0.95 * (len(values) - 1)
    lower = math.floor(place)
    upper = min(lower + 1, len(values) - 1)
    return ascending[lower] + (place - lower) * (ascending[upper] - ascending[lower])


# --- two maps ---


def pairs(a: list[Patch], b: list[Patch], farthest: float = GAP) -> list[tuple[int, int]]:
    """Return the patches that match: the nearest two (equal: the higher), then of the rest."""
    candidates = [
        (abs(one.height - two.height), -one.height, -two.height, -i, -j)
        for i, one in enumerate(a)
        for j, two in enumerate(b)
        if one.cell == two.cell and abs(one.height - two.height) <= farthest
    ]
    in_a: set[int] = set()
    in_b: set[int] = set()
    result = []
    for *_, minus_i, minus_j in sorted(candidates):
        i, j = int(-minus_i), int(-minus_j)
        if i not in in_a and j not in in_b:
            in_a.add(i)
            in_b.add(j)
            result.append((i, j))
    return sorted(result)


# --- a map against the truth ---


def on_a_surface(patch: Patch, surfaces: list[Patch], half: float) -> bool:
    """Tell whether a patch lies within half a cell of the surfaces, a vertical one all of it."""
    if patch.depth == 0:
        return any(apart(patch, surface) <= half for surface in surfaces)
    joined: list[list[float]] = []
    for low, high in sorted((s.low - half, s.height + half) for s in surfaces):
        if joined and low <= joined[-1][1]:
            joined[-1][1] = max(joined[-1][1], high)
        else:
            joined.append([low, high])
    return any(low <= patch.low and patch.height <= high for low, high in joined)


def found(true: Patch, patches: list[Patch], half: float) -> bool:
    return on_a_surface(true, [p for p in patches if p.cell == true.cell], half)


def correct(patch: Patch, truth: list[Patch], half: float) -> bool:
    around = [
        true for true in truth if abs(true.ix - patch.ix) <= 1 and abs(true.iy - patch.iy) <= 1
    ]
    return on_a_surface(patch, around, half)


def place(patch: Patch, truth: list[Patch], margin: float) -> str:
    """Say where a phantom closing stands, by what is true in its cell."""
    here = sorted((t for t in truth if t.cell == patch.cell), key=lambda t: t.height)
    if not here and _is_inside(patch, truth):
        return "in_hole"
    for lower, upper in pairwise(here):
        begin = max(patch.low, lower.height + margin)
        end = min(patch.height, upper.low - margin)
        # A flat patch is a point, which lies strictly inside; another reaches in with some length.
        inside = begin == end and begin not in (lower.height + margin, upper.low - margin)
        if begin < end or (patch.depth == 0 and inside):
            return "in_window" if lower.depth > 0 and upper.depth > 0 else "under_deck"
    return "off_level" if any(apart(patch, t) <= margin for t in here) else "elsewhere"


def _is_inside(patch: Patch, truth: list[Patch]) -> bool:
    """Tell whether true cells lie on all four sides of a patch, however far."""
    row = [t.ix for t in truth if t.iy == patch.iy]
    column = [t.iy for t in truth if t.ix == patch.ix]
    return all(
        any(sign * other < sign * mine for other in others)
        for mine, others in ((patch.ix, row), (patch.iy, column))
        for sign in (1, -1)
    )


def nearest(true: Patch, patches: list[Patch], half: float) -> Patch | None:
    """Return the nearest patch of the cell within half; equal: the higher, then the later."""
    near = [p for p in reversed(patches) if p.cell == true.cell and apart(p, true) <= half]
    return min(near, key=lambda p: (apart(p, true), -p.height), default=None)


def height_errors(truth: list[Patch], patches: list[Patch], half: float) -> list[float]:
    errors = []
    for true in truth:
        match = nearest(true, [p for p in patches if p.depth == 0], half)
        if true.depth == 0 and match is not None:
            errors.append(match.height - true.height)
    return errors


def called_vertical(true: Patch, patches: list[Patch], half: float) -> bool:
    match = nearest(true, patches, half)
    return match is not None and match.depth > 0


def share(chosen: Callable[[Patch], bool], patches: list[Patch]) -> tuple[int, int]:
    """Return how many of the patches are chosen, and how many there are."""
    return sum(map(chosen, patches)), len(patches)


# --- a scan ---


def squared_distance(one: Sequence[float], other: Sequence[float]) -> float:
    return sum((a - b) ** 2 for a, b in zip(one, other, strict=True))


def to_edge(point: Float64, a: Float64, b: Float64) -> float:
    """Return the distance of a point to an edge."""
    along = b - a
    length = along @ along
    t = np.clip((point - a) @ along / length, 0, 1) if length else 0.0
    return float(np.linalg.norm(point - a - t * along))


def to_triangle(point: Float64, a: Float64, b: Float64, c: Float64) -> float:
    """Return the distance of a point to a triangle."""
    nearest = min(to_edge(point, a, b), to_edge(point, b, c), to_edge(point, c, a))
    normal = np.cross(b - a, c - a)
    size = np.linalg.norm(normal)
    if size < 1e-9:
        return nearest
    # Over the triangle is what lies on the same side of all edges.
    sides = [normal @ np.cross(q - p, point - p) for p, q in ((a, b), (b, c), (c, a))]
    return abs(float((point - a) @ normal / size)) if min(sides) >= 0 else nearest


def pieces(triangle: Float64, size: float) -> list[tuple[Float64, float]]:
    """Return the centroids and areas of pieces of a triangle: halved until no edge is longer."""
    edges = [(float(np.linalg.norm(triangle[k] - triangle[k - 1])), k) for k in range(3)]
    longest, k = max(edges)
    if longest <= size:
        normal = np.cross(triangle[1] - triangle[0], triangle[2] - triangle[0])
        return [(triangle.mean(axis=0), float(np.linalg.norm(normal)) / 2)]
    middle = (triangle[k] + triangle[k - 1]) / 2
    halves = [np.array([middle, triangle[k - 2], triangle[end]]) for end in (k, k - 1)]
    return [piece for half in halves for piece in pieces(half, size)]


def areas(triangle: Float64, scan: Float64, within: float, size: float) -> tuple[float, float]:
    """Return the area of a triangle within a distance of a scan, and all of it."""
    cut = pieces(triangle, size)
    right = [area for centre, area in cut if np.linalg.norm(scan - centre, axis=1).min() <= within]
    return math.fsum(right), math.fsum(area for _, area in cut)


def recall(scan: Float64, near: Sequence[bool], within: float) -> float:
    """Return the mean share of near points in the cubes of half a distance that hold any."""
    cubes: dict[tuple[float, ...], list[bool]] = {}
    for point, is_near in zip(scan, near, strict=True):
        cubes.setdefault(tuple(np.floor(point / (within / 2)).tolist()), []).append(bool(is_near))
    return math.fsum(sum(each) / len(each) for each in cubes.values()) / len(cubes)
