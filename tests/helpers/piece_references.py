"""The rule for pieces of walls as plain loops: slow, and obvious to read."""

from __future__ import annotations

from tests.helpers.maps import Patch, apart, ordered


def pieces_joined(patches: list[Patch], gap_size: float, farthest: float) -> list[Patch]:
    """Join pieces of walls, all of which together spread wider than the thickness."""
    result: list[Patch] = []
    bottom = 0.0
    for number, patch in enumerate(patches):
        if number and _is_piece(patches, patches[number - 1], patch, gap_size, farthest):
            below = result.pop()
            height, count = patch.height, below.count + patch.count
            patch = below._replace(height=height, depth=height - bottom, count=count)
        else:
            bottom = patch.low
        result.append(patch)
    return ordered(result)


def _is_piece(
    patches: list[Patch], lower: Patch, upper: Patch, gap_size: float, farthest: float
) -> bool:
    if lower.cell != upper.cell or not gap_size < upper.low - lower.height <= farthest:
        return False
    around = [
        other for other in patches if max(abs(other.ix - upper.ix), abs(other.iy - upper.iy)) == 1
    ]
    level = {other.cell for other in around if apart(upper, other) <= gap_size}
    walls = {
        other.cell
        for other in around
        if other.depth > 0
        and other.low - upper.low <= gap_size
        and lower.height - other.height <= gap_size
    }
    measured = lower.origin == upper.origin == 0
    return measured and len(level) <= 4 and len(walls) >= 2
