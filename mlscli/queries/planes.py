"""Distances in the plane of straight pieces of a way from squares and places, for kernels."""

from __future__ import annotations

import math

from mlscli.runtime.kernels import inner


@inner
def to_place(ax: float, ay: float, bx: float, by: float, x: float, y: float) -> float:
    """Return how far a piece is from a place.

    Parameters
    ----------
    ax, ay, bx, by : float
        Ends of the piece.
    x, y : float
        The place.
    """
    dx, dy = bx - ax, by - ay
    square = dx * dx + dy * dy
    share = 0.0
    if square > 0.0:
        share = min(max(((x - ax) * dx + (y - ay) * dy) / square, 0.0), 1.0)
    dx, dy = ax + share * dx - x, ay + share * dy - y
    return math.sqrt(dx * dx + dy * dy)


@inner
def from_square(x: float, y: float, low_x: float, low_y: float, side: float) -> float:
    """Return how far a place is from a square, 0 inside."""
    dx = max(low_x - x, x - (low_x + side), 0.0)
    dy = max(low_y - y, y - (low_y + side), 0.0)
    return math.sqrt(dx * dx + dy * dy)


@inner
def clipped(start: float, step: float, low: float, high: float) -> tuple[float, float]:
    """Return from where to where ``start + t * step`` lies in an interval, of t from 0 to 1."""
    if step == 0.0:
        return (0.0, 1.0) if low <= start <= high else (1.0, 0.0)
    one, other = (low - start) / step, (high - start) / step
    return max(min(one, other), 0.0), min(max(one, other), 1.0)


@inner
def to_square(
    ax: float, ay: float, bx: float, by: float, low_x: float, low_y: float, side: float
) -> float:
    """Return how far a piece is from a square, 0 where it meets it.

    Parameters
    ----------
    ax, ay, bx, by : float
        Ends of the piece.
    low_x, low_y, side : float
        Lower ends and side of the square.
    """
    begin_x, end_x = clipped(ax, bx - ax, low_x, low_x + side)
    begin_y, end_y = clipped(ay, by - ay, low_y, low_y + side)
    if max(begin_x, begin_y) <= min(end_x, end_y):
        return 0.0
    least = min(from_square(ax, ay, low_x, low_y, side), from_square(bx, by, low_x, low_y, side))
    for corner in range(4):
        x, y = low_x + side * (corner & 1), low_y + side * (corner >> 1)
        least = min(least, to_place(ax, ay, bx, by, x, y))
    return least


@inner
def within(
    ax: float, ay: float, bx: float, by: float, x: float, y: float, radius: float
) -> tuple[float, float]:
    """Return from where to where a piece lies within a radius of a place, as shares 0 to 1.

    The first is greater than the second where it does not.

    Parameters
    ----------
    ax, ay, bx, by : float
        Ends of the piece.
    x, y, radius : float
        The place, and the radius.
    """
    dx, dy, fx, fy = bx - ax, by - ay, ax - x, ay - y
    square, half = dx * dx + dy * dy, fx * dx + fy * dy
    rest = fx * fx + fy * fy - radius * radius
    if square == 0.0:
        return (0.0, 1.0) if rest < 0.0 else (1.0, 0.0)
    under = half * half - square * rest
    if under <= 0.0:
        return 1.0, 0.0
    root = math.sqrt(under)
    return max((-half - root) / square, 0.0), min((-half + root) / square, 1.0)
