"""What is uncertain of a map, and where to look from: what `mlscli.queries.explore` finds."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mlscli.errors import UsageError
from mlscli.maps.surface_map import SurfaceMap
from mlscli.queries.uncertain import KINDS, Uncertain
from mlscli.runtime.arrays import Float64

HIGH, FREE, BLIND = 0, 1, 2
WAYS = ("high", "free", "never seen")
"""Of a view: it is no lower than the safe height; the craft fits all the way down to it; or it
meets nothing that the map knows of, but nobody looked."""


class Camera(NamedTuple):
    """What a camera sees: a cone, as that of `mls synth`.

    Attributes
    ----------
    field_of_view : float
        The whole angle of the cone, in degrees, above 0, at most 180.
    range : float or None
        How far it sees, in the unit of the map; None: twice as far as from the route's highest
        place down to the map's lowest, and no less than it saw half of the measured patches from
        where it first measured them.
    """

    field_of_view: float = 120.0
    range: float | None = None

    @property
    def reach(self) -> float:
        """How far it sees, once that is settled."""
        assert self.range is not None
        return self.range

    def settled(self, surface: SurfaceMap) -> Camera:
        """Check the camera, and return it with its range over a map.

        Raises
        ------
        UsageError
            Where a value is out of range, or the map does not say where the craft was.
        """
        angle, far = self
        if not 0 < angle <= 180:
            raise UsageError(f"`field_of_view` {angle:g}: expected above 0, at most 180 degrees")
        if far is None:
            known = surface.route[np.isfinite(surface.route[:, 1:]).all(axis=1), 3]
            far = 2 * float(known.max() - surface.low_end.min()) if len(known) * surface.size else 0
            # Of cameras that look up or across, heights tell nothing.
            far = max(far, _usual_distance(surface)) if len(known) else far
        if not surface.cell_size < far < math.inf:
            if self.range is None:
                raise UsageError(
                    "`range`: say how far the camera sees; the map does not tell how high the "
                    "craft flew"
                )
            raise UsageError(f"`range` {far:g}: expected more than a cell, {surface.cell_size:g}")
        return Camera(float(angle), float(far))


def _usual_distance(surface: SurfaceMap) -> float:
    """Return the median distance of measured patches from where they were first measured."""
    seen = surface.first_keyframe >= 0
    if not seen.any():
        return 0.0
    size = surface.cell_size
    columns = surface.ix[seen], surface.iy[seen]
    places = np.column_stack([*((axis + 0.5) * size for axis in columns), surface.height[seen]])
    crafts = surface.route[surface.first_keyframe[seen], 1:]
    away = np.linalg.norm(places - crafts, axis=1)
    away = away[np.isfinite(away)]
    return float(np.median(away)) if len(away) else 0.0


class Region(NamedTuple):
    """Cells of one kind of uncertainty that lie together.

    Attributes
    ----------
    kind : int
        `RED`, `HOLE`, `UNSEEN` or `EDGE` of `mlscli.queries.uncertain`.
    cells : int
        How many.
    middle : tuple of float
        x, y, z, the mean of their middles.
    """

    kind: int
    cells: int
    middle: tuple[float, float, float]


class View(NamedTuple):
    """A place to look from.

    Attributes
    ----------
    region : int
        The region that it looks at, of `Exploration.regions`.
    place : tuple of float
        x, y, z of the craft, in the frame of the map.
    yaw, tilt : float
        Where the camera looks, in degrees: from x towards y; up from straight down.
    sees : tuple of int
        How many cells it would see that no view before does, of each of `KINDS`.
    across : float
        How far it is from the view before, or from the end of the route, seen from above.
    drop : float
        How far below the safe height.
    ground : float
        How far above the highest level below it; NaN: there is none.
    way : int
        What is known of the way down to it: `HIGH`, `FREE` or `BLIND`.
    """

    region: int
    place: tuple[float, float, float]
    yaw: float
    tilt: float
    sees: tuple[int, ...]
    across: float
    drop: float
    ground: float
    way: int


@dataclass(frozen=True, eq=False)
class Exploration:
    """What is uncertain of a map, and where to look from.

    Attributes
    ----------
    camera : Camera
    safe : float
        The height at which the craft clears all levels of the map.
    begin : tuple of float
        Where the way begins: the end of the route; the middle of the map where it is not known.
    regions : tuple of Region
    views : tuple of View
        In the order in which to fly them.
    tried : int
        For how many regions, the largest, views were looked for.
    uncertain : Uncertain
        The cells of the regions.
    """

    camera: Camera
    safe: float
    begin: tuple[float, float, float]
    regions: tuple[Region, ...]
    views: tuple[View, ...]
    tried: int
    uncertain: Uncertain

    @property
    def cells(self) -> tuple[int, ...]:
        """Return how many cells are uncertain, of each of `KINDS`."""
        return tuple(
            sum(region.cells for region in self.regions if region.kind == kind)
            for kind in range(len(KINDS))
        )

    def way(self) -> tuple[Float64, Float64, Float64]:
        """Return the way of a craft along the views: to above each, down, and up again.

        Returns
        -------
        position : float64 (3 * V, 3)
            In the frame of the map. The places between are at the safe height, or as high as the
            view, if that is higher.
        yaw, tilt : float64 (3 * V,)
            Where the camera looks, as of `View`; above a view straight down.
        """
        rows = []
        for view in self.views:
            x, y, z = view.place
            above = (x, y, max(self.safe, z), view.yaw, 0.0)
            rows += [above, (x, y, z, view.yaw, view.tilt), above]
        position, yaw, tilt = np.split(np.array(rows).reshape(-1, 5), [3, 4], axis=1)
        return position, yaw.ravel(), tilt.ravel()

    @property
    def length(self) -> float:
        """How long the way is, from where it begins to above the last view, going down to each."""
        position = np.vstack((self.begin, self.way()[0]))
        return float(np.linalg.norm(np.diff(position, axis=0), axis=1).sum())
