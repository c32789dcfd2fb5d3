"""Write a recording as a ROS 1 bag, a ROS 2 bag or an MCAP file, as a craft would record it.

============== ======================= ==========================================================
topic          type                    content
============== ======================= ==========================================================
``/cloud``     sensor_msgs/PointCloud2 x, y, z in float64, a message for each keyframe
``/odom``      nav_msgs/Odometry       the craft in the map, at the same times
``/tf``        tf2_msgs/TFMessage      map -> base_link, at the same times
``/tf_static`` tf2_msgs/TFMessage      base_link -> camera, once
============== ======================= ==========================================================
"""

from __future__ import annotations

import math
import os
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from mlscli.errors import OutputError, UsageError, expect_path
from mlscli.io.ros import METADATA_FILE, NANOSECONDS
from mlscli.io.writing.atomic import behind, refuse_existing
from mlscli.io.writing.bag_messages import (
    CLOUD_TYPE,
    ODOMETRY_TYPE,
    TF,
    TF_STATIC,
    TF_TYPE,
    BagWriter,
    Kind,
)
from mlscli.keyframes.keyframe import Keyframe
from mlscli.runtime.arrays import Float64
from mlscli.runtime.interrupts import undisturbed
from mlscli.runtime.temporary import KEPT, temporary_folder

CLOUD, ODOMETRY = "/cloud", "/odom"
TOPICS = {TF_STATIC: TF_TYPE, TF: TF_TYPE, ODOMETRY: ODOMETRY_TYPE, CLOUD: CLOUD_TYPE}
MAP, BASE, CAMERA = "map", "base_link", "camera"

MOUNT = ((0.06, 0.0, -0.04), (0.5**0.5, -(0.5**0.5), 0.0, 0.0))
"""T_base_camera, translation and rotation: the camera looks down, the image's top ahead."""

_POINT = np.dtype([("x", "<f8"), ("y", "<f8"), ("z", "<f8")])


def write_bag(
    path: str | os.PathLike[str],
    keyframes: Sequence[Keyframe],
    attitudes: Float64,
    kind: Kind,
    *,
    sensor_frame: bool = False,
    overwrite: bool = False,
) -> None:
    """Write keyframes as a bag, whole or not at all.

    Parameters
    ----------
    path : path
        A file, or for ``ros2`` a folder; only a folder that is a ROS 2 bag is ever replaced.
    keyframes : sequence of Keyframe
        K of them, with times and positions.
    attitudes : float64 (K, 4)
        The attitude of the craft at each: a unit quaternion x, y, z, w from its axes to the map's.
    kind : {"ros1", "ros2", "mcap"}
    sensor_frame : bool
        Whether clouds are written in the frame of the camera, to be moved by the transforms;
        otherwise in that of the map, with the same bits as in the keyframes.
    overwrite : bool
        Whether an existing bag may be replaced.

    Raises
    ------
    OutputError
        Where `path` exists and `overwrite` is False, or it cannot be written.
    UsageError
        Where a time or a position is not known, or a time is negative.
    """
    for number, keyframe in enumerate(keyframes):
        if not np.isfinite((keyframe.stamp, *keyframe.position)).all() or keyframe.stamp < 0:
            raise UsageError(
                f"{path}: keyframe {number} has the time {keyframe.stamp} and the position "
                f"{keyframe.position}; a bag needs both known"
            )
    with (
        whole_bag(path, kind, overwrite=overwrite) as target,
        BagWriter(target, kind, TOPICS) as bag,
    ):
        for number, (keyframe, attitude) in enumerate(zip(keyframes, attitudes, strict=True)):
            stamp = nanoseconds(keyframe.stamp)
            if number == 0:
                bag.transform(TF_STATIC, stamp, BASE, CAMERA, *MOUNT)
            quaternion = attitude.tolist()
            bag.transform(TF, stamp, MAP, BASE, keyframe.position, quaternion)
            bag.odometry(ODOMETRY, stamp, (MAP, BASE), keyframe.position, quaternion)
            points = _in_camera(keyframe, attitude) if sensor_frame else keyframe.points
            records = np.ascontiguousarray(points, dtype="<f8").view(_POINT).reshape(-1)
            bag.cloud(CLOUD, stamp, CAMERA if sensor_frame else MAP, records)


def refuse_existing_bag(path: str | os.PathLike[str], kind: Kind, *, overwrite: bool) -> None:
    """Refuse to replace what exists, before any work is done for it.

    Raises
    ------
    OutputError
        As `refuse_existing`; a folder may be replaced where it is a ROS 2 bag.
    """
    target = Path(path)
    if kind != "ros2" or not target.is_dir():
        if kind == "ros2" and target.exists():
            raise OutputError(f"{target}: is a file, and a ROS 2 bag is a folder; name another")
        refuse_existing(target, overwrite=overwrite)
    elif not overwrite:
        raise OutputError(f"{target}: exists already; choose another name or add `overwrite`")
    elif not (target / METADATA_FILE).is_file():
        raise OutputError(
            f"{target}: is a folder without {METADATA_FILE}, and so no ROS 2 bag to be replaced; "
            "choose another name"
        )


@contextmanager
def whole_bag(
    path: str | os.PathLike[str], kind: Kind, *, overwrite: bool = False
) -> Iterator[Path]:
    """Yield a path for the writer that becomes `path` when the block ends without an error.

    Raises
    ------
    OutputError
        As `refuse_existing_bag`, and where the bag cannot be written.
    """
    expect_path(path, "path", "the bag to write")
    refuse_existing_bag(path, kind, overwrite=overwrite)
    target = behind(Path(path))
    try:
        # In a temporary folder the bag has its name from the beginning: its metadata hold it.
        with temporary_folder(target.parent, target.name) as folder:
            made = folder / (target.name if kind != "mcap" else "bag")
            yield made
            if kind == "mcap":
                # The writer makes a folder around the one file.
                made = made / "bag.mcap"
            refuse_existing_bag(path, kind, overwrite=overwrite)
            with undisturbed:
                _replace(target, made, folder / KEPT)
    except (OSError, sqlite3.Error) as error:
        raise _unwritable(target, error) from error


def _replace(target: Path, made: Path, aside: Path) -> None:
    """Rename what was made to the target; if that fails, restore a folder in its place."""
    if target.is_dir():
        target.rename(aside)
    try:
        made.replace(target)
    except OSError:
        if aside.exists():
            aside.rename(target)
        raise


def _unwritable(target: Path, error: Exception) -> OutputError:
    return OutputError(f"{target}: cannot be written: {getattr(error, 'strerror', None) or error}")


def nanoseconds(seconds: float) -> int:
    """Return a time in nanoseconds, without the rounding of one product of large numbers."""
    whole = math.floor(seconds)
    return whole * NANOSECONDS + round((seconds - whole) * NANOSECONDS)


def _in_camera(keyframe: Keyframe, attitude: Float64) -> Float64:
    """Return points (N, 3) in the camera's frame: by the inverse of T_map_base T_base_camera."""
    offset, rotation = MOUNT
    base: Float64 = (keyframe.points - np.array(keyframe.position)) @ _matrix(attitude)
    camera: Float64 = (base - np.array(offset)) @ _matrix(np.array(rotation))
    return camera + 0.0


def _matrix(quaternion: Float64) -> Float64:
    """Return the rotation matrix of a unit quaternion x, y, z, w."""
    x, y, z, w = quaternion.tolist()
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
