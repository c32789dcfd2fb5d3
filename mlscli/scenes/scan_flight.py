"""A flight over a scan: keyframes of the features of a dense cloud that a craft's camera finds.

Each point has a luck of its own, an exponential random number. Of the points that a keyframe sees,
it finds those with the least luck / weight, as many as asked for: a draw without replacement by
weights (Efraimidis and Spirakis 2006, doi:10.1016/j.ipl.2005.11.003). The weight is the texture
times the solid angle under which the point's piece of surface would be seen from straight ahead.
So features are spread over the image, wherever the scanner stood, more of them where the surface
varies; and because luck stays with a point, the next keyframes find the same features again. As a
visual SLAM triangulates a point once, it belongs to the keyframe that finds it first.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mlscli.errors import UsageError
from mlscli.keyframes.keyframe import Keyframe
from mlscli.runtime.arrays import Bool, Float64, Int32, Int64
from mlscli.runtime.threads import WORTHWHILE, in_ranges
from mlscli.scenes.discs import in_frame, in_sight
from mlscli.scenes.flight import Craft, check, nearest, recorded
from mlscli.scenes.noise import Chances, Noise
from mlscli.scenes.route import CameraPoses
from mlscli.scenes.sampling import outside_balls
from mlscli.scenes.scan_route import find_route, share_seen
from mlscli.scenes.scans import Scan

FEATURES = 1000
"""How many features a camera finds at most, as is usual for a visual SLAM."""


@dataclass(frozen=True, eq=False)
class ScanFlight:
    """A recording made of a scan.

    Attributes
    ----------
    scan : Scan
        The scan flown over.
    keyframes : list of Keyframe
    attitudes : float64 (K, 4)
        As in `mlscli.scenes.flight.Flight`.
    range : float
        Median distance at which points are seen, in the unit of the scan.
    seen : float
        Share of the scan's area that at least one keyframe sees, 0 to 1, found from a sample.
    """

    scan: Scan
    keyframes: list[Keyframe]
    attitudes: Float64
    range: float
    seen: float

    @property
    def points(self) -> int:
        """How many points all keyframes hold."""
        return sum(len(keyframe.points) for keyframe in self.keyframes)


def fly_scan(
    scan: Scan,
    features: int = FEATURES,
    noise: Noise | None = None,
    craft: Craft | None = None,
    *,
    survey: bool | None = None,
    holes: tuple[int, float] = (0, 0.0),
    seed: int = 0,
    visibility: bool = True,
) -> ScanFlight:
    """Fly over a scan.

    Parameters
    ----------
    scan : Scan
    features : int
        How many points a keyframe finds at most, those that earlier ones have found among them.
    noise : Noise, optional
        How points are displaced; by default ``Noise()``.
    craft : Craft, optional
        How the craft flies, and what its camera sees; by default ``Craft()``.
    survey : bool, optional
        Whether the craft flies lanes above the scan; by default as `find_route` decides.
    holes : tuple of int and float
        How many round places are without texture, and their diameter in the unit of the scan.
    seed : int
        Seed of all random numbers, 0 or more; the same seed gives the same flight. The route does
        not depend on it.
    visibility : bool
        Whether only points that a keyframe finds are recorded. Otherwise all points are, each by
        the nearest keyframe.

    Raises
    ------
    UsageError
        Where a value is out of range, or the camera sees nothing.
    """
    noise, craft = noise or Noise(), craft or Craft()
    check(scan, noise, holes, seed)
    if features < 1:
        raise UsageError(f"`features` {features}: expected 1 or more")
    poses, chances = find_route(scan, craft, survey), Chances(seed)
    if visibility:
        luck = chances.of("features").exponential(size=len(scan.xyz))
        luck[~_textured(scan, holes, chances)] = np.inf
        keyframe = _first_found(scan, luck, poses, craft, features)
    else:
        keyframe = nearest(scan.xyz, poses)
        keyframe[~_textured(scan, holes, chances)] = -1
    found = keyframe >= 0
    ranges = np.linalg.norm(scan.xyz[found] - poses.position[keyframe[found]], axis=1)
    median = float(np.median(ranges)) if len(ranges) else 0.0
    if noise.kind == "slam" and noise.reference is None and median > 0:
        noise = replace(noise, reference=median)
    sigma = np.broadcast_to(np.array(noise.sigma), (len(scan.xyz), 2))
    keyframes, attitudes = recorded(scan, scan.xyz, keyframe, poses, sigma, noise, chances)
    seen = share_seen(scan, poses, craft) if visibility else 1.0
    return ScanFlight(scan, keyframes, attitudes, median, seen)


def _textured(scan: Scan, holes: tuple[int, float], chances: Chances) -> Bool:
    """Return which points lie outside of all holes, which are spread evenly by area, bool (N,)."""
    count, diameter = holes
    chosen = chances.of("holes").choice(len(scan.area), count, p=scan.area / scan.area.sum())
    return outside_balls(scan.xyz, scan.xyz[chosen], diameter)


def _first_found(
    scan: Scan, luck: Float64, poses: CameraPoses, craft: Craft, features: int
) -> Int32:
    """Return the number of the first keyframe that finds each point, int32 (N,); -1: none.

    Parameters
    ----------
    scan : Scan
    luck : float64 (N,)
        The points with the least luck, by their weight, are found; infinite: never.
    poses : CameraPoses
    craft : Craft
    features : int
        How many points a keyframe finds at most.
    """
    directions, reach = poses.direction, craft.reach(scan)
    rarity = luck / (scan.texture * scan.area)

    def work(begin: int, end: int) -> list[Int64]:
        views = []
        for number in range(begin, end):
            position = poses.position[number]
            ahead = in_frame(scan.xyz, position, directions[number], craft.cosine, reach)
            ahead = ahead[np.isfinite(rarity[ahead])]
            rank = rarity[ahead] * ((scan.xyz[ahead] - position) ** 2).sum(axis=1)
            views.append(_found(scan, ahead, rank, position, features))
        return views

    first = np.full(len(scan.xyz), -1, dtype=np.int32)
    parts = in_ranges(len(directions), work, weight=WORTHWHILE)
    views = [view for part in parts for view in part]
    for number in range(len(views) - 1, -1, -1):
        first[views[number]] = number
    return first


def _found(scan: Scan, ahead: Int64, rank: Float64, camera: Float64, features: int) -> Int64:
    """Return the points of the lowest rank that are seen, as many as asked for, int64 (M,).

    Parameters
    ----------
    scan : Scan
    ahead : int64 (A,)
        Indices of the points to choose from.
    rank : float64 (A,)
        Their ranks.
    camera : float64 (3,)
        Position of the camera.
    features : int
        How many are returned at most.
    """
    # Most are hidden or not needed: so few are sorted first, and more only where these do not do.
    some = 4 * features
    while True:
        first = np.argpartition(rank, some)[:some] if some < len(rank) else np.arange(len(rank))
        order = ahead[first[np.argsort(rank[first], kind="stable")]]
        found = in_sight(scan.xyz, order, camera, scan.discs, features)
        if len(found) == features or some >= len(rank):
            return found
        some *= 4
