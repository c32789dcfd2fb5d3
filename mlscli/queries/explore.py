"""Where to fly next: what is uncertain of a map, and from where a look would settle it.

Around each region of `mlscli.queries.uncertain` places are tried: straight above it and in eight
directions, level with it and higher up, at several shares of the camera's range. From each, the
camera is turned to the middle of what is seen of the region. What it would see of all that is
uncertain is counted, by lines of sight past the patches of the map (`mlscli.queries.sights`).

The next view is that with the most cells for its way: a craft flies at a safe height above all
levels, goes down to the view, looks, and comes up again, so that a way is
``range + across + 2 * drop``. A craft must not meet anything on its way down
(`mlscli.queries.clearance`); if that space was never seen, the view counts half as much. Then all
that it would see is taken as settled, and the next one is chosen from there. Edges of the map come
last: what lies beyond them settles nothing within.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from mlscli.errors import UsageError, expect
from mlscli.maps.surface_map import SurfaceMap
from mlscli.queries.clearance import FITS, NEVER_SEEN, along, expect_craft
from mlscli.queries.exploration import BLIND, FREE, HIGH, Camera, Exploration, Region, View
from mlscli.queries.flown import with_flown
from mlscli.queries.levels import height_at
from mlscli.queries.sights import Hiding, in_sight
from mlscli.queries.uncertain import EDGE, KINDS, Uncertain, uncertain
from mlscli.runtime.arrays import Bool, Float64, Int64

# Where views are tried: directions around a region, how far up from level, in degrees, and how far
# away, in shares of the camera's range.
_AROUND, _UP, _FAR = 8, (0.0, 35.0, 65.0), (0.15, 0.3, 0.5)
# Views are tried for so many regions, the largest ones, and held against so many cells near each.
MOST_REGIONS, _MOST_CELLS = 200, 512
# From the safe height down to a view the craft may pass so many cells.
MOST_CELLS_DOWN = 100_000
# A view must settle so many cells.
_LEAST_GAIN = 4
# How much one counts by its way, see `WAYS`.
_BLOCKED, _OPEN = 3, 4
_WORTH = np.array([1.0, 1.0, 0.5, 0.0, 1.0])


def explore(
    surface: SurfaceMap,
    width: float,
    height: float,
    camera: Camera | None = None,
    *,
    most: int = 12,
    least: int = 2,
) -> Exploration:
    """Return what is uncertain of a map, and from where a look would settle it.

    Parameters
    ----------
    surface : SurfaceMap
    width, height : float
        The craft's diameter and height, as for `clearance`; in the unit of the map.
    camera : Camera, optional
        What it sees; by default ``Camera()``.
    most : int
        How many views are chosen at most.
    least : int
        So many sight lines show that a voxel is free.

    Raises
    ------
    TypeError, UsageError
        Where an argument is none of these, or out of range.
    """
    expect_craft(surface, width, height, least)
    expect(camera, (Camera, type(None)), "camera", "what it sees (Camera)")
    expect(most, (int, np.integer), "most", "a whole number")
    if most < 1:
        raise UsageError(f"`most` {most}: expected 1 or more")
    camera = (camera or Camera()).settled(surface)
    surface = with_flown(surface)
    if surface.size:
        low, high = float(surface.low_end.min()), float(surface.height.max())
        if high - low > MOST_CELLS_DOWN * surface.cell_size:
            cells = (high - low) / surface.cell_size
            raise UsageError(
                f"the map reaches from z {low:g} to {high:g}, {cells:.3g} cells; views are "
                f"sought in at most {MOST_CELLS_DOWN:,}: leave out what is stray, by `crop`"
            )
    found = uncertain(surface, camera.reach / 2, least)
    search = _Search(surface, found, camera, (width, height), least)
    views = tuple(search.views(most))
    return Exploration(
        camera, search.safe, search.begin, search.regions, views, len(search.tried), found
    )


class _Tries(NamedTuple):
    """Views that are tried for a region.

    Attributes
    ----------
    region : int
    place : float64 (V, 3)
    yaw, tilt : float64 (V,)
        In degrees.
    cell : int64 (C,)
        Cells nearby, of all regions, each of which stands for `weight` of them.
    sees : bool (V, C)
    weight : float
    way : int64 (V,)
        `HIGH`, `FREE` or `BLIND`; `_BLOCKED`: it cannot be flown; `_OPEN`: that was not asked yet.
    """

    region: int
    place: Float64
    yaw: Float64
    tilt: Float64
    cell: Int64
    sees: Bool
    weight: float
    way: Int64


class _Search:
    """Chooses views one by one."""

    def __init__(
        self,
        surface: SurfaceMap,
        found: Uncertain,
        camera: Camera,
        craft: tuple[float, float],
        least: int,
    ) -> None:
        self._surface, self._found, self._camera = surface, found, camera
        self._craft, self._least = craft, least
        self._place = found.places(surface.cell_size)
        self._hiding = Hiding.of(surface, least)
        self._open = np.ones(len(found.kind), dtype=np.bool_)
        self._start = np.searchsorted(
            found.region, np.arange(int(found.region.max(initial=-1)) + 2)
        )
        top = float(surface.height.max(initial=0.0)) if surface.size else 0.0
        self.safe = top + 2 * craft[1]
        self.begin = self._begin()
        self.regions = tuple(
            Region(int(found.kind[a]), b - a, tuple(self._place[a:b].mean(axis=0).tolist()))
            for a, b in zip(self._start[:-1].tolist(), self._start[1:].tolist(), strict=True)
        )
        sizes = np.array([region.cells for region in self.regions])
        self.tried = np.sort(np.argsort(-sizes, kind="stable")[:MOST_REGIONS]).tolist()

    def _begin(self) -> tuple[float, float, float]:
        route = self._surface.route[:, 1:]
        known = np.flatnonzero(np.isfinite(route).all(axis=1))
        if len(known):
            x, y, z = route[known[-1]].tolist()
        else:
            x, y = (
                (float(index.mean()) + 0.5) * self._surface.cell_size if len(index) else 0.0
                for index in (self._surface.ix, self._surface.iy)
            )
            z = self.safe
        return x, y, z

    def views(self, most: int) -> Iterator[View]:
        """Yield views in the order in which to fly them."""
        all_tries = [tries for tries in map(self._tries, self.tried) if len(tries.place)]
        at = np.array(self.begin[:2])
        for edges in (False, True):
            tries = [
                each for each in all_tries if (self.regions[each.region].kind == EDGE) == edges
            ]
            counts = (self._found.kind == EDGE) == edges
            while most > 0:
                chosen = self._next(tries, counts, at)
                if chosen is None:
                    break
                view = self._look(*chosen, at)
                at = np.array(view.place[:2])
                most -= 1
                yield view

    def _next(self, tries: list[_Tries], counts: Bool, at: Float64) -> tuple[_Tries, int] | None:
        """Return the view with the most cells for its way; None: there is none.

        Parameters
        ----------
        tries : list of _Tries
        counts : bool (N,)
            Which cells count.
        at : float64 (2,)
            Where the way begins.
        """
        while True:
            best, chosen = 0.0, None
            for each in tries:
                waiting = (self._open & counts)[each.cell]
                gains = each.weight * each.sees[:, waiting].sum(axis=1)
                across = np.hypot(*(each.place[:, :2] - at).T)
                drop = np.maximum(self.safe - each.place[:, 2], 0.0)
                score = gains * _WORTH[each.way] / (self._camera.reach + across + 2 * drop)
                score[gains < _LEAST_GAIN] = 0.0
                view = int(score.argmax())
                if score[view] > best:
                    best, chosen = float(score[view]), (each, view)
            if chosen is None:
                return None
            each, view = chosen
            if each.way[view] != _OPEN:
                return chosen
            each.way[view] = self._way(each.place[view])

    def _way(self, place: Float64) -> int:
        """Return what is known of the way down to a place from the safe height."""
        if place[2] >= self.safe:
            return HIGH
        above = np.array([place[0], place[1], self.safe])
        way = along(self._surface, np.stack((above, place)), *self._craft, self._least)
        return {FITS: FREE, NEVER_SEEN: BLIND}.get(way.overall, _BLOCKED)

    def _look(self, tries: _Tries, view: int, at: Float64) -> View:
        """Return a view, and take all that it sees as settled."""
        place, yaw, tilt = tries.place[view], float(tries.yaw[view]), float(tries.tilt[view])
        near = np.flatnonzero(self._open & (_far(self._place, place) <= self._camera.reach))
        near = near[self._sees(place[None], np.array([yaw]), np.array([tilt]), near)[0]]
        self._open[near] = False
        way = int(tries.way[view])
        # It is not chosen twice, whatever it does not see after all.
        tries.way[view] = _BLOCKED
        settled = np.bincount(self._found.kind[near], minlength=len(KINDS))
        below = height_at(self._surface, place[None, :2], float(place[2]))[0]
        return View(
            tries.region,
            tuple(place.tolist()),
            yaw,
            tilt,
            tuple(settled.tolist()),
            float(np.hypot(*(place[:2] - at))),
            max(self.safe - float(place[2]), 0.0),
            float(place[2] - below),
            way,
        )

    def _sees(self, place: Float64, yaw: Float64, tilt: Float64, cell: Int64) -> Bool:
        """Return which cells, by number, are seen from views, bool (V, C)."""
        reach, side = self._camera.reach, self._surface.cell_size
        seen = in_sight(self._hiding, side, place, self._place[cell], reach)
        return seen & self._in_cone(place, yaw, tilt, cell)

    def _in_cone(self, place: Float64, yaw: Float64, tilt: Float64, cell: Int64) -> Bool:
        turn, up = np.radians(yaw), np.radians(tilt)
        axis = np.column_stack((np.sin(up) * np.cos(turn), np.sin(up) * np.sin(turn), -np.cos(up)))
        off = self._place[cell] - place[:, None]
        far = np.sqrt((off * off).sum(axis=2))
        cosine = math.cos(math.radians(self._camera.field_of_view / 2))
        inside: Bool = (off * axis[:, None]).sum(axis=2) >= cosine * far
        return inside

    def _tries(self, region: int) -> _Tries:
        """Return the views that are tried for a region."""
        begin, end = self._start[region : region + 2].tolist()
        own = np.arange(begin, end)[:: -(-(end - begin) // _MOST_CELLS)]
        middle = np.array(self.regions[region].middle)
        place = middle + self._camera.reach * _offsets()
        side, reach = self._surface.cell_size, self._camera.reach
        seen = in_sight(self._hiding, side, place, self._place[own], reach)
        # Turned to the middle of what is seen of the region; level at most.
        count = np.maximum(seen.sum(axis=1), 1)[:, None]
        aim = (seen @ self._place[own]) / count - place
        aim[~seen.any(axis=1)] = (0.0, 0.0, -1.0)
        yaw = np.degrees(np.arctan2(aim[:, 1], aim[:, 0]))
        tilt = np.degrees(np.arctan2(np.hypot(aim[:, 0], aim[:, 1]), -aim[:, 2]))
        yaw, tilt = np.round(yaw, 1) + 0.0, np.minimum(np.round(tilt, 1), 90.0)
        near = np.flatnonzero(_far(self._place, middle) <= reach)
        stride = -(-len(near) // _MOST_CELLS) or 1
        near = near[::stride]
        useful = np.flatnonzero((seen & self._in_cone(place, yaw, tilt, own)).any(axis=1))
        place, yaw, tilt = place[useful], yaw[useful], tilt[useful]
        sees = self._sees(place, yaw, tilt, near)
        way = np.full(len(place), _OPEN)
        return _Tries(region, place, yaw, tilt, near, sees, float(stride), way)


def _offsets() -> Float64:
    """Return places around a region, in shares of the camera's range, float64 (V, 3)."""
    places = [(0.0, 0.0, far) for far in _FAR]
    for far in _FAR:
        for up in map(math.radians, _UP):
            for turn in np.arange(_AROUND) * (2 * math.pi / _AROUND):
                level = far * math.cos(up)
                places.append((level * math.cos(turn), level * math.sin(turn), far * math.sin(up)))
    return np.array(places)


def _far(places: Float64, place: Float64) -> Float64:
    """Return how far places (N, 3) are from one (3,), float64 (N,)."""
    far: Float64 = np.sqrt(((places - place) ** 2).sum(axis=1))
    return far
