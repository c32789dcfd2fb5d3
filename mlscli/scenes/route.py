"""The route of a craft and where its camera looks: a survey from above, then the scene's legs."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from mlscli.errors import UsageError
from mlscli.geometry.poses import looking, looks_of
from mlscli.runtime.arrays import Float64
from mlscli.scenes.surfaces import Leg

# Distance of the lanes, and of the keyframes, in heights of the survey above the scene's top.
LANE, STEP = 1.5, 0.5
MAX_POSES = 1_000_000


class Site(Protocol):
    """What a craft flies over: a scene or a scan."""

    @property
    def name(self) -> str:
        """What messages call it."""

    @property
    def bounds(self) -> tuple[Float64, Float64]:
        """Its least and greatest x, y, z, float64 (3,) each."""

    @property
    def legs(self) -> tuple[Leg, ...]:
        """What the craft flies after the survey from above."""

    @property
    def usual_height(self) -> float:
        """How high above its top a craft usually flies."""


@dataclass(frozen=True, eq=False)
class CameraPoses:
    """Positions of the craft and directions of its camera, one for each keyframe.

    Attributes
    ----------
    position : float64 (K, 3)
        Position of the craft, in the unit of the scene.
    yaw, tilt : float64 (K,)
        In radians: the camera's horizontal direction, from x towards y; how far it looks up from
        straight down.
    """

    position: Float64
    yaw: Float64
    tilt: Float64

    @property
    def direction(self) -> Float64:
        """The unit vectors along which the camera looks, float64 (K, 3)."""
        level = np.sin(self.tilt)
        return np.column_stack(
            (level * np.cos(self.yaw), level * np.sin(self.yaw), -np.cos(self.tilt))
        )

    @property
    def attitude(self) -> Float64:
        """The attitudes of the craft, quaternions x, y, z, w, float64 (K, 4).

        The craft heads along the yaw, its nose up by the tilt: the camera is fixed to it and looks
        straight down where the craft is level.
        """
        return looking(self.yaw, self.tilt)

    def parts(self) -> list[CameraPoses]:
        """Return each pose as a route of its own."""
        rows = (slice(row, row + 1) for row in range(len(self.yaw)))
        return [CameraPoses(self.position[row], self.yaw[row], self.tilt[row]) for row in rows]


def poses_of(position: Float64, attitude: Float64 | None) -> CameraPoses:
    """Return the poses of a craft that flies as stated.

    Parameters
    ----------
    position : float64 (K, 3)
    attitude : float64 (K, 4) or None
        Unit quaternions x, y, z, w from the craft's axes (x ahead, y left, z up) to the map's; its
        camera looks along -z. None: it looks straight down, and ahead to the next place.
    """
    if attitude is None:
        step = np.diff(position[:, :2], axis=0, append=position[-1:, :2])
        return CameraPoses(position, np.arctan2(step[:, 1], step[:, 0]), np.zeros(len(position)))
    return CameraPoses(position, *looks_of(attitude))


def fly_route(site: Site, height: float) -> CameraPoses:
    """Return the poses of a flight: lanes over the whole site, then its legs.

    Parameters
    ----------
    site : Scene or Scan
    height : float
        Height of the lanes above the site's top, in its unit. Lanes are at most 1.5 heights apart,
        keyframes at most half a height.

    Raises
    ------
    UsageError
        Where `height` is so small that the keyframes are too many.
    """
    return poses_along([*survey(site, height), *site.legs], height)


def poses_along(legs: Iterable[Leg], height: float) -> CameraPoses:
    """Return the poses on legs, at most half a `height` apart on each, from its start to its end.

    Raises
    ------
    UsageError
        Where `height` is so small that the keyframes are too many.
    """
    legs = list(legs)
    step = STEP * height
    length = sum(math.dist(leg.start, leg.end) for leg in legs)
    if length / step > MAX_POSES:
        raise UsageError(
            f"`route_height` {height:g}: keyframes half of it apart are more than {MAX_POSES} on "
            f"legs of {length:g}; fly higher"
        )
    return _along(legs, step)


def joined(routes: Iterable[CameraPoses]) -> CameraPoses:
    """Return the poses of several routes, one after another."""
    routes = list(routes)
    return CameraPoses(
        np.concatenate([route.position for route in routes]),
        np.concatenate([route.yaw for route in routes]),
        np.concatenate([route.tilt for route in routes]),
    )


def survey(site: Site, height: float) -> list[Leg]:
    """Return parallel lanes over a site, flown in turns there and back, looking straight down.

    They reach half the distance of two lanes beyond the site on each side.

    Raises
    ------
    UsageError
        Where `height` is so small that the keyframes are too many.
    """
    low, high = site.bounds
    area = float(np.prod((high - low)[:2] + 2 * LANE * height))
    if area / (LANE * STEP * height * height) > MAX_POSES:
        raise UsageError(
            f"`route_height` {height:g}: so low over {site.name}, a survey takes more than "
            f"{MAX_POSES} keyframes; fly higher"
        )
    lane, z = LANE * height, float(high[2]) + height
    longer = int(high[1] - low[1] > high[0] - low[0])
    shorter = 1 - longer
    first, last = low - lane / 2, high + lane / 2
    lanes = math.ceil((last[shorter] - first[shorter]) / lane) + 1
    legs = []
    for number, place in enumerate(np.linspace(first[shorter], last[shorter], lanes)):
        ends = np.full((2, 3), z)
        ends[:, shorter] = place
        ends[:, longer] = (first[longer], last[longer])
        start, end = ends.tolist() if number % 2 == 0 else ends[::-1].tolist()
        legs.append(Leg(tuple(start), tuple(end)))
    return legs


def _along(legs: Iterable[Leg], step: float) -> CameraPoses:
    """Return poses at most a step apart on each leg, from its start to its end."""
    positions, yaws, tilts = [], [], []
    for leg in legs:
        start, end = np.array(leg.start), np.array(leg.end)
        count = max(2, math.ceil(math.dist(leg.start, leg.end) / step) + 1)
        positions.append(start + np.linspace(0.0, 1.0, count)[:, None] * (end - start))
        ahead = math.atan2(end[1] - start[1], end[0] - start[0])
        yaws.append(np.full(count, ahead + math.radians(leg.yaw)))
        tilts.append(np.full(count, math.radians(leg.tilt)))
    return CameraPoses(np.concatenate(positions) + 0.0, np.concatenate(yaws), np.concatenate(tilts))
