"""Drop points during a pass, and count them by reason."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from mlscli.io.plausibility.piles import pile, without_zeros
from mlscli.io.plausibility.rounding import lost_step
from mlscli.io.reading.tally import BEYOND, NO_RETURN, NOT_FINITE, REPEATED, Tally
from mlscli.io.source import Cloud
from mlscli.parameters.lengths import FARTHEST
from mlscli.runtime.arrays import Bool, Float64

if TYPE_CHECKING:
    from mlscli.io.reading.seen import SeenPoints

_Filter: TypeAlias = tuple[str, Callable[[Float64], Bool]]
# Why points are dropped, and a function that returns for points (N, 3) which are kept, (N,).


_LONGER = 1.25
"""Where a recording is so many times longer, one more cloud is looked at for piles and digits."""


class Sieve:
    """Drops points, and counts them by reason.

    Parameters
    ----------
    tally : Tally
        Where dropped points are counted.
    crop : six floats, optional
        xmin, xmax, ymin, ymax, zmin, zmax in the map frame, inclusive.
    cumulative : bool
        Keep a point only the first time that its exact coordinates, as recorded, appear.
    """

    def __init__(
        self, tally: Tally, crop: Sequence[float] | None = None, *, cumulative: bool = False
    ) -> None:
        self._tally = tally
        self._due = 0.0
        self._filters: list[_Filter] = []
        if crop is not None:
            low, high = np.array(crop, dtype=np.float64).reshape(3, 2).T

            def inside(points: Float64) -> Bool:
                return _on_all_axes((low <= points) & (points <= high))

            self._filters.append(("outside the crop", inside))
        self._seen: SeenPoints | None = None
        if cumulative:
            from mlscli.io.reading.seen import SeenPoints

            self._seen = SeenPoints()

    def returned(self, points: Float64) -> Float64:
        """Return points (N, 3), in their sensor's frame, without those at exactly (0, 0, 0)."""
        return self._kept(points, NO_RETURN, _on_any_axis(points != 0))

    def plausible(self, cloud: Cloud) -> Cloud:
        """Return a cloud, in a frame that is no sensor's, without points that pile up at zero.

        Of points that pile up elsewhere or are rounded `Tally` is told, but not of all clouds.
        """
        if cloud.is_sifted:
            return cloud
        found = without_zeros(cloud.points)
        kept = found.accepted(ValueError)
        if found.note:
            self._tally.zeros += len(kept) - int(np.count_nonzero(kept))
            cloud = replace(cloud, points=self._kept(cloud.points, NO_RETURN, kept))
        if self._tally.keyframes >= self._due:
            self._due = max(self._tally.keyframes + 1, _LONGER * self._tally.keyframes)
            self._tally.step = max(self._tally.step, lost_step(cloud.points))
            piled = pile(cloud.points)
            if piled.value and not self._tally.pile:
                self._tally.pile = (
                    f"{piled.note}, {piled.value:,} of the {len(cloud.points):,} of keyframe "
                    f"{self._tally.keyframes - 1:,}"
                )
        return cloud

    def measured(self, points: Float64, cloud: Cloud) -> Float64:
        """Return the points that are measured and pass the filters.

        Parameters
        ----------
        points : float64 (N, 3)
            In the map frame, without -0.0.
        cloud : Cloud
            The same points as recorded.
        """
        recorded = cloud.points
        unmeasured = () if all_measured(points) else _UNMEASURED
        for reason, keeps in (*unmeasured, *self._filters):
            kept = keeps(points)
            if self._seen is not None and not kept.all():
                recorded = recorded[kept]
            points = self._kept(points, reason, kept)
        if self._seen is not None:
            points = self._kept(points, REPEATED, self._seen.add(recorded + 0.0))
        self._tally.tell(cloud.unmeasured)
        return points

    def _kept(self, points: Float64, reason: str, kept: Bool) -> Float64:
        dropped = len(points) - int(np.count_nonzero(kept))
        if not dropped:
            return points
        self._tally.drop(reason, dropped)
        return points[kept]


def all_measured(points: Float64) -> bool:
    """Return whether all points are finite and near enough: the usual case, found out fast."""
    return not len(points) or bool(points.min() >= -FARTHEST and points.max() <= FARTHEST)


def _on_all_axes(holds: Bool) -> Bool:
    # Faster than a reduction of rows of three.
    return np.asarray(holds[:, 0] & holds[:, 1] & holds[:, 2])


def _on_any_axis(holds: Bool) -> Bool:
    return np.asarray(holds[:, 0] | holds[:, 1] | holds[:, 2])


_UNMEASURED: tuple[_Filter, ...] = (
    (NOT_FINITE, lambda points: _on_all_axes(np.isfinite(points))),
    (BEYOND, lambda points: _on_all_axes(np.abs(points) <= FARTHEST)),
)
