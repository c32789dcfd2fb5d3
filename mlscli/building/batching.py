"""Keyframes gathered into batches, and the route that they make.

Every keyframe takes the next row of the route. Points beyond the grid are dropped here, and
counted.
"""

from __future__ import annotations

import math

import numpy as np

from mlscli.keyframes.batches import Points, gather
from mlscli.keyframes.keyframe import UNKNOWN_POSITION, Keyframe
from mlscli.maps.cells import on_grid
from mlscli.parameters.lengths import FARTHEST
from mlscli.pipeline.report import Report
from mlscli.runtime.arrays import Float64, frozen
from mlscli.runtime.kernels import kernel

BEYOND_GRID = "cell index beyond int32"


class BatchGatherer:
    """Gathers keyframes until there are enough points for a batch.

    Parameters
    ----------
    min_points : int
        How many points are enough.
    cell_size : float
        Side of a cell, in the unit of the recording.
    report : Report
        Receives the numbers of points read and dropped, and of batches.
    route : float64 (K, 4), optional
        That of keyframes before the first.

    Attributes
    ----------
    keyframes : int
        Number of keyframes in batches.
    """

    def __init__(
        self, min_points: int, cell_size: float, report: Report, route: Float64 | None = None
    ) -> None:
        self.keyframes = 0 if route is None else len(route)
        self._min_points = min_points
        self._cell_size = cell_size
        self._report = report
        self._waiting: list[Keyframe] = []
        self._waiting_points = 0
        self._batches: list[Points] = []
        # Rows of the route, with room for more; and how many there are, and were taken.
        self._route = np.empty((0, 4)) if route is None else route.copy()
        self._rows = self._rows_taken = self.keyframes

    def add(self, keyframe: Keyframe) -> bool:
        """Take a keyframe, and return whether enough points wait for a batch."""
        self._report.points_read += len(keyframe.points)
        keyframe = self._measured(keyframe)
        self._waiting.append(keyframe)
        self._waiting_points += len(keyframe.points)
        return self._waiting_points >= self._min_points

    def _measured(self, keyframe: Keyframe) -> Keyframe:
        """Return a keyframe without what is no measurement, -0.0 as 0.0."""
        points = np.ascontiguousarray(keyframe.points, dtype=np.float64)
        if not _sound(frozen(points)):
            finite = np.isfinite(points).all(axis=1)
            near = finite & (np.abs(points[:, 2]) <= FARTHEST)
            self._report.drop("not finite", int(np.count_nonzero(~finite)))
            self._report.drop("beyond 1e8", int(np.count_nonzero(finite & ~near)))
            points = points[near] + 0.0
        stamp = keyframe.stamp if math.isfinite(keyframe.stamp) else math.nan
        known = np.isfinite(keyframe.position).all()
        return Keyframe(points, stamp, keyframe.position if known else UNKNOWN_POSITION)

    @property
    def has_waiting(self) -> bool:
        """Whether keyframes wait for a batch."""
        return bool(self._waiting)

    def close(self) -> int:
        """Make a batch of the waiting keyframes, and return how many points it has."""
        points, route = gather(self._waiting, self.keyframes)
        self.keyframes += len(self._waiting)
        self._waiting, self._waiting_points = [], 0
        self._add_to_route(route)
        self._report.batches += 1
        inside = on_grid(points.xyz, self._cell_size)
        if not inside.all():
            self._report.drop(BEYOND_GRID, int(np.count_nonzero(~inside)))
            points = points.take(inside)
        self._batches.append(points)
        return points.size

    @property
    def has_points(self) -> bool:
        """Whether there is a batch whose points were not taken yet."""
        return bool(self._batches)

    def take_points(self) -> Points:
        """Return the points of all batches since the last call, and keep none of them."""
        if len(self._batches) == 1:
            return self._batches.pop()
        size = sum(batch.size for batch in self._batches)
        points = Points.of(np.empty((size, 3)), np.empty(size, dtype=np.int32))
        while self._batches:
            # From the last: each batch is freed once it is copied, and at most one is held twice.
            batch = self._batches.pop()
            part = slice(size - batch.size, size)
            points.xyz[part], points.keyframe[part] = batch.xyz, batch.keyframe
            points.sight[part], points.noise[part] = batch.sight, batch.noise
            size -= batch.size
        return points

    def take_route(self) -> Float64:
        """Return the rows that the route gained since the last call, float64 (K, 4)."""
        gained = self._route[self._rows_taken : self._rows].copy()
        self._rows_taken = self._rows
        return gained

    @property
    def route(self) -> Float64:
        """The route of all batches, float64 (K, 4), as in `SurfaceMap`: a view."""
        return self._route[: self._rows]

    def _add_to_route(self, rows: Float64) -> None:
        size = self._rows + len(rows)
        if size > len(self._route):
            longer = np.empty((2 * size, 4))
            longer[: self._rows] = self.route
            self._route = longer
        self._route[self._rows : size] = rows
        self._rows = size


@kernel
def _sound(points: Float64) -> bool:
    """Return whether all points are finite, none too high, and no coordinate is -0.0."""
    sound = True
    for i in range(len(points)):
        sound &= abs(points[i, 2]) <= FARTHEST
        for axis in range(3):
            value = points[i, axis]
            sound &= np.isfinite(value) and not (value == 0.0 and np.signbit(value))
    return sound
