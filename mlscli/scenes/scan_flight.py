"""A flight over a scan: keyframes of the points of a dense cloud that a craft's camera finds."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mlscli.errors import UsageError
from mlscli.keyframes.keyframe import Keyframe
from mlscli.runtime.arrays import Float64, Int32, Int64
from mlscli.runtime.threads import WORTHWHILE, in_ranges
from mlscli.scenes.discs import in_sight
from mlscli.scenes.flight import Craft, check, nearest, recorded
from mlscli.scenes.noise import Chances, Noise
from mlscli.scenes.route import CameraPoses, poses_along
from mlscli.scenes.scan_route import find_legs
from mlscli.scenes.scans import Scan

FEATURES = 1000
"""How many features a camera finds at most, as ORB-SLAM2 does by default."""


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
    """

    scan: Scan
    keyframes: list[Keyframe]
    attitudes: Float64

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
    seed: int = 0,
    visibility: bool = True,
) -> ScanFlight:
    """Fly over a scan.

    Parameters
    ----------
    scan : Scan
    features : int
        How many features a keyframe finds at most.
    noise : Noise, optional
        How points are displaced; by default ``Noise()``.
    craft : Craft, optional
        How the craft flies, and what its camera sees; by default at `survey_height`.
    seed : int
        Seed of all random numbers, 0 or more; the same seed gives the same flight.
    visibility : bool
        Whether only points that a keyframe finds are recorded. Otherwise all points are, each by
        the nearest keyframe.

    Raises
    ------
    UsageError
        Where a value is out of range, or the camera sees nothing.
    """
    noise = noise or Noise()
    craft = craft or Craft(height=survey_height(scan))
    check(scan, noise, (0, 0.0), seed)
    if features < 1:
        raise UsageError(f"`features` {features}: expected 1 or more")
    reach = craft.reach(scan)
    legs = scan.legs or find_legs(scan, craft.height, reach, craft.field_of_view)
    poses = poses_along(legs, craft.height)
    chances = Chances(seed)
    if visibility:
        keyframe = _first_found(scan, poses, craft, reach, features, chances)
    else:
        keyframe = nearest(scan.xyz, poses)
    sigma = np.tile(np.array(noise.sigma), (len(scan.xyz), 1))
    return ScanFlight(scan, *recorded(scan, scan.xyz, keyframe, poses, sigma, noise, chances))


def survey_height(scan: Scan) -> float:
    """Return the height of a survey that takes some 200 keyframes."""
    low, high = scan.bounds
    return float(f"{math.sqrt(float(np.prod((high - low)[:2]))) / 10:.2g}")


def _first_found(
    scan: Scan, poses: CameraPoses, craft: Craft, reach: float, features: int, chances: Chances
) -> Int32:
    """Return the number of the first keyframe that finds each point, int32 (N,); -1: none.

    Parameters
    ----------
    scan : Scan
    poses : CameraPoses
    craft : Craft
    reach : float
        How far the camera sees.
    features : int
        How many points a keyframe finds at most.
    chances : Chances
    """
    area = np.maximum(np.minimum(scan.radius, 4 * scan.spacing), 1e-100) ** 2
    rarity = chances.of("features").exponential(size=len(area)) / (scan.texture * area)
    cosine = math.cos(math.radians(craft.field_of_view / 2))
    directions = poses.direction

    def work(begin: int, end: int) -> list[Int64]:
        found = []
        for number in range(begin, end):
            position, direction = poses.position[number], directions[number]
            away = scan.xyz - position
            square = (away * away).sum(axis=1)
            far = np.sqrt(square)
            chosen = np.flatnonzero((far <= reach) & (away @ direction >= cosine * far))
            order = np.argsort(rarity[chosen] * square[chosen], kind="stable")
            found.append(in_sight(scan.xyz, chosen[order], position, scan.discs, features))
        return found

    _ = scan.discs
    first = np.full(len(scan.xyz), -1, dtype=np.int32)
    parts = in_ranges(len(poses.position), work, weight=WORTHWHILE)
    views = [view for part in parts for view in part]
    for number, view in reversed(list(enumerate(views))):
        first[view] = number
    return first
