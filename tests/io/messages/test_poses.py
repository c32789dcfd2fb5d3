"""Messages that tell where something is.

How these tests could be cheated: with one quaternion for all, frames that are alike, or by
dropping in silence what cannot be used. So rows differ, and what is refused is counted.
"""

from __future__ import annotations

import math
from itertools import chain
from typing import Any

import numpy as np
import pytest

from mlscli.io.messages.decoding import Deserializer
from mlscli.io.messages.poses import TRANSFORM_TYPES, stamped
from mlscli.io.messages.registry import MalformedCloudError
from mlscli.io.source import StampedPoses
from tests.helpers import foxglove
from tests.helpers.decoders import POSES
from tests.helpers.ros import ENCODINGS, header, serialized, vector

ODOMETRY, PATH = "nav_msgs/msg/Odometry", "nav_msgs/msg/Path"
STAMPED = "geometry_msgs/msg/TransformStamped"
POSE = {"position": vector(1, -2, 3.5), "orientation": vector(0.5, -0.5, 0.5, 0.5)}
HEADER = header(1_700_000_000, 500_000_000, "odom")
TF_TYPES = ["tf2_msgs/msg/TFMessage", "tf/msg/tfMessage"]


def decode(encoding: str, type_: str, content: dict[str, Any]) -> list[StampedPoses]:
    message = serialized(encoding, type_, content)
    return POSES[type_](Deserializer().read(message))


def transform(parent: str, child: str, seconds: int, x: float, **changes: Any) -> dict[str, Any]:
    turn = {"translation": vector(x, 0, 0), "rotation": vector(0, 0, 0, 1), **changes}
    return {"header": header(seconds, 0, parent), "child_frame_id": child, "transform": turn}


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize(
    ("type_", "content", "child"),
    [
        (ODOMETRY, {"child_frame_id": "base", "pose": {"pose": POSE}}, "base"),
        ("geometry_msgs/msg/PoseStamped", {"pose": POSE}, ""),
        ("geometry_msgs/msg/PoseWithCovarianceStamped", {"pose": {"pose": POSE}}, ""),
        (PATH, {"poses": [{"header": HEADER, "pose": POSE}]}, ""),
        (
            STAMPED,
            {
                "child_frame_id": "base",
                "transform": {"translation": POSE["position"], "rotation": POSE["orientation"]},
            },
            "base",
        ),
    ],
)
def test_a_pose_is_read_with_its_frames_and_time(
    encoding: str, type_: str, content: dict[str, Any], child: str
) -> None:
    (poses,) = decode(encoding, type_, {"header": HEADER, **content})

    assert poses.stamps.tolist() == [1_700_000_000.5]
    assert poses.translations.tolist() == [[1, -2, 3.5]]
    assert poses.quaternions.tolist() == [[0.5, -0.5, 0.5, 0.5]]
    assert (poses.parent, poses.child, poses.refused) == ("odom", child, 0)
    assert all(array.dtype == np.float64 for array in poses[:3])


@pytest.mark.parametrize("spelling", foxglove.SPELLINGS)
def test_a_pose_in_a_frame_is_read_in_every_spelling(spelling: str) -> None:
    stamp = {"sec": 4, "nsec": 750_000_000}
    content = {"timestamp": stamp, "frame_id": "odom", "pose": POSE}
    message = foxglove.message(spelling, "PoseInFrame", content)

    (poses,) = POSES[message.channel.type](Deserializer().read(message))

    assert poses.stamps.tolist() == [4.75]
    assert poses.translations.tolist() == [[1, -2, 3.5]]
    assert poses.quaternions.tolist() == [[0.5, -0.5, 0.5, 0.5]]
    assert (poses.parent, poses.child) == ("odom", "")


@pytest.mark.parametrize("spelling", foxglove.SPELLINGS)
def test_frame_transforms_are_read_in_every_spelling(spelling: str) -> None:
    def one(child: str, seconds: int, x: float) -> dict[str, Any]:
        return {
            "timestamp": {"sec": seconds, "nsec": 0},
            "parent_frame_id": "/odom",
            "child_frame_id": child,
            "translation": vector(x, 0, 0),
            "rotation": vector(0, 0, 0, 2),
        }

    several = {"transforms": [one("a", 1, 5), one("b", 1, 6), one("a", 2, 7)]}
    message = foxglove.message(spelling, "FrameTransforms", several)
    a, b = POSES[message.channel.type](Deserializer().read(message))

    assert (a.parent, a.child, b.parent, b.child) == ("odom", "a", "odom", "b")
    assert (a.stamps.tolist(), b.stamps.tolist()) == ([1, 2], [1])
    assert (a.translations[:, 0].tolist(), b.translations[:, 0].tolist()) == ([5, 7], [6])
    assert a.quaternions.tolist() == [[0, 0, 0, 1]] * 2

    message = foxglove.message(spelling, "FrameTransform", one("a", 1, 5))
    (alone,) = POSES[message.channel.type](Deserializer().read(message))
    assert (alone.parent, alone.child, alone.translations.tolist()) == ("odom", "a", [[5, 0, 0]])


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("type_", TF_TYPES)
def test_transforms_are_gathered_by_their_frames(encoding: str, type_: str) -> None:
    sent = [
        transform("/map", "/odom", 1, 10),
        transform("odom", "base", 2, 20),
        transform("map", "odom", 3, 30),
    ]

    first, second = decode(encoding, type_, {"transforms": sent})

    assert (first.parent, first.child) == ("map", "odom")
    assert first.stamps.tolist() == [1, 3]
    assert first.translations.tolist() == [[10, 0, 0], [30, 0, 0]]
    assert (second.parent, second.child, second.stamps.tolist()) == ("odom", "base", [2])


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_a_message_without_transforms_has_none(encoding: str) -> None:
    assert decode(encoding, "tf2_msgs/msg/TFMessage", {}) == []
    assert decode(encoding, PATH, {"header": HEADER}) == []


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_poses_of_a_path_are_in_its_frame_unless_they_name_one(encoding: str) -> None:
    def at(seconds: int, frame: str) -> dict[str, Any]:
        return {"header": header(seconds, 0, frame), "pose": POSE}

    path = {"header": HEADER, "poses": [at(1, ""), at(2, "odom"), at(3, "map"), at(4, "/odom")]}

    odom, map_ = decode(encoding, PATH, path)

    assert (odom.parent, odom.stamps.tolist()) == ("odom", [1, 2, 4])
    assert (map_.parent, map_.stamps.tolist()) == ("map", [3])


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_quaternions_come_out_with_length_one(encoding: str) -> None:
    sent = [
        transform("a", "b", 1, 0, rotation=vector(0, 0, 3, 4)),
        transform("a", "b", 2, 0, rotation=vector(-1e-9, 0, 0, 0)),
        transform("a", "b", 3, 0, rotation=vector(2, 2, -2, 2)),
    ]

    (poses,) = decode(encoding, "tf2_msgs/msg/TFMessage", {"transforms": sent})

    expected = np.array([[0, 0, 0.6, 0.8], [-1, 0, 0, 0], [0.5, 0.5, -0.5, 0.5]])
    np.testing.assert_allclose(poses.quaternions, expected, rtol=1e-15)


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize(
    "changes",
    [
        {"rotation": vector(0, 0, 0, 0)},
        {"rotation": vector(0, math.nan, 0, 1)},
        {"rotation": vector(0, 0, math.inf, 1)},
        {"rotation": vector(0, 0, 1e200, 1e200)},
        {"translation": vector(0, math.nan, 0)},
        {"translation": vector(-math.inf, 0, 0)},
    ],
)
def test_what_is_no_pose_is_left_out_and_counted(encoding: str, changes: dict[str, Any]) -> None:
    sent = [
        transform("a", "b", 1, 10),
        transform("a", "b", 2, 20, **changes),
        transform("a", "b", 3, 30),
        transform("c", "d", 4, 40, **changes),
    ]

    good, none = decode(encoding, "tf2_msgs/msg/TFMessage", {"transforms": sent})

    assert (good.stamps.tolist(), good.refused) == ([1, 3], 1)
    assert good.translations.tolist() == [[10, 0, 0], [30, 0, 0]]
    assert good.quaternions.shape == (2, 4)
    assert (none.parent, none.child, len(none.stamps), none.refused) == ("c", "d", 0, 1)


def test_a_message_of_another_shape_is_refused() -> None:
    message = foxglove.message("json", "PoseInFrame", {"timestamp": {"sec": 1, "nsec": 2}})

    with pytest.raises(MalformedCloudError, match=r"not laid out as foxglove.PoseInFrame is"):
        POSES["foxglove.PoseInFrame"](Deserializer().read(message))


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_messages_together_have_the_poses_that_each_has_alone(encoding: str) -> None:
    none = vector(0, 0, 0, 0)
    contents: list[list[dict[str, Any]]] = [
        [transform("a", "b", 1, 10), transform("b", "c", 1, 11), transform("a", "b", 2, 12)],
        [],
        [transform("a", "b", 3, 13, rotation=none), transform("a", "b", 4, 14)],
        [transform("b", "c", 5, 15, rotation=vector(0, 3, 0, 4))],
    ]
    type_ = "tf2_msgs/msg/TFMessage"
    messages = [serialized(encoding, type_, {"transforms": each}) for each in contents]
    read = [Deserializer().read(message) for message in messages]

    together = stamped([TRANSFORM_TYPES[type_](message) for message in read])

    alone = [POSES[type_](message) for message in read]
    assert [len(each) for each in together] == [2, 0, 1, 1]
    for one, other in zip(chain(*together), chain(*alone), strict=True):
        assert all(map(np.array_equal, one[:3], other[:3]))
        assert one[3:] == other[3:]
