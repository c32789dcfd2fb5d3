"""COLMAP's sparse models: points3D and images, as text or binary.

The images, sorted by name, are the keyframes. An image's rotation (a quaternion, w first) and
translation take points of the world to the camera. (https://colmap.github.io/format.html)
"""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from mlscli.errors import InputError
from mlscli.io.clouds.cameras import Camera, by_camera
from mlscli.io.clouds.colmapreference import georeference_of
from mlscli.io.clouds.dialect import has_decimal_comma
from mlscli.io.clouds.pointfile import Content, PointFile, shortfall
from mlscli.io.clouds.rows import short
from mlscli.io.clouds.structures import Member, bytes_of, gather, read_structures
from mlscli.io.files import open_text_input
from mlscli.io.source import Cloud, side_by_side
from mlscli.runtime.arrays import Float64, Int64, UInt8
from mlscli.words import some, verb

_COUNT = struct.Struct("<Q")
_POINT = (
    Member("id", "u8"),
    *(Member(name, "f8") for name in "xyz"),
    *(Member(name, "u1") for name in ("red", "green", "blue")),
    Member("error", "f8"),
    # Each observation holds the number of an image, u4, and that of its feature, u4.
    Member("track", "V8", "u8"),
)
_XYZ_AND_TRACK = (1, 2, 3, 8)
_OBSERVATION = 8
# An image's number, rotation, translation and camera; its name and features follow.
_IMAGE = struct.Struct("<I4d3dI")
_FEATURE = 24
_LONGEST_NAME = 4096
_DECLARED = re.compile(r"#\s*Number of (?:points|images):\s*(\d{1,18})\b")


class ColmapModel(PointFile):
    """A model's folder, or its points3D file; images lie beside it.

    A point belongs to the first image that saw it. Without images, all points are one keyframe.
    """

    kind = "COLMAP model"

    def _read(self) -> Content:
        file = self._points_file()
        images_file = file.with_name(f"images{file.suffix}")
        binary = file.suffix == ".bin"
        if not images_file.exists():
            points, _, losses = (_binary_points if binary else _text_points)(file, {})
            note = f"{self.path}: no {images_file.name} beside {file.name}: all points are one "
            return Content([Cloud(points)], [f"{note}keyframe, and there is no route"], losses)
        images, lost = (_binary_images if binary else _text_images)(images_file)
        images.sort()
        ranks = {image.id: rank for rank, image in enumerate(images)}
        points, first, losses = (_binary_points if binary else _text_points)(file, ranks)
        content = by_camera(
            self.path, points, first, [image.camera for image in images], [*lost, *losses]
        )
        cameras = {image.name: image.camera.position for image in images}
        georeference, notes = georeference_of(file.parent, cameras)
        lost_places = sum(not np.isfinite(place).all() for place in cameras.values())
        if lost_places:
            notes = [
                f"{self.path}: {lost_places:,} of {some(len(cameras), 'image')} "
                f"{verb(lost_places, 'has', 'have')} no pose in numbers; where the camera was "
                "is not known of these",
                *notes,
            ]
        return content._replace(notes=[*content.notes, *notes], georeference=georeference)

    def _points_file(self) -> Path:
        """Return the file of points; in a folder the binary one, if there is one, as in COLMAP."""
        if self.path.is_dir():
            binary = self.path / "points3D.bin"
            return binary if binary.exists() else self.path / "points3D.txt"
        return self.path


class _Image(NamedTuple):
    """An image; sorts by name.

    Attributes
    ----------
    name : str
    id : int
        Its number in the model.
    camera : Camera
        Its pose.
    """

    name: str
    id: int
    camera: Camera


def _camera(pose: Sequence[float]) -> Camera:
    """Return the camera of a quaternion, w first, and a translation; unknown if not a rotation."""
    w, x, y, z, *translation = pose
    # False for NaN, too.
    if not 1e-6 < math.hypot(w, x, y, z) < 1e6:
        return Camera()
    return Camera.of(Rotation.from_quat([x, y, z, w]), translation)


# --- binary ---


def _binary_images(file: Path) -> tuple[list[_Image], list[str]]:
    data = bytes_of(file)
    declared, images, at = _declared(file, data), list[_Image](), _COUNT.size
    while len(images) < declared:
        name_at = at + _IMAGE.size
        name, ended, _ = data[name_at : name_at + _LONGEST_NAME].tobytes().partition(b"\0")
        features_at = name_at + len(name) + 1
        if not ended or features_at + _COUNT.size > len(data):
            break
        number, *pose, _ = _IMAGE.unpack_from(data.data, at)
        (features,) = _COUNT.unpack_from(data.data, features_at)
        at = features_at + _COUNT.size + features * _FEATURE
        images.append(_Image(name.decode("utf-8", "replace"), number, _camera(pose)))
    lost = len(images) < declared
    return images, [shortfall(file, len(images), declared, what="image")] if lost else []


def _binary_points(file: Path, ranks: dict[int, int]) -> tuple[Float64, Int64, list[str]]:
    data = bytes_of(file)
    declared = _declared(file, data)
    data = data[_COUNT.size :]
    count, (*xyz, tracks), _ = read_structures(data, _POINT, declared, _XYZ_AND_TRACK)
    lost = [shortfall(file, count, declared)] if count < declared else []
    return side_by_side(xyz), _first_images(data, tracks, ranks), lost


def _declared(file: Path, data: UInt8) -> int:
    if len(data) < _COUNT.size:
        raise InputError(
            f"{file}: holds {some(len(data), 'byte')}, expected at least 8: how many follow"
        )
    return int(_COUNT.unpack_from(data.data)[0])


def _first_images(data: UInt8, tracks: Int64, ranks: dict[int, int]) -> Int64:
    """Return the lowest rank of the images in each track, int64 (N,); -1 where none is known."""
    begin, lengths = tracks.T
    before = np.cumsum(lengths) - lengths
    at = np.repeat(begin - before * _OBSERVATION, lengths)
    at += np.arange(len(at)) * _OBSERVATION
    image, seen = np.unique(gather(data, at, "<u4"), return_inverse=True)
    unknown = len(ranks)
    rank = np.array([ranks.get(number, unknown) for number in image.tolist()], dtype=np.int64)
    first = np.full(len(tracks), unknown)
    np.minimum.at(first, np.repeat(np.arange(len(tracks)), lengths), rank[seen])
    return np.where(first == unknown, -1, first)


# --- text ---


def _text_images(file: Path) -> tuple[list[_Image], list[str]]:
    """Read images: each is a line, and a line of its features, which may be empty."""
    images, tally = list[_Image](), _DeclaredCount(file)
    with open_text_input(file) as lines:
        for line in lines:
            if tally.passes(line):
                continue
            words = line.split(maxsplit=9)
            try:
                pose = [float(word) for word in words[1:8]]
                # A name at the end of the file may be cut.
                if len(words) < 10 or not line.endswith("\n"):
                    raise ValueError
                images.append(_Image(words[9].strip(), int(words[0]), _camera(pose)))
            except ValueError:
                tally.fault(line)
            next(lines, "")
    return images, tally.losses(len(images), "image")


def _text_points(file: Path, ranks: dict[int, int]) -> tuple[Float64, Int64, list[str]]:
    """Read points, a line each: number, x, y, z, colour, error and track."""
    points, first, tally = list[list[float]](), list[int](), _DeclaredCount(file)
    unknown = len(ranks)
    with open_text_input(file) as lines:
        for line in lines:
            if tally.passes(line):
                continue
            words = line.split()
            try:
                if len(words) < 8:
                    raise ValueError
                point = [float(word) for word in words[1:4]]
                images = [int(word) for word in words[8::2]]
            except ValueError:
                tally.fault(line)
            else:
                points.append(point)
                first.append(min((ranks.get(image, unknown) for image in images), default=unknown))
    rank = np.array(first, dtype=np.int64)
    xyz = np.array(points, dtype=np.float64).reshape(-1, 3)
    return xyz, np.where(rank == unknown, -1, rank), tally.losses(len(points), "point")


class _DeclaredCount:
    """Skips the comments of a text; keeps the count that they declare, and broken lines."""

    def __init__(self, file: Path) -> None:
        self._file = file
        self._declared = 0
        self._broken: list[str] = []
        self._has_decimal_comma = False

    def passes(self, line: str) -> bool:
        """Return whether a line is blank or a comment; keep the count that it declares."""
        if declared := _DECLARED.match(line):
            self._declared = int(declared[1])
        return not line.strip() or line.startswith("#")

    def fault(self, line: str) -> None:
        """Keep a broken line."""
        if not self._broken:
            self._has_decimal_comma = any(map(has_decimal_comma, line.split()[:9]))
        self._broken.append(short(line.strip()))

    def losses(self, came: int, what: str) -> list[str]:
        """Return a line that says how many are missing; none where all came."""
        declared = max(self._declared, came + len(self._broken))
        fault = f"the first broken line is {self._broken[0]}" if self._broken else ""
        if self._has_decimal_comma:
            fault += ", expected decimal points"
        return [shortfall(self._file, came, declared, fault, what)] if came < declared else []
