"""Reconstructions of OpenSfM and OpenDroneMap: reconstruction.json and tracks.csv.

The shots, sorted by capture time, then by name, are the keyframes. A shot's rotation (an axis times
an angle in radians) and translation take points of the world to the camera. Each row of tracks.csv
begins with a shot and a point that it saw, separated by a tab; what follows depends on the version.
(https://opensfm.org/docs/dataset.html)
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from mlscli.errors import InputError
from mlscli.io.clouds.cameras import Camera, by_camera
from mlscli.io.clouds.opensfmreference import georeference_of
from mlscli.io.clouds.pointfile import Content, PointFile
from mlscli.io.files import open_text_input, read_input
from mlscli.io.source import Cloud
from mlscli.words import some

_LEAST_TRACK_COLUMNS = 8


class OpenSfmReconstruction(PointFile):
    """A reconstruction.json; without a tracks.csv beside it, all points are one keyframe."""

    kind = "OpenSfM reconstruction"

    def _read(self) -> Content:
        taken, notes = self._document()
        shots, points = taken["shots"], taken["points"]
        georeference, doubts = georeference_of(self.path, taken)
        notes += doubts
        tracks = self.path.with_name("tracks.csv")
        xyz = np.array(list(map(self._coordinates, points, points.values()))).reshape(-1, 3)
        if not tracks.exists():
            note = f"{self.path}: no tracks.csv beside it: all points are one keyframe, and there "
            notes.append(f"{note}is no route")
            return Content([Cloud(xyz)], notes, georeference=georeference)
        cameras = {name: _camera(shot) for name, shot in shots.items()}
        order = sorted(cameras, key=lambda name: (_time(cameras[name]), name))
        first, losses = self._first_shots(tracks, {name: k for k, name in enumerate(order)})
        content = by_camera(
            self.path,
            xyz,
            np.array([first.get(point, -1) for point in points], dtype=np.int64),
            [cameras[name] for name in order],
            losses,
        )
        notes += content.notes
        return content._replace(notes=notes, georeference=georeference)

    def _document(self) -> tuple[dict[str, Any], list[str]]:
        """Return the largest reconstruction, and a note if there are several.

        Raises
        ------
        InputError
            The file is not whole JSON, or lacks shots or points.
        """
        try:
            document = json.loads(read_input(self.path))
        # A ValueError also where the text is no UTF-8, or a number is too long.
        except (ValueError, RecursionError) as error:
            raise InputError(f"{self.path}: is no whole JSON file: {error}") from error
        found = document if isinstance(document, list) else [document]
        for reconstruction in found:
            for key in ("shots", "points"):
                if not isinstance(reconstruction, dict) or not isinstance(
                    reconstruction.get(key), dict
                ):
                    raise InputError(
                        f"{self.path}: found a reconstruction without {key}, expected an object "
                        f"with the objects shots and points"
                    )
        if not found:
            raise InputError(f"{self.path}: found an empty list, expected a reconstruction")
        largest = max(found, key=lambda reconstruction: len(reconstruction["shots"]))
        notes = []
        if len(found) > 1:
            notes.append(
                f"{self.path}: holds {len(found)} reconstructions, each in a frame of its own; "
                f"taken is the one with most shots, {len(largest['shots'])}, and "
                f"{some(len(largest['points']), 'point')}"
            )
        return largest, notes

    def _coordinates(self, name: str, point: Any) -> list[float]:
        try:
            x, y, z = map(float, point["coordinates"])
        except (KeyError, TypeError, ValueError, OverflowError):
            raise InputError(
                f"{self.path}: point {name[:40]}: found {str(point)[:60]}, expected coordinates: "
                "three numbers"
            ) from None
        return [x, y, z]

    def _first_shots(
        self, tracks: Path, ranks: Mapping[str, int]
    ) -> tuple[dict[str, int], list[str]]:
        """Return the lowest rank of the shots that saw each point, by point; and losses."""
        first: dict[str, int] = {}
        broken = 0
        with open_text_input(tracks) as lines:
            for line in lines:
                shot, _, rest = line.partition("\t")
                point, _, rest = rest.partition("\t")
                if rest.count("\t") < _LEAST_TRACK_COLUMNS - 3:
                    broken += bool(line.strip()) and not line.startswith("OPENSFM_TRACKS_VERSION")
                elif shot in ranks:
                    first[point] = min(ranks[shot], first.get(point, len(ranks)))
        return first, [f"{tracks}: broken rows, not used: {broken:,}"] if broken else []


def _camera(shot: Any) -> Camera:
    """Return the camera of a shot; what the shot does not state is NaN."""
    try:
        rotation, translation = (
            [float(value) for value in shot[key]] for key in ("rotation", "translation")
        )
        if len(rotation) != 3 or len(translation) != 3:
            raise ValueError
        with np.errstate(all="ignore"):
            camera = Camera.of(Rotation.from_rotvec(rotation), translation)
    except (KeyError, TypeError, ValueError, OverflowError):
        camera = Camera()
    try:
        stamp = float(shot["capture_time"])
    except (KeyError, TypeError, ValueError, OverflowError):
        stamp = 0.0
    return camera._replace(stamp=stamp if stamp > 0 and math.isfinite(stamp) else math.nan)


def _time(camera: Camera) -> float:
    """Return the time to sort a camera by; one without a time comes first."""
    return -math.inf if math.isnan(camera.stamp) else camera.stamp
