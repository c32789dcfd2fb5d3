"""Foxglove's clouds and scans.

How these tests could be cheated: by reading one spelling and not the others, or with poses that
are identities. So each is written in all spellings, with a quarter turn.
"""

from __future__ import annotations

import base64
import struct
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from mlscli.io.messages.decoding import Deserializer
from mlscli.io.messages.registry import CLOUD_TYPES, CloudPart, MalformedCloudError
from tests.helpers.foxglove import SPELLINGS, message
from tests.helpers.ros import vector

UINT8, INT8, UINT16, INT16, UINT32, INT32, FLOAT32, FLOAT64 = range(1, 9)
STAMP = {"sec": 1_700_000_000, "nsec": 250_000_000}
STILL = {"position": vector(0, 0, 0), "orientation": vector(0, 0, 0, 1)}
# A quarter turn about z: x becomes y, y becomes -x.
MOVED = {
    "position": vector(10, 20, 30),
    "orientation": vector(0, 0, float(np.sqrt(0.5)), float(np.sqrt(0.5))),
}


def cloud(layout: str, rows: Sequence[tuple[float, ...]], **types: int) -> dict[str, Any]:
    """Return a cloud whose fields follow each other in the layout, which struct packs."""
    offsets = [struct.calcsize("<" + layout[:place]) for place in range(len(layout))]
    return {
        "timestamp": STAMP,
        "frame_id": "lidar",
        "pose": STILL,
        "point_stride": struct.calcsize("<" + layout),
        "fields": [
            {"name": name, "offset": offset, "type": type_}
            for (name, type_), offset in zip(types.items(), offsets, strict=True)
        ],
        "data": b"".join(struct.pack("<" + layout, *row) for row in rows),
    }


def decode(spelling: str, content: dict[str, Any], name: str = "PointCloud") -> CloudPart:
    sent = message(spelling, name, content)
    (part,) = CLOUD_TYPES[sent.channel.type](Deserializer().read(sent))
    return part


FLOATS = {"x": FLOAT32, "y": FLOAT32, "z": FLOAT32}


@pytest.mark.parametrize("spelling", SPELLINGS)
@pytest.mark.parametrize(
    ("layout", "types"),
    [
        ("Bbd", {"x": UINT8, "y": INT8, "z": FLOAT64}),
        ("HhfI", {"z": UINT16, "y": INT16, "red": FLOAT32, "x": UINT32}),
        ("ifd", {"x": INT32, "z": FLOAT32, "y": FLOAT64}),
    ],
)
def test_every_type_of_number_is_read(spelling: str, layout: str, types: dict[str, int]) -> None:
    rows = [tuple(range(3, 3 + len(layout))), tuple(range(40, 40 + len(layout)))]

    part = decode(spelling, cloud(layout, rows, **types))

    names = list(types)
    expected = [[float(row[names.index(axis)]) for axis in "xyz"] for row in rows]
    assert part.points.tolist() == expected
    assert (part.frame_id, part.stamp) == ("lidar", 1_700_000_000.25)


@pytest.mark.parametrize("spelling", SPELLINGS)
def test_a_cloud_is_moved_by_its_pose(spelling: str) -> None:
    content = cloud("fff", [(1, 0, 0), (0, 2, 3)], **FLOATS) | {"pose": MOVED}

    part = decode(spelling, content)

    np.testing.assert_allclose(part.points, [[10, 21, 30], [8, 20, 33]], atol=1e-14)


@pytest.mark.parametrize("spelling", ["protobuf", "json"])
def test_a_cloud_without_a_pose_stays_where_it_is(spelling: str) -> None:
    content = cloud("fff", [(1, 2, 3)], **FLOATS)
    del content["pose"]

    assert decode(spelling, content).points.tolist() == [[1, 2, 3]]


@pytest.mark.parametrize("spelling", SPELLINGS)
def test_a_keyframe_field_splits_a_cloud(spelling: str) -> None:
    rows = [(1, 0, 0, 9), (2, 0, 0, 4), (3, 0, 0, 9)]

    clouds = decode(spelling, cloud("fffI", rows, **FLOATS, keyframe=UINT32)).split()

    assert [points[:, 0].tolist() for points in clouds] == [[1, 3], [2]]


@pytest.mark.parametrize("spelling", SPELLINGS)
def test_a_cloud_without_points_is_empty(spelling: str) -> None:
    assert decode(spelling, cloud("fff", [], **FLOATS)).points.shape == (0, 3)


@pytest.mark.parametrize("spelling", SPELLINGS)
@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"point_stride": 0}, "24 bytes of data, expected a multiple of point_stride 0"),
        ({"point_stride": 16}, "24 bytes of data, expected a multiple of point_stride 16"),
        ({"point_stride": 8}, "field z ends at byte 12 of points that are 8 bytes apart"),
        ({"fields": []}, "it has no fields, expected x, y and z"),
    ],
)
def test_a_cloud_that_contradicts_itself_is_refused(
    spelling: str, changes: dict[str, Any], words: str
) -> None:
    with pytest.raises(MalformedCloudError, match=words):
        decode(spelling, cloud("fff", [(1, 2, 3), (4, 5, 6)], **FLOATS) | changes)


@pytest.mark.parametrize("spelling", SPELLINGS)
def test_a_type_of_number_that_is_not_known_is_refused(spelling: str) -> None:
    types = FLOATS | {"y": 9}

    with pytest.raises(MalformedCloudError, match="field y has datatype 9, expected 1-8"):
        decode(spelling, cloud("fff", [(1, 2, 3)], **types))


@pytest.mark.parametrize(
    "changes",
    [
        {"data": "no base64!"},
        {"data": 5},
        {"fields": {}},
        {"fields": [{"name": "x"}] * 3},
        {"point_stride": "twelve"},
        {"point_stride": [12]},
        {"point_stride": 10**30},
        {"timestamp": None},
        {"timestamp": {"sec": 1}},
        {"timestamp": {"sec": 10**400, "nsec": 0}},
        {"pose": {"position": vector(1, 2, 3)}},
        {"pose": {"position": vector(1, 2, 3), "orientation": {"x": "a", "y": 0, "z": 0, "w": 1}}},
        {"pose": 7},
    ],
)
def test_json_of_another_shape_is_refused(changes: dict[str, Any]) -> None:
    with pytest.raises(MalformedCloudError) as error:
        decode("json", cloud("fff", [(1, 2, 3)], **FLOATS) | changes)
    assert "\n" not in str(error.value)


def test_bytes_with_what_is_no_base64_among_them_are_refused() -> None:
    whole = base64.b64encode(struct.pack("<3f", 1, 2, 3)).decode()

    with pytest.raises(MalformedCloudError, match="base64"):
        decode("json", cloud("fff", [], **FLOATS) | {"data": f"{whole[:4]}!\n{whole[4:]}"})


def test_a_scan_of_rows_is_refused() -> None:
    content = {"timestamp": STAMP, "frame_id": "laser", "start_angle": 0, "end_angle": 1}

    with pytest.raises(MalformedCloudError, match=r"shape \(2, 2\), expected \(N,\)"):
        decode("json", content | {"ranges": [[1, 2], [3, 4]]}, "LaserScan")


@pytest.mark.parametrize("absent", ["timestamp", "frame_id", "point_stride", "fields", "data"])
def test_json_that_lacks_a_member_is_refused(absent: str) -> None:
    content = cloud("fff", [(1, 2, 3)], **FLOATS)
    del content[absent]

    with pytest.raises(MalformedCloudError, match=absent):
        decode("json", content)


@pytest.mark.parametrize("text", [b"[1, 2]", b"7", b"null", b'"cloud"'])
def test_json_that_is_no_object_is_refused(text: bytes) -> None:
    sent = message("json", "PointCloud", {})._replace(data=text)

    with pytest.raises(MalformedCloudError):
        CLOUD_TYPES["foxglove.PointCloud"](Deserializer().read(sent))


@pytest.mark.parametrize("spelling", SPELLINGS)
def test_the_beams_of_a_scan_are_spread_from_the_first_to_the_last_angle(spelling: str) -> None:
    content = {
        "timestamp": STAMP,
        "frame_id": "laser",
        "pose": MOVED,
        "start_angle": 0.0,
        "end_angle": float(np.pi),
        "ranges": [1.0, 2.0, 3.0],
    }

    part = decode(spelling, content, "LaserScan")

    # Ahead, left and behind, turned to the left: left, behind and right.
    expected = [[10, 21, 30], [8, 20, 30], [10, 17, 30]]
    np.testing.assert_allclose(part.points, expected, atol=1e-14)
    assert (part.frame_id, part.stamp) == ("laser", 1_700_000_000.25)


@pytest.mark.parametrize("spelling", ["protobuf", "ros1", "cdr"])
def test_a_beam_that_hit_nothing_is_no_number(spelling: str) -> None:
    content = {"timestamp": STAMP, "pose": STILL, "ranges": [2.0]}
    infinite = content | {"ranges": ["Infinity" if spelling == "protobuf" else np.inf]}

    assert decode(spelling, content, "LaserScan").points.tolist() == [[2, 0, 0]]
    assert np.isnan(decode(spelling, infinite, "LaserScan").points).all()
