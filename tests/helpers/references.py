"""The rules for patches as plain loops: slow, and obvious to read."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from itertools import pairwise

from tests.helpers.maps import Patch, apart, ordered
from tests.helpers.piece_references import pieces_joined


def cells(length: float, cell_size: float) -> int:
    return math.floor(length / cell_size + 1e-9)


def orphans(
    patches: list[Patch],
    cell_size: float,
    horizontal: float,
    vertical: float,
    min_neighbours: int,
    min_share: float = 0.0,
    share_box: tuple[float, float] = (0.0, 0.0),
) -> list[Patch]:
    def box(patch: Patch, horizontal: float, vertical: float) -> tuple[list[Patch], list[Patch]]:
        """Return all patches in the columns of a box, and those of them that are near in height."""
        half = cells(horizontal, cell_size)
        around = [
            other
            for other in patches
            if abs(other.ix - patch.ix) <= half and abs(other.iy - patch.iy) <= half
        ]
        return around, [other for other in around if apart(patch, other) <= vertical]

    def stays(patch: Patch) -> bool:
        _, near = box(patch, horizontal, vertical)
        around, alike = box(patch, *share_box)
        points, all_points = (sum(other.count for other in some) for some in (alike, around))
        levels = len(around) / len({other.cell for other in around})
        enough = min_share * all_points * min(1.0, 10 / levels)
        return len(near) - 1 >= min_neighbours and points >= enough

    return [patch for patch in patches if stays(patch)]


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
    seen: Callable[[Patch], bool] | None = None,
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
            patches,
            certain,
            gap_size,
            clearance if support else math.inf,
            clearance + slope * cell_size,
            support,
            over_lower,
        )
        judge = judge if seen is None else _unseen(judge, certain, seen)
        closings = _closings(patches, certain, allowed, rank, lambda patch: patch.height, judge)
        patches = patches + _with_room(closings, patches, gap_size)
    return ordered(patches)


def _unseen(judge: Judge, certain: int, seen: Callable[[Patch], bool]) -> Judge:
    """Return what tells whether a gap is closed, given which patches were seen through."""

    def both(near: Patch, far: Patch, step: tuple[int, int], d: int) -> bool:
        if not judge(near, far, step, d):
            return False
        closing = [
            Patch(near.ix + step[0] * k, near.iy + step[1] * k, height, 0.0, 2, 0)
            for k in range(1, d)
            for height in [_between(near.height, far.height, k, d)]
        ]
        return d - 1 <= certain or not any(map(seen, closing))

    return both


Place = tuple[float, float, float]


def seen_through(
    patch: Patch, lines: Iterable[tuple[Place, Place]], cell_size: float, farthest: int
) -> bool:
    """Tell whether two sight lines, each from the craft to a point, pass through a patch."""
    return sum(_crosses(patch, *line, cell_size, farthest) for line in lines) >= 2


def _crosses(patch: Patch, craft: Place, point: Place, cell_size: float, farthest: int) -> bool:
    if any(math.isnan(coordinate) for coordinate in craft):
        return False
    cell = [math.floor(coordinate / cell_size) for coordinate in point[:2]]
    if max(abs(cell[0] - patch.ix), abs(cell[1] - patch.iy)) > farthest:
        return False
    above, below = max(craft[2], point[2]), min(craft[2], point[2])
    if not below < patch.height < above or abs(point[2] - patch.height) < cell_size / 2:
        return False
    share = (patch.height - craft[2]) / (point[2] - craft[2])
    there = [c + share * (p - c) for c, p in zip(craft, point, strict=True)]
    inside = all(
        index * cell_size < coordinate < (index + 1) * cell_size
        for index, coordinate in zip(patch.cell, there, strict=False)
    )
    dx, dy, dz = (p - c for c, p in zip(craft, point, strict=True))
    return inside and (1 - share) * math.sqrt(dx * dx + dy * dy + dz * dz) >= cell_size


def _surfaces(
    patches: list[Patch],
    certain: int,
    gap_size: float,
    level: float,
    sloping: float,
    support: int,
    over_lower: bool,
) -> Judge:
    """Return what tells whether a wide gap is level, in a surface and above nothing lower.

    And whether a narrow one is empty, or in a surface.
    """

    def judge(near: Patch, far: Patch, step: tuple[int, int], d: int) -> bool:
        back = -step[0], -step[1]
        if d - 1 <= certain:
            inside = {(near.ix + step[0] * k, near.iy + step[1] * k) for k in range(1, d)}
            ends = (near, back), (far, step)
            return not any(other.cell in inside for other in patches) or all(
                _around_edge(patches, end, away, sloping) >= support for end, away in ends
            )
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
    pieces: float = 0.0,
) -> list[Patch]:
    def rank(patch: Patch, other: Patch, d: int) -> tuple[float, ...] | None:
        if apart(patch, other) > slope * d * cell_size:
            return None
        return apart(patch, other), abs(other.height - patch.height), -other.height

    for _ in range(2):
        patches = pieces_joined(patches, gap_size, pieces)
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
