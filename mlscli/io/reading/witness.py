"""What a pass over a recording shows of its vertical: some points, and how the craft was held."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from mlscli.io.clouds.trajectory import Trajectory
from mlscli.io.reading.upright import Upright
from mlscli.io.source import Cloud
from mlscli.keyframes.keyframe import Axes
from mlscli.runtime.arrays import Float64

if TYPE_CHECKING:
    from mlscli.geometry.up import Up

# The points that are kept to find the vertical, and to doubt the one that the user named.
_FINDING, _DOUBTING = 30_000, 10_000


class Witness:
    """Gathers what tells the vertical of a recording; makes nothing of it until it is asked.

    Parameters
    ----------
    finds : bool
        Whether to find the vertical, or else to doubt the one that the user named. What is found
        depends neither on the order of points nor on how often each comes; a doubt may, and costs
        a tenth.

    Attributes
    ----------
    order_note : str
        In which order the quaternions of a trajectory are taken, where that was doubtful.
    """

    def __init__(self, *, finds: bool) -> None:
        from mlscli.geometry.samples import Reservoir
        from mlscli.geometry.surroundings import PointSample

        self._sample = PointSample(_FINDING) if finds else Reservoir(_DOUBTING)
        self.order_note = ""
        self._positions: list[tuple[float, float, float]] = []
        self._attitudes: dict[Axes, list[tuple[float, float, float, float]]] = {}

    def add(self, placed: Cloud, points: Float64) -> None:
        """Add a cloud in the map frame, and those of its points (N, 3) that are kept, turned."""
        self._sample.add(points)
        self._positions.append(placed.position)
        if placed.has_attitude:
            self._attitudes.setdefault(placed.axes, []).append(placed.attitude)

    def find_up(self, trajectory: Trajectory | None) -> Up:
        """Return the vertical of a recording whose points are not turned.

        Parameters
        ----------
        trajectory : Trajectory or None
            Its positions are taken instead of those of the clouds, and its attitudes where theirs
            are not known, or not whose axes they are of.

        Raises
        ------
        InputError
            As `mlscli.geometry.vertical.find_up`.
        """
        from mlscli.geometry.vertical import find_up

        points = self._sample.points
        return find_up(points, **self._of_craft(trajectory, points))

    def objection(self, upright: Upright, trajectory: Trajectory | None) -> str:
        """Return what speaks against the axis by which the points are turned; empty: nothing."""
        from mlscli.geometry.objection import objection
        from mlscli.geometry.surroundings import PointSample

        # Each once, in an order by chance.
        sample = PointSample(_DOUBTING)
        sample.add(upright.recorded(self._sample.points))
        points = sample.points
        return objection(upright.up, points, **self._of_craft(trajectory, points))

    def _of_craft(self, trajectory: Trajectory | None, points: Float64) -> dict[str, Any]:
        """Return where the craft was, its attitudes, and whose axes these are of."""
        route = np.array(self._positions).reshape(-1, 3)
        axes: Axes = next((a for a in ("camera", "body") if a in self._attitudes), "unknown")
        attitudes = np.array(self._attitudes.get(axes, [])).reshape(-1, 4)
        if trajectory is not None:
            route = trajectory.positions
            if axes == "unknown" and trajectory.attitudes is not None:
                attitudes = self._in_order(trajectory, trajectory.attitudes, points)
        return {"route": route, "attitudes": attitudes, "axes": axes}

    def _in_order(self, trajectory: Trajectory, attitudes: Float64, points: Float64) -> Float64:
        """Return attitudes in the order that the scene tells, where the file does not."""
        from mlscli.geometry.quaternions import CERTAIN, favour, otherwise

        if not trajectory.order:
            return attitudes
        others = otherwise(attitudes, trajectory.order)
        weight = favour(points, trajectory.positions, attitudes, others)
        order = trajectory.order
        if weight < -CERTAIN:
            order, attitudes = "w x y z" if order == "x y z w" else "x y z w", others
            why = f"the scene contradicts {trajectory.order}"
        else:
            why = "the scene does not tell"
        if abs(weight) < CERTAIN or order != trajectory.order:
            self.order_note = (
                f"{trajectory.path}: the quaternions are taken as {order}: {why}; a first line "
                "that names the columns, such as stamp x y z qw qx qy qz, says which it is"
            )
        return attitudes
