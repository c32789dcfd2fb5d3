"""The rules of the map and its stages as plain loops: slow, and obvious to read."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from itertools import pairwise

import numpy as np

from mlscli.keyframes.batches import Points
from tests.helpers.maps import Patch, ordered

Point = tuple[float, float, float]


def apart(one: Patch, other: Patch) -> float:
    """Return the distance of two patches' intervals."""
    if one.low > other.height:
        return one.low - other.height
    if other.low > one.height:
        return other.low - one.height
    return 0.0


def cells(length: float, cell_size: float) -> int:
    return math.floor(length / cell_size + 1e-9)


# --- points ---


def median(
    points: Points,
    nb_radius: float,
    max_nb: int,
    min_nb: int,
    recentre: float = 0.0,
    level: float = math.inf,
    min_share: float = 0.0,
) -> list[tuple[Point, int]]:
    rows = [tuple(row) for row in points.xyz.tolist()]

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
            continue
        heights = sorted([z, *neighbours(i, z)])
        middle = heights[len(heights) // 2]
        if 0 < recentre < abs(middle - z):
            heights = sorted([middle, *neighbours(i, middle)])
            middle = heights[len(heights) // 2]
        result.append(((x, y, middle), int(points.keyframe[i])))
    return result


def along_slope(
    points: Points, nb_radius: float, max_nb: int, max_slope: float
) -> list[float | None]:
    """Return the median heights of points along the slopes of their neighbours.

    None: it is a matter of rounding whether they lie on a slope.
    """
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
        if abs(steep) < 1e-3 or abs(upright) < 1e-3 * on_line[0]:
            heights.append(None)
        elif steep > 0 or upright > 0:
            heights.append(float(place[2]))
        else:
            carried = all_of_them[:, 2] - all_of_them[:, :2] @ slope
            heights.append(float(place[2] + np.sort(carried)[len(carried) // 2]))
    return heights


def measured(
    points: Points, cell_size: float, gap_size: float, thickness: float
) -> list[dict[str, float]]:
    """Return a row for each measured patch."""
    columns: dict[tuple[int, int], list[tuple[float, int]]] = {}
    for (x, y, z), keyframe in zip(points.xyz.tolist(), points.keyframe.tolist(), strict=True):
        cell = math.floor(x / cell_size), math.floor(y / cell_size)
        columns.setdefault(cell, []).append((z, keyframe))
    rows = []
    for (ix, iy), column in sorted(columns.items()):
        column.sort()
        groups = [[column[0]]]
        for lower, upper in pairwise(column):
            if upper[0] - lower[0] > gap_size:
                groups.append([])
            groups[-1].append(upper)
        for group in groups:
            z = [height for height, _ in group]
            bottom, top, count = z[0], z[-1], len(z)
            above = 0.0
            for height in z:
                above += height - bottom
            mean = min(top, bottom + above / count)
            squares = 0.0
            for height in z:
                squares += (height - mean) ** 2
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
                    "count": count,
                    "origin": 0,
                    "region": -1,
                    "first_keyframe": min(keyframe for _, keyframe in group),
                    "last_keyframe": max(keyframe for _, keyframe in group),
                }
            )
    return rows


# --- stages on patches ---


def orphans(
    patches: list[Patch], cell_size: float, horizontal: float, vertical: float, min_neighbours: int
) -> list[Patch]:
    half = cells(horizontal, cell_size)

    def neighbours(patch: Patch) -> int:
        return sum(
            other is not patch
            and abs(other.ix - patch.ix) <= half
            and abs(other.iy - patch.iy) <= half
            and apart(patch, other) <= vertical
            for other in patches
        )

    return [patch for patch in patches if neighbours(patch) >= min_neighbours]


Rank = Callable[[Patch, Patch, int], tuple[float, ...] | None]


def _look(
    patches: list[Patch], patch: Patch, step: tuple[int, int], farthest: int, rank: Rank
) -> tuple[Patch, int] | None:
    """Return the patch that decides along a direction, and at which distance."""
    for d in range(1, farthest + 1):
        there = patch.ix + step[0] * d, patch.iy + step[1] * d
        candidates = [(rank(patch, other, d), other) for other in patches if other.cell == there]
        ranked = [(key, other) for key, other in candidates if key is not None]
        if ranked:
            return min(ranked, key=lambda pair: pair[0])[1], d
    return None


def _between(near: float, far: float, k: int, d: int) -> float:
    value = (near * (d - k) + far * k) / d
    return sorted((near, value, far))[1]


Judge = Callable[[Patch, Patch, tuple[int, int], int], bool]


def _closings(
    patches: list[Patch],
    certain: int,
    allowed: int,
    rank: Rank,
    low: Callable[[Patch], float],
    judge: Judge,
) -> list[Patch]:
    """Return what closes gaps along +x and +y, before it is known where there is room."""
    result = []
    for step in ((1, 0), (0, 1)):
        back = -step[0], -step[1]
        for near in patches:
            found = _look(patches, near, step, allowed + 1, rank)
            if found is None:
                continue
            far, d = found
            answer = _look(patches, far, back, allowed + 1, rank)
            if answer is None or answer[0] is not near or not judge(near, far, step, d):
                continue
            for k in range(1, d):
                top = _between(near.height, far.height, k, d)
                bottom = _between(low(near), low(far), k, d)
                cell = near.ix + step[0] * k, near.iy + step[1] * k
                origin = 1 if d - 1 <= certain else 2
                result.append(Patch(*cell, top, top - bottom, origin, 0))
    return result


def _with_room(closings: list[Patch], there: list[Patch], gap_size: float) -> list[Patch]:
    free = [
        new
        for new in closings
        if all(old.cell != new.cell or apart(old, new) > gap_size for old in there)
    ]
    stay: list[Patch] = []
    for new in sorted(free, key=lambda p: (-p.height, p.origin, -p.depth)):
        above = [old for old in stay if old.cell == new.cell]
        if not above or above[-1].low - new.height > gap_size:
            stay.append(new)
    return stay


def plaster(
    patches: list[Patch],
    cell_size: float,
    gap_size: float,
    slope: float,
    clearance: float,
    max_gap: float,
    max_gap_enhanced: float,
    slope_reach: float = 0.0,
    support: int = 0,
    over_lower: bool = True,
) -> list[Patch]:
    def rank(patch: Patch, other: Patch, d: int) -> tuple[float, ...] | None:
        difference = abs(other.height - patch.height)
        trusted = min(d, slope_reach / cell_size) if slope_reach else d
        if difference > slope * trusted * cell_size + clearance:
            return None
        return difference, -other.height

    for length in _passes(max_gap, max_gap_enhanced):
        certain, allowed = cells(max_gap, cell_size), cells(length, cell_size)
        judge = _surfaces(
            patches, certain, gap_size, clearance if support else math.inf, support, over_lower
        )
        closings = _closings(patches, certain, allowed, rank, lambda patch: patch.height, judge)
        patches = patches + _with_room(closings, patches, gap_size)
    return ordered(patches)


def _surfaces(
    patches: list[Patch],
    certain: int,
    gap_size: float,
    level: float,
    support: int,
    over_lower: bool,
) -> Judge:
    """Return what tells whether a wide gap is level, in a surface and above nothing lower."""

    def judge(near: Patch, far: Patch, step: tuple[int, int], d: int) -> bool:
        if d - 1 <= certain:
            return True
        back = -step[0], -step[1]
        edges = _around_edge(patches, near, back, level), _around_edge(patches, far, step, level)
        if abs(near.height - far.height) > level or min(edges) < support:
            return False
        return over_lower or not any(
            _between(near.height, far.height, k, d) - other.height > gap_size
            for k in range(1, d)
            for other in patches
            if other.cell == (near.ix + step[0] * k, near.iy + step[1] * k)
        )

    return judge


def _around_edge(patches: list[Patch], end: Patch, away: tuple[int, int], clearance: float) -> int:
    """Count the cells behind and beside an end, five in all, with a patch level with it."""
    count = 0
    for dx in (-1, 0, 1):
        for dy in (-1, 0, 1):
            # Neither the end's own cell nor the three on the side of the gap.
            if (dx, dy) == (0, 0) or dx * away[0] + dy * away[1] < 0:
                continue
            cell = end.ix + dx, end.iy + dy
            count += any(
                other.cell == cell and abs(other.height - end.height) <= clearance
                for other in patches
            )
    return count


def walls(
    patches: list[Patch],
    cell_size: float,
    gap_size: float,
    slope: float,
    max_gap: float,
    max_gap_enhanced: float,
    join: float = 0.0,
    along: float = 0.0,
    support: int = 0,
) -> list[Patch]:
    def rank(patch: Patch, other: Patch, d: int) -> tuple[float, ...] | None:
        if apart(patch, other) > slope * d * cell_size:
            return None
        return apart(patch, other), abs(other.height - patch.height), -other.height

    for length in _passes(max_gap, max_gap_enhanced):
        certain, allowed = cells(max_gap, cell_size), cells(length, cell_size)
        vertical = [patch for patch in patches if patch.depth > 0]
        judge = _walls_along(vertical, certain, cells(along, cell_size))
        closings = _closings(vertical, certain, allowed, rank, lambda patch: patch.low, judge)
        holes = []
        for lower, upper in pairwise(ordered(patches)):
            space = upper.low - lower.height
            both = lower.depth > 0 and upper.depth > 0 and lower.cell == upper.cell
            shown = _walls_beside(vertical, lower.cell, lower.height, upper.low)
            enough = space <= max_gap or shown >= support
            if both and gap_size < space <= length and enough:
                holes.append(Patch(*lower.cell, upper.low, space, 1 if space <= max_gap else 2, 0))
        patches = ordered(patches + holes + _with_room(closings, patches + holes, gap_size))
    return _drawn_out(patches, gap_size, min(join, gap_size)) if join else patches


def _walls_along(vertical: list[Patch], certain: int, look: int) -> Judge:
    """Return what tells whether a wall runs along a gap at both ends."""

    def judge(near: Patch, far: Patch, step: tuple[int, int], d: int) -> bool:
        needed = min(d - 1, look) if d - 1 > certain else 0
        left, right = (step[1], step[0]), (-step[1], -step[0])
        for end, away in ((near, (-step[0], -step[1])), (far, step)):
            behind = _in_a_row(vertical, end, away, look)
            across = sum(_in_a_row(vertical, end, side, look) for side in (left, right))
            if behind < needed or 2 * behind < across:
                return False
        return True

    return judge


def _in_a_row(patches: list[Patch], end: Patch, step: tuple[int, int], look: int) -> int:
    """Count the cells that follow one another from an end and hold a patch that meets it."""
    for k in range(1, look + 1):
        cell = end.ix + step[0] * k, end.iy + step[1] * k
        if not any(other.cell == cell and apart(end, other) == 0 for other in patches):
            return k - 1
    return look


def _walls_beside(vertical: list[Patch], hole: tuple[int, int], bottom: float, top: float) -> int:
    """Count the cells around a hole with a vertical patch over more than half of its height."""
    cells_beside = {
        other.cell
        for other in vertical
        if max(abs(other.ix - hole[0]), abs(other.iy - hole[1])) == 1
        and 2 * (min(top, other.height) - max(bottom, other.low)) > top - bottom
    }
    return len(cells_beside)


def _drawn_out(patches: list[Patch], gap_size: float, farthest: float) -> list[Patch]:
    ends = []
    for patch in patches:
        foot, top = patch.low, patch.height
        for other in patches:
            beside = max(abs(other.ix - patch.ix), abs(other.iy - patch.iy)) == 1
            if beside and patch.depth > 0:
                if patch.low - other.low <= farthest:
                    foot = min(foot, other.low)
                if other.height - patch.height <= farthest:
                    top = max(top, other.height)
        ends.append((foot, top))
    result = []
    for i, patch in enumerate(patches):
        foot, top = ends[i]
        if i > 0 and patches[i - 1].cell == patch.cell and foot - ends[i - 1][1] <= gap_size:
            foot = patch.low
        if i + 1 < len(patches) and patches[i + 1].cell == patch.cell:
            top = patch.height if ends[i + 1][0] - top <= gap_size else top
        moved = (foot, top) != (patch.low, patch.height)
        result.append(patch._replace(height=top, depth=top - foot) if moved else patch)
    return ordered(result)


def _passes(max_gap: float, max_gap_enhanced: float) -> Iterable[float]:
    return [max_gap, max_gap_enhanced] if max_gap_enhanced else [max_gap]


def pyramids(
    patches: list[Patch], gap_size: float, factor: float, max_height: float, pits: bool = False
) -> list[Patch]:
    result = []
    for patch in patches:
        others = [other for other in patches if other.cell == patch.cell and other is not patch]
        heights = []
        for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            there = [p for p in patches if p.cell == (patch.ix + dx, patch.iy + dy)]
            near = sorted(there, key=lambda p: (abs(p.height - patch.height), -p.height))
            if near and abs(near[0].height - patch.height) <= max_height:
                heights.append(near[0].height)
        crowded = any(apart(patch, other) <= gap_size for other in others)
        moved = patch
        if not crowded and len(heights) == 4:
            highest, lowest = max(heights), min(heights)
            if patch.height - highest > factor * (highest - lowest):
                moved = patch._replace(height=highest, depth=max(0.0, highest - patch.low))
            elif pits and patch.depth == 0 and lowest - patch.height > factor * (highest - lowest):
                moved = patch._replace(height=lowest)
        if moved is patch or all(apart(moved, other) > gap_size for other in others):
            result.append(moved)
    return ordered(result)


def _regions(patches: list[Patch], thresh: float) -> list[list[int]]:
    """Return the regions as lists of patch numbers, in the order of their first patches."""
    regions: list[list[int]] = []
    seen: set[int] = set()
    for first in range(len(patches)):
        if first in seen:
            continue
        region, stack = [], [first]
        seen.add(first)
        while stack:
            i = stack.pop()
            region.append(i)
            for j, other in enumerate(patches):
                edge = abs(other.ix - patches[i].ix) + abs(other.iy - patches[i].iy) == 1
                if edge and j not in seen and abs(other.height - patches[i].height) <= thresh:
                    seen.add(j)
                    stack.append(j)
        regions.append(region)
    return regions


def _numbered(patches: list[Patch], regions: list[list[int]]) -> list[Patch]:
    return ordered(
        [patches[i]._replace(region=n) for n, region in enumerate(regions) for i in region]
    )


def regions(
    patches: list[Patch], gap_size: float, thresh: float, min_size: int, snap: bool
) -> list[Patch]:
    found = _regions(patches, thresh)
    large = [region for region in found if len(region) >= min_size]
    if not snap:
        return _numbered(patches, large)
    kept = {i for region in large for i in region}
    moved: dict[int, Patch] = {}
    for i, patch in enumerate(patches):
        targets = [
            patches[j].height
            for j in kept
            if abs(patches[j].ix - patch.ix) + abs(patches[j].iy - patch.iy) == 1
            and abs(patches[j].height - patch.height) <= gap_size
        ]
        if i not in kept and targets:
            target = min(targets, key=lambda height: (abs(height - patch.height), -height))
            moved[i] = patch._replace(height=target)
    stay = [patches[i] for i in sorted(kept)]
    for i, patch in moved.items():
        others = [j for j in range(len(patches)) if j != i and patches[j].cell == patch.cell]
        as_they_were = [patches[j] for j in others]
        as_moved = [moved[j] for j in others if j in moved]
        if all(apart(patch, other) > gap_size for other in as_they_were + as_moved):
            stay.append(patch)
    stay = ordered(stay)
    return _numbered(stay, _regions(stay, thresh))
