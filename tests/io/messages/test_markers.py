"""Clouds drawn as markers.

How these tests could be cheated: with poses that are identities, scales of one, or turns that
look the same both ways round. So expectations are computed by hand for a quarter turn, and
every type, action and scale is tried.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from mlscli.io.messages.decoding import Deserializer
from mlscli.io.messages.registry import CLOUD_TYPES, CloudPart
from tests.helpers.ros import ENCODINGS, header, serialized, vector

MARKER, ARRAY = "visualization_msgs/msg/Marker", "visualization_msgs/msg/MarkerArray"
ARROW, CUBE, SPHERE, CYLINDER, LINE_STRIP, LINE_LIST = range(6)
CUBE_LIST, SPHERE_LIST, POINTS, TEXT, MESH, TRIANGLE_LIST = range(6, 12)

# A quarter turn about z: x becomes y, y becomes -x.
TURN = vector(0, 0, np.sqrt(0.5), np.sqrt(0.5))


def marker(type_: int, **changes: Any) -> dict[str, Any]:
    return {
        "header": header(7, 500_000_000, "map"),
        "type": type_,
        "pose": {"orientation": vector(0, 0, 0, 1)},
        "scale": vector(0.1, 0.2, 0.3),
        **changes,
    }


def decode(encoding: str, *markers: dict[str, Any]) -> list[CloudPart]:
    message = serialized(encoding, ARRAY, {"markers": list(markers)})
    parts = CLOUD_TYPES[ARRAY](Deserializer().read(message))
    if len(markers) == 1:
        alone = serialized(encoding, MARKER, markers[0])
        assert str(CLOUD_TYPES[MARKER](Deserializer().read(alone))) == str(parts)
    return parts


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("type_", [POINTS, SPHERE_LIST, CUBE_LIST])
def test_the_points_of_a_list_are_moved_by_its_pose_and_not_scaled(
    encoding: str, type_: int
) -> None:
    pose = {"position": vector(10, 20, 30), "orientation": TURN}
    points = [vector(1, 0, 0), vector(0, 2, 0), vector(0, 0, 3)]

    (part,) = decode(encoding, marker(type_, pose=pose, points=points))

    expected = [[10, 21, 30], [8, 20, 30], [10, 20, 33]]
    np.testing.assert_allclose(part.points, expected, atol=1e-14)
    assert (part.frame_id, part.stamp, part.skipped) == ("map", 7.5, 0)


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("type_", [SPHERE, CUBE])
def test_a_sphere_or_cube_is_its_centre(encoding: str, type_: int) -> None:
    pose = {"position": vector(1, -2, 3.5), "orientation": TURN}

    (part,) = decode(encoding, marker(type_, pose=pose, points=[vector(9, 9, 9)]))

    assert part.points.tolist() == [[1, -2, 3.5]]


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize(
    ("quaternion", "expected"),
    [
        (vector(0, 0, 0, 0), [1, 2, 3]),
        (vector(0, 0, 0, -1), [1, 2, 3]),
        (vector(0, 0, 5, 5), [-2, 1, 3]),
        (vector(1, 0, 0, 0), [1, -2, -3]),
        (vector(0, -3, 0, 0), [-1, 2, -3]),
    ],
)
def test_orientations_need_not_be_filled_in_or_of_length_one(
    encoding: str, quaternion: dict[str, float], expected: list[float]
) -> None:
    pose = {"orientation": quaternion}

    (part,) = decode(encoding, marker(POINTS, pose=pose, points=[vector(1, 2, 3)]))

    np.testing.assert_allclose(part.points, [expected], atol=1e-14)


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_markers_that_do_not_turn_keep_every_bit(encoding: str) -> None:
    points = np.random.default_rng(0).normal(scale=1e5, size=(50, 3))

    (part,) = decode(encoding, marker(POINTS, points=[vector(*p) for p in points.tolist()]))

    assert part.points.tolist() == points.tolist()


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("type_", [ARROW, CYLINDER, LINE_STRIP, LINE_LIST, TEXT, MESH, 12, -1])
def test_markers_of_other_types_are_skipped_and_counted(encoding: str, type_: int) -> None:
    sphere = marker(SPHERE, pose={"position": vector(1, 2, 3)})
    other = marker(type_, points=[vector(9, 9, 9)])

    (part,) = decode(encoding, other, sphere, other)

    assert part.points.tolist() == [[1, 2, 3]]
    assert part.skipped == 2


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("action", [1, 2, 3])
def test_what_is_deleted_is_no_point(encoding: str, action: int) -> None:
    assert decode(encoding, marker(SPHERE, action=action)) == []


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_markers_of_one_frame_and_time_are_one_part_in_their_order(encoding: str) -> None:
    def at(x: float, seconds: int, frame: str) -> dict[str, Any]:
        pose = {"position": vector(x, 0, 0)}
        return marker(SPHERE, header=header(seconds, 0, frame), pose=pose)

    parts = decode(encoding, at(1, 5, "map"), at(2, 6, "map"), at(3, 5, "map"), at(4, 5, "odom"))

    assert [(p.frame_id, p.stamp, p.points[:, 0].tolist()) for p in parts] == [
        ("map", 5, [1, 3]),
        ("map", 6, [2]),
        ("odom", 5, [4]),
    ]


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("quaternion", [vector(np.nan, 0, 0, 1), vector(np.inf, 0, 0, 1)])
def test_a_pose_that_is_no_number_makes_points_that_are_none(
    encoding: str, quaternion: dict[str, float]
) -> None:
    pose = {"orientation": quaternion}

    (part,) = decode(encoding, marker(POINTS, pose=pose, points=[vector(1, 2, 3)]))

    assert not np.isfinite(part.points).any()
