"""A flight over a scene: keyframes of the points that a craft's camera finds.

Each point belongs to the first keyframe that sees it, as a visual SLAM triangulates a point once.
Points that no keyframe sees are not recorded.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mlscli.errors import UsageError
from mlscli.keyframes.keyframe import Keyframe
from mlscli.runtime.arrays import Float64, Int32
from mlscli.runtime.tree import Tree
from mlscli.scenes.noise import Chances, Noise, displace, scatter_outliers
from mlscli.scenes.route import CameraPoses, Site, fly_route, joined, poses_along, survey
from mlscli.scenes.sampling import Samples, outside_holes, sample
from mlscli.scenes.surfaces import Scene

BEGIN = 1_700_000_000.0
"""Time stamp of the first pose of a route, in seconds."""

INTERVAL_SECONDS = 0.5
"""Time from one pose of a route to the next, in seconds."""


@dataclass(frozen=True)
class Craft:
    """How a craft flies and what its camera sees.

    Attributes
    ----------
    height : float or None
        Height of the survey above the site's top, in its unit; None: the site's `usual_height`.
    field_of_view : float
        The whole angle of the cone that the camera sees, in degrees.
    range : float or None
        How far the camera sees, in the unit of the site; None: twice the distance from the survey,
        or a leg above it, down to the site's bottom.
    """

    height: float | None = None
    field_of_view: float = 120.0
    range: float | None = None

    @property
    def cosine(self) -> float:
        """The cosine of half the field of view."""
        return math.cos(math.radians(min(self.field_of_view, 360.0) / 2))

    def above(self, site: Site) -> float:
        """Return how high above its top the craft surveys a site.

        Raises
        ------
        UsageError
            Where `height` is not above 0.
        """
        if self.height is None:
            return site.usual_height
        if not (math.isfinite(self.height) and self.height > 0):
            raise UsageError(f"`route_height` {self.height:g}: expected a height above 0")
        return self.height

    def reach(self, site: Site) -> float:
        """Check field of view and range, and return how far the camera sees at a site.

        Raises
        ------
        UsageError
            Where a value is out of range.
        """
        if not 0 < self.field_of_view <= 360:
            raise UsageError(
                f"`field_of_view` {self.field_of_view:g}: expected degrees above 0, at most 360"
            )
        if self.range is None:
            low, high = site.bounds
            flown = [end[2] for leg in site.legs for end in (leg.start, leg.end)]
            return 2 * (max([float(high[2]) + self.above(site), *flown]) - float(low[2]))
        if not (math.isfinite(self.range) and self.range > 0):
            raise UsageError(f"`range` {self.range:g}: expected a distance above 0")
        return self.range


@dataclass(frozen=True, eq=False)
class Flight:
    """A recording made of a scene.

    Attributes
    ----------
    scene : Scene
        The scene flown over.
    keyframes : list of Keyframe
        The K keyframes that see something new, in the order flown.
    attitudes : float64 (K, 4)
        The craft's attitude at each keyframe: a quaternion x, y, z, w that rotates the craft's
        axes (x ahead, y left, z up) into the map's. Its camera looks along -z.
    """

    scene: Scene
    keyframes: list[Keyframe]
    attitudes: Float64

    @property
    def points(self) -> int:
        """How many points all keyframes hold."""
        return sum(len(keyframe.points) for keyframe in self.keyframes)


def fly(
    scene: Scene,
    grid: float = 0.1,
    noise: Noise | None = None,
    craft: Craft | None = None,
    *,
    holes: tuple[int, float] = (0, 0.0),
    seed: int = 0,
    visibility: bool = True,
    anew: bool = False,
    route: CameraPoses | None = None,
) -> Flight:
    """Fly over a scene.

    Parameters
    ----------
    scene : Scene
    grid : float
        Greatest spacing of the points on its surfaces, in the unit of the scene.
    noise : Noise, optional
        How points are displaced; by default ``Noise()``.
    craft : Craft, optional
        How the craft flies, and what its camera sees; by default ``Craft()``.
    holes : tuple of int and float
        How many round places are without texture, and their diameter in the unit of the scene.
    seed : int
        Seed of all random numbers, 0 or more; the same seed gives the same flight.
    visibility : bool
        Whether only points that a keyframe sees are recorded. Otherwise all points are, each by
        the nearest keyframe, as in the thesis's artificial clouds.
    anew : bool
        Whether the survey and each of the scene's legs find their points anew, each with its own
        error, as a craft does that looks again. Otherwise a point is found once.
    route : CameraPoses, optional
        Where the craft is instead, and looks; with `anew` each pose finds its points anew.

    Raises
    ------
    UsageError
        Where a value is out of range, the scene has no surface, or the camera sees nothing.
    """
    noise, craft = noise or Noise(), craft or Craft()
    if not scene.surfaces:
        raise UsageError(f"{scene.name}: has no surface to fly over")
    check(scene, noise, holes, seed)
    reach = craft.reach(scene)
    chances = Chances(seed)
    flights = _flights(scene, craft.above(scene), anew, route)
    samples = _with_features(scene, sample(scene, grid), holes, chances)
    keyframes, flown = [], 0
    for poses in flights:
        found = (
            _found(scene, samples, poses, craft.cosine, reach)
            if visibility
            else nearest(samples.xyz, poses)
        )
        keyframes.append(np.where(found < 0, found, found + np.int32(flown)))
        flown += len(poses.yaw)
    xyz = np.tile(samples.xyz, (len(flights), 1))
    sigma = _sigmas(scene, noise)[np.tile(samples.surface, len(flights))]
    keyframe, route = np.concatenate(keyframes), joined(flights)
    return Flight(scene, *recorded(scene, xyz, keyframe, route, sigma, noise, chances))


def _flights(
    scene: Scene, height: float, anew: bool, route: CameraPoses | None
) -> list[CameraPoses]:
    """Return the poses of each part of a flight that finds its points anew."""
    if route is not None:
        return route.parts() if anew else [route]
    if not anew:
        return [fly_route(scene, height)]
    legs = [survey(scene, height), *([leg] for leg in scene.legs)]
    return [poses_along(leg, height) for leg in legs]


def _found(
    scene: Scene, samples: Samples, poses: CameraPoses, cosine: float, reach: float
) -> Int32:
    """Return the number of the pose that first sees each sample, int32 (N,); -1: none."""
    from mlscli.scenes.visibility import first_seen

    return first_seen(
        scene, samples.xyz, samples.surface, poses.position, poses.direction, cosine, reach
    )


def check(site: Site, noise: Noise, holes: tuple[int, float], seed: int) -> None:
    """Check what a flight is asked for.

    Parameters
    ----------
    site : Scene or Scan
    noise : Noise
    holes : tuple of int and float
    seed : int
        As in `fly`.

    Raises
    ------
    UsageError
        Where a value is out of range.
    """
    noise.check()
    low, high = site.bounds
    if noise.outliers and low[2] == high[2]:
        raise UsageError(
            f"`outliers` {noise.outliers:g}: {site.name} is flat, and outliers are spread over "
            "the height of the scene"
        )
    count, diameter = holes
    if count < 0 or not (math.isfinite(diameter) and diameter >= 0):
        raise UsageError(f"`holes` {count},{diameter:g}: expected how many, and their diameter")
    if seed < 0:
        raise UsageError(f"`seed` {seed}: expected 0 or more")


def _with_features(
    scene: Scene, samples: Samples, holes: tuple[int, float], chances: Chances
) -> Samples:
    """Return the samples at which a camera finds a feature."""
    kept = chances.of("texture").random(len(samples.xyz)) < samples.texture
    kept &= outside_holes(scene, samples.xyz, *holes, chances.of("holes"))
    return Samples(samples.xyz[kept], samples.surface[kept], samples.texture[kept])


def nearest(xyz: Float64, poses: CameraPoses) -> Int32:
    """Return the number of the pose nearest to each point, int32 (N,)."""
    return Tree(poses.position).nearest(xyz, 1)[1][:, 0].astype(np.int32)


def _sigmas(scene: Scene, noise: Noise) -> Float64:
    """Return the horizontal and the vertical sigma of each surface, float64 (S, 2)."""
    return np.array([surface.scatter or noise.sigma for surface in scene.surfaces])


def recorded(
    site: Site,
    xyz: Float64,
    keyframe: Int32,
    poses: CameraPoses,
    sigma: Float64,
    noise: Noise,
    chances: Chances,
) -> tuple[list[Keyframe], Float64]:
    """Return the K keyframes that see points, with noise, and the attitudes, as in `Flight`.

    Parameters
    ----------
    site : Scene or Scan
        What is flown over.
    xyz : float64 (N, 3)
        The points, in the unit of the site.
    keyframe : int32 (N,)
        The number of the pose that sees each; points without one (-1) are left out.
    poses : CameraPoses
    sigma : float64 (N, 2)
        The horizontal and the vertical sigma of each.
    noise : Noise
        Its `sigma` is not used.
    chances : Chances
        Where the random numbers come from.

    Raises
    ------
    UsageError
        Where no point is seen.
    """
    xyz = displace(xyz, poses.position[np.maximum(keyframe, 0)], sigma, noise, chances)
    if noise.outliers:
        low, high = site.bounds
        xyz = scatter_outliers(xyz, noise.outliers, float(low[2]), float(high[2]), chances)
    xyz = xyz + 0.0
    order = np.argsort(keyframe, kind="stable")
    order = order[np.searchsorted(keyframe[order], 0) :]
    numbers, start = np.unique(keyframe[order], return_index=True)
    if not len(numbers):
        raise UsageError(
            f"{site.name}: the camera sees nothing; widen `range` or `field_of_view`, or lower "
            "`route_height`"
        )
    clouds = np.split(xyz[order], start[1:])
    keyframes = []
    for number, cloud in zip(numbers.tolist(), clouds, strict=True):
        x, y, z = poses.position[number].tolist()
        keyframes.append(Keyframe(cloud, BEGIN + INTERVAL_SECONDS * number, (x, y, z)))
    return keyframes, poses.attitude[numbers]
