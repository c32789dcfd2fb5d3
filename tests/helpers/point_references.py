"""The rules for points as plain loops: slow, and obvious to read."""

from __future__ import annotations

import math
from collections import Counter
from itertools import pairwise

import numpy as np

from mlscli.keyframes.batches import Points
from mlscli.runtime.arrays import Float64

Point = tuple[float, float, float]


def median(
    points: Points,
    nb_radius: float,
    max_nb: int,
    min_nb: int,
    recentre: float = 0.0,
    level: float = math.inf,
    min_share: float = 0.0,
    layer_share: float = 0.0,
) -> list[tuple[Point, int]]:
    rows = [(x, y, z) for x, y, z in points.xyz.tolist()]

    def neighbours(i: int, z: float) -> list[float]:
        """Return the heights that count for point i if it were at height z."""
        x, y, _ = rows[i]
        near = []
        for j, (ox, oy, oz) in enumerate(rows):
            dx, dy, dz = ox - x, oy - y, oz - z
            squared = (dx * dx + dy * dy) + dz * dz
            if i != j and squared <= nb_radius * nb_radius:
                near.append((squared, oz))
        near.sort()
        return [oz for _, oz in (near[:max_nb] if max_nb else near)]

    result = []
    for i, (x, y, z) in enumerate(rows):
        around = neighbours(i, z)
        speak = [other for other in around if abs(other - z) <= level]
        if len(speak) < max(min_nb, min_share * len(around)):
            if not layer_share:
                continue
            layers = Counter(
                min(max(round((oz - z) / (2 * level)), -31), 31)
                for ox, oy, oz in rows
                if (ox - x) * (ox - x) + (oy - y) * (oy - y) <= nb_radius * nb_radius
            )
            thin = layers[0] * len(layers) < layer_share * layers.total()
            if thin and not of_pole(rows, i, z, nb_radius, level):
                continue
        heights = sorted([z, *neighbours(i, z)])
        middle = heights[len(heights) // 2]
        if 0 < recentre < abs(middle - z):
            heights = sorted([middle, *neighbours(i, middle)])
            middle = heights[len(heights) // 2]
        result.append(((x, y, middle), int(points.keyframe[i])))
    return result


def of_pole(rows: list[Point], i: int, z: float, nb_radius: float, level: float) -> bool:
    """Return whether point i, as if it were at height z, is of a pole."""
    offsets = [(ox - rows[i][0], oy - rows[i][1], oz - z) for ox, oy, oz in rows]
    flat = [(dx * dx + dy * dy, dz) for dx, dy, dz in offsets]
    column = [dz for d, dz in flat if d <= min(level / 2, nb_radius) ** 2]
    ring = [dz for d, dz in flat if (1.5 * level) ** 2 < d <= nb_radius * nb_radius]
    layers = {min(max(round(dz / (2 * level)), -31), 31) for dz in column}
    above = next(n for n in range(33) if n + 1 not in layers)
    below = next(n for n in range(33) if -n - 1 not in layers)
    near = level if above and below else 2 * level
    close = sum(abs(dz) <= 2 * level for dz in column)
    beside = sum(abs(dz) <= near for dz in ring)
    return close >= 3 and beside <= min(8, close / 2) and above + below >= 2


def along_slope(
    points: Points,
    nb_radius: float,
    max_nb: int,
    max_slope: float,
    level: float = 0.0,
) -> list[float | None]:
    """Return the median heights of points along the slopes of their neighbours.

    With `level`, points of poles keep their height where their neighbours leave open whether they
    are upright. None: it is a matter of rounding whether they lie on a slope.
    """
    rows = [(x, y, z) for x, y, z in points.xyz.tolist()]
    heights: list[float | None] = []
    for i, place in enumerate(points.xyz):
        offsets = np.delete(points.xyz, i, axis=0) - place
        squared = (offsets * offsets).sum(axis=1)
        near = squared <= nb_radius * nb_radius
        if max_nb and near.sum() > max_nb:
            near &= squared <= np.sort(squared)[max_nb - 1]
        all_of_them = np.vstack((offsets[near], np.zeros(3)))
        x, y, z = (all_of_them - all_of_them.mean(axis=0)).T
        on_line = np.linalg.eigvalsh(np.cov(x, y)) if len(x) > 4 else np.zeros(2)
        if on_line[0] <= 1e-9 * on_line[1]:
            heights.append(float(place[2]))
            continue
        slope = np.linalg.lstsq(np.column_stack((x, y)), z, rcond=None)[0]
        scatter = np.var(z - slope @ (x, y), ddof=1)
        steep, upright = np.hypot(*slope) - max_slope, scatter - 2 * on_line[0]
        margin, unsure = 1e-3 * on_line[0], scatter - 0.5 * on_line[0]
        pole = unsure > -margin and level > 0 and of_pole(rows, i, rows[i][2], nb_radius, level)
        if abs(steep) < 1e-3 or abs(upright) < margin or (pole and unsure < margin):
            heights.append(None)
        elif steep > 0 or upright > 0 or pole:
            heights.append(float(place[2]))
        else:
            carried = all_of_them[:, 2] - all_of_them[:, :2] @ slope
            heights.append(float(place[2] + np.sort(carried)[len(carried) // 2]))
    return heights


def measured(
    points: Points, cell_size: float, gap_size: float, thickness: float
) -> list[dict[str, float]]:
    """Return a row for each measured patch."""
    columns: dict[tuple[int, int], list[tuple[float, int, float]]] = {}
    for (x, y, z), keyframe, noise in zip(
        points.xyz.tolist(), points.keyframe.tolist(), points.noise.tolist(), strict=True
    ):
        cell = math.floor(x / cell_size), math.floor(y / cell_size)
        columns.setdefault(cell, []).append((z, keyframe, noise))
    rows = []
    for (ix, iy), column in sorted(columns.items()):
        column.sort()
        groups = [[column[0]]]
        for lower, upper in pairwise(column):
            if upper[0] - lower[0] > gap_size:
                groups.append([])
            groups[-1].append(upper)
        for group in groups:
            z = [height for height, _, _ in group]
            known = [noise for _, _, noise in group if not math.isnan(noise)]
            bottom, top, count = z[0], z[-1], len(z)
            above = 0.0
            for height in z:
                above += height - bottom
            mean = min(top, bottom + above / count)
            squares = 0.0
            for height in z:
                squares += (height - mean) * (height - mean)
            variance = squares / count
            vertical = min(top - bottom, math.sqrt(12 * variance)) > thickness
            rows.append(
                {
                    "ix": ix,
                    "iy": iy,
                    "height": top if vertical else mean,
                    "depth": top - bottom if vertical else 0.0,
                    "top": top,
                    "bottom": bottom,
                    "mean": mean,
                    "variance": variance,
                    "noise": sum(known) / len(known) if known else math.nan,
                    "count": count,
                    "origin": 0,
                    "moved": 0,
                    "region": -1,
                    "first_keyframe": min(keyframe for _, keyframe, _ in group),
                    "last_keyframe": max(keyframe for _, keyframe, _ in group),
                }
            )
    return rows


def rays(
    points: Points,
    least: float,
    farthest_across: float,
    noise: float,
    depth: float,
    radius: float,
    max_nb: int,
    min_nb: int,
    min_share: float,
) -> Float64:
    """Return where points are moved to, every point compared with every other."""
    sight = points.sight.astype(np.float64)
    distance = np.sqrt((sight**2).sum(axis=1))
    sigma = np.nan_to_num(noise * distance**2)
    ahead = np.nan_to_num(sight / np.where(distance > 0, distance, 1.0)[:, None])
    steps = 2.0**15 / depth
    result = points.xyz.copy()
    for i in np.flatnonzero(sigma > least):
        x, y, _ = ahead[i]
        flat = np.hypot(x, y)
        level = np.array([-y, x, 0]) / flat if flat > 0 else np.array([1.0, 0, 0])
        offset = points.xyz - points.xyz[i]
        t, a, b = (offset @ axis for axis in (ahead[i], level, np.cross(ahead[i], level)))
        sine = np.sqrt(np.maximum(0, 1 - (ahead @ ahead[i]) ** 2))
        apart = a**2 + b**2
        near = (np.abs(t) <= depth) & (apart <= radius**2) & (np.arange(points.size) != i)
        near &= (sigma <= 2 * sigma[i]) & (sigma * sine <= farthest_across)
        if near.sum() > max_nb:
            near &= apart <= np.sort(apart[near])[max_nb - 1] + 1e-12
        t, a, b = (np.rint(part[near] * steps) for part in (t, a, b))
        places, off = np.column_stack((a, b)), t
        window = min(3 * sigma[i], depth) * steps
        for close in (window, *4 * [window / 2]):
            at = np.abs(off) <= close
            if at.sum() < 4:
                break
            shifted, depths = places[at] - places[at].mean(axis=0), t[at] - t[at].mean()
            blurred = shifted.T @ shifted / at.sum() + np.eye(2) * np.rint(2.0**15 / 400) ** 2
            carried = t - places @ np.linalg.solve(blurred, shifted.T @ depths / at.sum())
            off = carried - carried[at].mean()
        beyond = np.nan
        if at.sum() >= 4:
            on_surface = carried[np.abs(off) <= window / 2]
            if len(on_surface) >= max(min_nb, min_share * near.sum()):
                beyond = np.median(on_surface)
        result[i] += (beyond if abs(beyond) <= window / 2 else np.nan) / steps * ahead[i]
    return result


def aside(points: Points, nb_radius: float, max_nb: int, across: float) -> list[Point | None]:
    """Return how far points of what stands upright move across it; None: a matter of rounding."""
    moves: list[Point | None] = []
    for place in points.xyz:
        offsets = points.xyz - place
        squared = (offsets * offsets).sum(axis=1)
        others = np.sort(squared)[1:]
        others = others[others <= nb_radius * nb_radius]
        limit = others[: min(12, max_nb or 12)][-1]
        x, y, _ = offsets[squared <= limit].T
        variance, axes = np.linalg.eigh(np.cov(x, y))
        offset = axes[:, 0] @ (x, y)
        move = float(np.median(offset)) * axes[:, 0]
        unsure = abs(variance[1] - 4 * variance[0]) < 1e-3 * variance[1]
        if unsure or abs(np.hypot(*move) - across) < 1e-3:
            moves.append(None)
        elif variance[1] < 4 * variance[0] or np.hypot(*move) > across:
            moves.append((0.0, 0.0, 0.0))
        else:
            moves.append((float(move[0]), float(move[1]), 0.0))
    return moves
