"""Write the way along the views of an exploration as a plan of QGroundControl.

Of each view there is a waypoint above it at the safe height, one at it, with the heading and the
pitch of the gimbal to look where the view does, and the one above again. Altitudes are above sea
level. A plan has neither take-off nor landing: where these may be, the map does not know.

References
----------
QGroundControl, *Plan File Format*; MAVLink, ``MAV_CMD``.
"""

from __future__ import annotations

import json
import math
import os
from typing import Any, NamedTuple

import numpy as np

from mlscli.errors import UsageError
from mlscli.geometry.earth import radii
from mlscli.io.crs import on_earth
from mlscli.io.writing.atomic import atomic_write
from mlscli.maps.georeference import Georeference
from mlscli.queries.exploration import Exploration

# MAV_CMD_NAV_WAYPOINT and MAV_CMD_DO_MOUNT_CONTROL; MAV_FRAME_GLOBAL and MAV_FRAME_MISSION;
# targeting by the gimbal's own angles.
_WAYPOINT, _MOUNT, _GLOBAL, _MISSION, _ANGLES = 16, 205, 0, 2, 2
# QGroundControl's own numbers: altitudes above sea level; firmware PX4; a multicopter.
_ABOVE_SEA, _PX4, _MULTICOPTER = 2, 12, 2
_WAIT_SECONDS = 2.0
_SPEED = 2.0

FARTHEST = 10_000.0
"""So far from the origin (m), east and north are still those of a plane, to a few metres."""


class Origin(NamedTuple):
    """Where the origin of a map lies whose x points east, y north, in metres.

    Attributes
    ----------
    latitude, longitude : float
        In degrees, WGS84.
    altitude : float
        Above sea level, in metres.
    """

    latitude: float
    longitude: float
    altitude: float

    def at(self, x: float, y: float, z: float) -> tuple[float, float, float]:
        """Return latitude, longitude and altitude of a place of the map.

        Raises
        ------
        UsageError
            Where the origin is no place on Earth, or the place is too far from it.
        """
        if not (abs(self.latitude) < 89 and abs(self.longitude) <= 180):
            raise UsageError(
                f"`origin` {self.latitude:g},{self.longitude:g}: expected degrees of latitude, "
                "-89 to 89, and of longitude, -180 to 180"
            )
        if math.hypot(x, y) > FARTHEST:
            raise UsageError(
                f"`origin`: a view at {x:g},{y:g} is farther than {FARTHEST:,.0f} m from the "
                "origin of the map; a plan needs a map whose origin is near"
            )
        north, east = radii(self.latitude)
        east *= math.cos(math.radians(self.latitude))
        return (
            self.latitude + math.degrees(y / north),
            self.longitude + math.degrees(x / east),
            self.altitude + z,
        )

    def heading(self, place: tuple[float, float, float], yaw: float) -> float:  # noqa: ARG002
        """Return the compass heading (degrees) of a yaw in the map (degrees, from x towards y)."""
        return (90 - yaw) % 360


class OnEarth(NamedTuple):
    """A map whose frame lies in a reference system on Earth; needs pyproj.

    Attributes
    ----------
    georeference : Georeference
        Of the frame of the map; its heights are taken for altitudes above sea level.
    """

    georeference: Georeference

    def at(self, x: float, y: float, z: float) -> tuple[float, float, float]:
        """Return latitude, longitude and altitude of a place of the map.

        Raises
        ------
        UsageError
            As `mlscli.io.crs.on_earth`.
        """
        latitude, longitude, altitude = on_earth(
            self.georeference, np.array([(x, y, z)], dtype=np.float64)
        )[0].tolist()
        return latitude, longitude, altitude

    def heading(self, place: tuple[float, float, float], yaw: float) -> float:
        """Return the compass heading (degrees) of a yaw in the map (degrees, from x towards y).

        North of a projection is not that of a compass card: true north is meant.
        """
        x, y, z = place
        turn = math.radians(yaw)
        here, there = self.at(x, y, z), self.at(x + math.cos(turn), y + math.sin(turn), z)
        north, east = radii(here[0])
        east *= math.cos(math.radians(here[0]))
        along = east * (there[1] - here[1]), north * (there[0] - here[0])
        return math.degrees(math.atan2(*along)) % 360


def write_plan(
    path: str | os.PathLike[str],
    found: Exploration,
    origin: Origin | OnEarth,
    *,
    overwrite: bool = False,
) -> None:
    """Write a plan, whole or not at all.

    Parameters
    ----------
    path : path
        The file.
    found : Exploration
    origin : Origin or OnEarth
        Where the map lies.
    overwrite : bool
        Whether an existing file may be replaced.

    Raises
    ------
    UsageError
        Where there is no view, or as `at` of `origin`.
    OutputError
        Where the file exists and `overwrite` is False, or it cannot be written.
    """
    if not found.views:
        raise UsageError(f"{path}: no view was found, and a plan needs one at least")
    items: list[dict[str, Any]] = []
    for place, yaw, tilt in zip(*(each.tolist() for each in found.way()), strict=True):
        # Straight down is -90 degrees for a gimbal, level is 0.
        items.append(_item(len(items) + 1, _MOUNT, _MISSION, [tilt - 90, 0, 0, 0, 0, 0, _ANGLES]))
        where = origin.at(*place)
        wait = _WAIT_SECONDS if tilt else 0.0
        number, heading = len(items) + 1, origin.heading(place, yaw)
        waypoint = _item(number, _WAYPOINT, _GLOBAL, [wait, 0, 0, heading, *where])
        items.append(
            waypoint
            | {"AMSLAltAboveTerrain": None, "Altitude": where[2], "AltitudeMode": _ABOVE_SEA}
        )
    plan = {
        "fileType": "Plan",
        "geoFence": {"circles": [], "polygons": [], "version": 2},
        "groundStation": "QGroundControl",
        "mission": {
            "cruiseSpeed": _SPEED,
            "firmwareType": _PX4,
            "globalPlanAltitudeMode": _ABOVE_SEA,
            "hoverSpeed": _SPEED,
            "items": items,
            "plannedHomePosition": list(origin.at(*found.begin)),
            "vehicleType": _MULTICOPTER,
            "version": 2,
        },
        "rallyPoints": {"points": [], "version": 2},
        "version": 1,
    }
    with atomic_write(path, overwrite=overwrite) as stream:
        stream.write(f"{json.dumps(plan, indent=2)}\n".encode())


def _item(number: int, command: int, frame: int, params: list[float]) -> dict[str, Any]:
    return {
        "type": "SimpleItem",
        "autoContinue": True,
        "command": command,
        "doJumpId": number,
        "frame": frame,
        "params": params,
    }
