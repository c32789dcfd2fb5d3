"""Reconstructions from photographs: cameras and the points they saw, as keyframes.

Each camera is a keyframe, in order, even one without points. A point belongs to the first camera
that saw it; points that no camera saw are a keyframe of their own, the last.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from mlscli.io.clouds.pointfile import Content
from mlscli.io.source import UNKNOWN_ATTITUDE, Cloud
from mlscli.keyframes.keyframe import UNKNOWN_POSITION
from mlscli.runtime.arrays import Float64, Int64
from mlscli.words import some, verb


class Camera(NamedTuple):
    """The pose of a camera and the time of its photograph; NaN where not known.

    Attributes
    ----------
    position : tuple of float
        x, y, z in the frame of the reconstruction (the world).
    stamp : float
        Seconds.
    attitude : tuple of float
        Quaternion x, y, z, w from the camera's axes to the world's.
    """

    position: tuple[float, float, float] = UNKNOWN_POSITION
    stamp: float = math.nan
    attitude: tuple[float, float, float, float] = UNKNOWN_ATTITUDE

    @classmethod
    def of(cls, rotation: Rotation, translation: Sequence[float]) -> Camera:
        """Return the camera of a transform R, t from the world to it; its position is -R^T t."""
        with np.errstate(all="ignore"):
            x, y, z = (-rotation.inv().apply(np.asarray(translation, dtype=np.float64))).tolist()
        qx, qy, qz, qw = rotation.inv().as_quat().tolist()
        return cls((x, y, z), attitude=(qx, qy, qz, qw))


def by_camera(
    path: Path, points: Float64, first: Int64, cameras: Sequence[Camera], losses: Sequence[str]
) -> Content:
    """Return the keyframes of a reconstruction.

    Parameters
    ----------
    path : Path
        The name of the reconstruction in notes.
    points : float64 (N, 3)
        Coordinates in the frame of the reconstruction.
    first : int64 (N,)
        Index of the first camera that saw each point; -1 where none did.
    cameras : sequence of Camera
        In the order of the keyframes.
    losses : sequence of str
        What could not be read.
    """
    order = np.argsort(first, kind="stable")
    ends = np.searchsorted(first[order], np.arange(-1, len(cameras)), side="right")
    unseen, *seen = np.split(points[order], ends[:-1])
    clouds = [
        Cloud(cloud, camera.stamp, camera.position, attitude=camera.attitude, axes="camera")
        for cloud, camera in zip(seen, cameras, strict=True)
    ]
    notes = []
    if len(unseen):
        clouds.append(Cloud(unseen))
        notes.append(
            f"{path}: {len(unseen):,} of {some(len(points), 'point')} "
            f"{verb(len(unseen), 'was', 'were')} seen by none of the images: a keyframe of "
            "its own, the last"
        )
    stamps = np.array([camera.stamp for camera in cameras], dtype=np.float64)
    return Content(clouds, notes, losses, stamps)
