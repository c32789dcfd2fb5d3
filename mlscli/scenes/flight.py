"""A flight over a scene: keyframes of the points that a craft's camera finds.

A keyframe holds the points it is the first to see, as a visual SLAM triangulates a point once. What
no keyframe sees is not in the recording.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mlscli.errors import UsageError
from mlscli.keyframes.keyframe import Keyframe
from mlscli.runtime.arrays import Float64, Int32
from mlscli.scenes.noise import Chances, Noise, displace, scatter_outliers
from mlscli.scenes.route import CameraPoses, fly_route
from mlscli.scenes.sampling import Samples, outside_holes, sample
from mlscli.scenes.surfaces import Scene

BEGIN = 1_700_000_000.0
INTERVAL_SECONDS = 0.5
"""Seconds from keyframe to keyframe."""


@dataclass(frozen=True)
class Craft:
    """How a craft flies and what its camera sees.

    Attributes
    ----------
    height : float
        Of the survey above the scene's top.
    field_of_view : float
        The whole angle of the cone that the camera sees, in degrees.
    range : float or None
        How far it sees; None: twice as far as from the survey down to the scene's bottom.
    """

    height: float = 1.5
    field_of_view: float = 120.0
    range: float | None = None

    def reach(self, scene: Scene) -> float:
        """Return how far the camera sees in a scene, checked with the field of view.

        Raises
        ------
        UsageError
            Naming the option at fault.
        """
        if not 0 < self.field_of_view <= 360:
            raise UsageError(
                f"`field_of_view` {self.field_of_view:g}: expected degrees above 0, at most 360"
            )
        if self.range is None:
            low, high = scene.bounds
            return 2 * (self.height + float(high[2] - low[2]))
        if not (math.isfinite(self.range) and self.range > 0):
            raise UsageError(f"`range` {self.range:g}: expected a distance above 0")
        return self.range


@dataclass(frozen=True, eq=False)
class Flight:
    """A recording made of a scene.

    Attributes
    ----------
    scene : Scene
    keyframes : list of Keyframe
        Those that see something new, in the order flown.
    attitudes : float64 (K, 4)
        The craft's attitude at each of them: a quaternion x, y, z, w from its axes (x ahead,
        y left, z up) to the map's. Its camera looks along -z.
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
) -> Flight:
    """Fly over a scene.

    Parameters
    ----------
    scene : Scene
    grid : float
        Spacing of the points on its surfaces.
    noise : Noise, optional
        How they are displaced; by default as in `Noise`.
    craft : Craft, optional
        How it flies, and what its camera sees; by default as in `Craft`.
    holes : tuple
        How many round places are without texture, and their diameter.
    seed : int
        Of all chance; the same seed gives the same flight.
    visibility : bool
        Whether only what a keyframe sees is recorded. Otherwise every point is, by the nearest
        keyframe, as in the thesis's artificial clouds.

    Raises
    ------
    UsageError
        Where a value is out of range, or nothing is seen.
    """
    noise, craft = noise or Noise(), craft or Craft()
    _check(scene, noise, holes, seed)
    reach = craft.reach(scene)
    chances = Chances(seed)
    poses = fly_route(scene, craft.height)
    samples = _with_features(scene, sample(scene, grid), holes, chances)
    if visibility:
        from mlscli.scenes.visibility import first_seen

        keyframe = first_seen(
            scene,
            samples.xyz,
            samples.surface,
            poses.position,
            poses.direction,
            craft.field_of_view,
            reach,
        )
    else:
        keyframe = _nearest(samples.xyz, poses)
    xyz = displace(
        samples.xyz,
        poses.position[np.maximum(keyframe, 0)],
        _sigmas(scene, noise)[samples.surface],
        noise,
        chances,
    )
    if noise.outliers:
        low, high = scene.bounds
        xyz = scatter_outliers(xyz, noise.outliers, float(low[2]), float(high[2]), chances)
    return _recorded(scene, xyz + 0.0, keyframe, poses)


def _check(scene: Scene, noise: Noise, holes: tuple[int, float], seed: int) -> None:
    noise.check()
    if not scene.surfaces:
        raise UsageError(f"{scene.name}: has no surface to fly over")
    low, high = scene.bounds
    if noise.outliers and low[2] == high[2]:
        raise UsageError(
            f"`outliers` {noise.outliers:g}: {scene.name} is flat, and outliers are spread over "
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
    """Return the points at which a camera finds a feature."""
    kept = chances.of("texture").random(len(samples.xyz)) < samples.texture
    kept &= outside_holes(scene, samples.xyz, *holes, chances.of("holes"))
    return Samples(samples.xyz[kept], samples.surface[kept], samples.texture[kept])


def _nearest(xyz: Float64, poses: CameraPoses) -> Int32:
    from scipy.spatial import cKDTree

    _, nearest = cKDTree(poses.position).query(xyz)
    return np.asarray(nearest, dtype=np.int32)


def _sigmas(scene: Scene, noise: Noise) -> Float64:
    """Return the horizontal and the vertical sigma of each surface."""
    return np.array([surface.scatter or noise.sigma for surface in scene.surfaces])


def _recorded(scene: Scene, xyz: Float64, keyframe: Int32, poses: CameraPoses) -> Flight:
    """Return the flight: the points in the order of their keyframes, unseen ones left out."""
    order = np.argsort(keyframe, kind="stable")
    order = order[np.searchsorted(keyframe[order], 0) :]
    numbers, start = np.unique(keyframe[order], return_index=True)
    if not len(numbers):
        raise UsageError(
            f"{scene.name}: the camera sees nothing; widen `range` or `field_of_view`, or lower "
            "`route_height`"
        )
    clouds = np.split(xyz[order], start[1:])
    keyframes = []
    for number, cloud in zip(numbers.tolist(), clouds, strict=True):
        x, y, z = poses.position[number].tolist()
        keyframes.append(Keyframe(cloud, BEGIN + INTERVAL_SECONDS * number, (x, y, z)))
    return Flight(scene, keyframes, poses.attitude[numbers])
