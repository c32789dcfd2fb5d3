"""Random maps and clouds for tests: several levels, gaps, equal heights and equal distances."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from mlscli.keyframes.batches import Points
from mlscli.maps.columns import COLUMNS
from mlscli.maps.merging import with_measured
from mlscli.maps.records import columns_of, records_of
from mlscli.maps.surface_map import SurfaceMap

CELL, GAP, THICKNESS = 0.5, 0.75, 0.25
KEYFRAMES = 7


class Patch(NamedTuple):
    """A patch as the references see it."""

    ix: int
    iy: int
    height: float
    depth: float
    origin: int
    count: int  # type: ignore[assignment]  # points, not the method of tuples
    region: int = -1

    @property
    def low(self) -> float:
        return self.height - self.depth

    @property
    def cell(self) -> tuple[int, int]:
        return self.ix, self.iy


def patches_of(surface: SurfaceMap) -> list[Patch]:
    columns = (getattr(surface, name).tolist() for name in Patch._fields)
    return [Patch(*row) for row in zip(*columns, strict=True)]


def apart(one: Patch, other: Patch) -> float:
    """Return the distance of two patches' intervals."""
    if one.low > other.height:
        return one.low - other.height
    if other.low > one.height:
        return other.low - one.height
    return 0.0


def ordered(patches: list[Patch]) -> list[Patch]:
    return sorted(patches, key=lambda p: (p.ix, p.iy, p.height, p.depth, p.origin, p.count))


def map_of(patches: list[Patch], gap_size: float = GAP, cell_size: float = CELL) -> SurfaceMap:
    """Return the map of patches, with statistics that fit them."""
    rows = ordered(patches)
    given: dict[str, Any] = {
        name: np.array([getattr(row, name) for row in rows], dtype=COLUMNS[name])
        for name in Patch._fields
    }
    measured = given["origin"] == 0
    top = np.where(measured, given["height"], np.nan)
    statistics: dict[str, Any] = {
        "top": top,
        "bottom": top - given["depth"],
        "mean": top - given["depth"] / 2,
        "variance": np.where(measured, given["depth"] ** 2 / 4, np.nan),
        "noise": np.where(measured, given["count"] / 1024, np.nan).astype(np.float32),
        "moved": np.zeros(len(rows), dtype=np.uint8),
        "first_keyframe": np.where(measured, 0, -1).astype(np.int32),
        "last_keyframe": np.where(measured, (given["count"] % KEYFRAMES).astype(np.int32), -1),
    }
    route = np.full((KEYFRAMES, 4), np.nan)
    return SurfaceMap(cell_size, gap_size, THICKNESS, route=route, **given, **statistics)


def add_measured(surface: SurfaceMap, new: SurfaceMap) -> SurfaceMap:
    """Return a growing map with measured patches added."""
    records = with_measured(records_of(surface), records_of(new), surface.grid)
    return replace(surface, **columns_of(records))


def random_map(rng: np.random.Generator, *, fill: float | None = None) -> SurfaceMap:
    """Return a small map; half of them have heights in coarse steps, so that many are equal."""
    fill = rng.uniform(0.2, 1.0) if fill is None else fill
    coarse = rng.random() < 0.5
    shift = rng.integers(-6, 7, 2)
    patches: list[Patch] = []
    for x, y in product(range(rng.integers(1, 9)), range(rng.integers(1, 9))):
        if rng.random() > fill:
            continue
        level = rng.normal(0, 0.2)
        for _ in range(rng.choice([1, 1, 2, 3])):
            depth = float(rng.choice([0, 0, rng.uniform(0.3, 1.5)]))
            level += depth + rng.choice([0.1, 0.8])
            if coarse:
                depth, level = np.round(depth * 4) / 4, np.round(level * 4) / 4
            origin = int(rng.choice([0, 0, 0, 1, 2]))
            count = 0 if origin else int(rng.integers(1, 50))
            cell = int(x + shift[0]), int(y + shift[1])
            previous = [p.height for p in patches if p.cell == cell]
            # Patches of a cell are more than the gap apart.
            if all(level - depth - height > GAP for height in previous):
                patches.append(Patch(*cell, float(level), float(depth), origin, count))
            level += GAP
    return map_of(patches)


def rough_floor(rng: np.random.Generator) -> SurfaceMap:
    """Return a floor of single peaks, with here and there another level close above or below."""
    patches = []
    for x, y in product(range(rng.integers(3, 8)), range(rng.integers(3, 8))):
        if rng.random() < 0.03:
            continue
        height = float(rng.choice([0, 0, 0, 0.25, 0.5, 0.75]) + rng.choice([0, 0, 0.01]))
        depth = float(rng.choice([0, 0, 0, 0.3, 0.5]))
        patches.append(Patch(x - 3, y - 3, height, depth, 0, int(rng.integers(1, 9))))
        if rng.random() < 0.3:
            other = height + float(rng.choice([0.8, 1.0])) * float(rng.choice([-1, 1]))
            patches.append(Patch(x - 3, y - 3, other - depth * (other < height), 0.0, 1, 0))
    return map_of(patches)


def random_points(rng: np.random.Generator, size: int | None = None) -> Points:
    """Return a cloud of levels with outliers; half of them on a coarse lattice with repeats."""
    size = int(rng.integers(0, 120)) if size is None else size
    xyz = rng.uniform(-2, 2, (size, 3)) * (1, 1, 0.1) + (0, 0, 1) * rng.choice([0, 2], (size, 1))
    xyz[:, 2] += rng.choice([0, 1], size, p=(0.8, 0.2)) * rng.normal(0, 2, size)
    if rng.random() < 0.5:
        xyz = np.round(xyz * 4) / 4
        xyz[:, :2] += 0.11  # off the edges of cells
    keyframe = rng.integers(0, KEYFRAMES, size).astype(np.int32)
    return Points.of(xyz + 0.0, keyframe)


# --- the symmetries of the grid ---


def symmetries() -> Iterator[tuple[bool, bool, bool]]:
    """Yield (swap x and y, negate x, negate y)."""
    yield from product((False, True), repeat=3)


def turned_points(points: Points, symmetry: tuple[bool, bool, bool]) -> Points:
    swap, negate_x, negate_y = symmetry
    signs = np.array((-1 if negate_x else 1, -1 if negate_y else 1, 1), dtype=np.float32)
    axes = [1, 0, 2] if swap else [0, 1, 2]
    xyz = np.ascontiguousarray((points.xyz * signs)[:, axes]) + 0.0
    sight = np.ascontiguousarray((points.sight * signs)[:, axes])
    return points._replace(xyz=xyz, sight=sight)


def turned_map(surface: SurfaceMap, symmetry: tuple[bool, bool, bool]) -> SurfaceMap:
    """Return the map that the turned points must give."""
    swap, negate_x, negate_y = symmetry
    ix = -1 - surface.ix if negate_x else surface.ix
    iy = -1 - surface.iy if negate_y else surface.iy
    ix, iy = (iy, ix) if swap else (ix, iy)
    return replace(surface, ix=ix, iy=iy).sorted()
