"""Clouds whose points are packed into bytes.

How these tests could be cheated: by reading only the layouts that drivers commonly write, by
taking fields in the order in which they are listed, or by a decoder that builds its own input.
So layouts are drawn at random, and the bytes are packed by `struct`, value by value.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from math import inf, nan
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mlscli.io.messages.decoding import Deserializer
from mlscli.io.messages.registry import CLOUD_TYPES, CloudPart, MalformedCloudError
from tests.helpers.ros import ENCODINGS, header, serialized

HEADER = SimpleNamespace(frame_id="map", stamp=SimpleNamespace(sec=5, nanosec=250_000_000))
CODES = {1: "b", 2: "B", 3: "h", 4: "H", 5: "i", 6: "I", 7: "f", 8: "d"}


def decode(message: object) -> CloudPart:
    (part,) = CLOUD_TYPES["sensor_msgs/msg/PointCloud2"](message)
    return part


@dataclass
class Layout:
    """A random PointCloud2 and the values that it was packed from."""

    message: SimpleNamespace
    xyz: list[list[float]]
    labels: list[float] | None


def values(datatype: int) -> st.SearchStrategy[Any]:
    if datatype >= 7:
        # Coordinates of a scene: bytes that are none in the order stated are another matter.
        size = st.floats(0.125, 2.0**20, width=32 if datatype == 7 else 64)
        return size | size.map(lambda value: -value) | st.sampled_from([0.0, -0.0, nan, inf, -inf])
    bits = 8 * struct.calcsize(CODES[datatype])
    low = -(2 ** (bits - 1)) if datatype % 2 else 0
    return st.integers(low, low + 2**bits - 1)


@st.composite
def layouts(draw: st.DrawFn) -> Layout:
    label = draw(st.sampled_from([None, "keyframe", "kf", "kf_id"]))
    others = ["intensity", "ring"][: draw(st.integers(0, 2))]
    names = draw(st.permutations(["x", "y", "z", *others, *([label] if label else [])]))
    order = draw(st.sampled_from("<>"))
    datatypes = {name: draw(st.integers(1, 8)) for name in names}
    counts = {name: draw(st.integers(1, 3)) for name in names}
    offsets, step = {}, 0
    for name in draw(st.permutations(names)):
        offsets[name] = step + draw(st.integers(0, 3))
        step = offsets[name] + counts[name] * struct.calcsize(CODES[datatypes[name]])
    step += draw(st.integers(0, 5))
    height, width = draw(st.integers(0, 3)), draw(st.integers(0, 4))
    row_step = width * step + (draw(st.integers(0, 7)) if width else 0)
    data = bytearray(draw(st.binary(min_size=height * row_step, max_size=height * row_step)))
    rows: list[dict[str, float]] = []
    for row in range(height):
        for column in range(width):
            point = {name: draw(values(datatypes[name])) for name in names}
            for name, value in point.items():
                at = row * row_step + column * step + offsets[name]
                struct.pack_into(order + CODES[datatypes[name]], data, at, value)
            rows.append(point)
    fields = [
        SimpleNamespace(
            name=name, offset=offsets[name], datatype=datatypes[name], count=counts[name]
        )
        for name in names
    ]
    message = SimpleNamespace(
        header=HEADER,
        height=height,
        width=width,
        fields=fields,
        is_bigendian=order == ">",
        point_step=step,
        row_step=row_step,
        data=np.frombuffer(bytes(data), dtype=np.uint8),
    )
    xyz = [[float(row[axis]) for axis in "xyz"] for row in rows]
    return Layout(message, xyz, [row[label] for row in rows] if label else None)


@settings(deadline=None)
@given(layouts())
def test_any_layout_yields_the_values_that_were_packed(layout: Layout) -> None:
    points = decode(layout.message).points

    expected = np.array(layout.xyz, dtype=np.float64).reshape(-1, 3)
    assert points.dtype == np.float64
    np.testing.assert_array_equal(points, expected)
    numbers = ~np.isnan(expected)
    assert np.array_equal(np.signbit(points[numbers]), np.signbit(expected[numbers]))


@settings(deadline=None)
@given(layouts())
def test_a_keyframe_field_splits_a_cloud_in_order_of_first_appearance(layout: Layout) -> None:
    clouds = decode(layout.message).split()

    groups: dict[object, list[list[float]]] = {}
    for number, point in enumerate(layout.xyz):
        label = layout.labels[number] if layout.labels is not None else 0
        groups.setdefault("nan" if label != label else label, []).append(point)
    assert len(clouds) == max(1, len(groups))
    for cloud, group in zip(clouds, groups.values(), strict=False):
        np.testing.assert_array_equal(cloud, np.array(group))


def cloud(**changes: object) -> SimpleNamespace:
    fields = [
        SimpleNamespace(name=n, offset=4 * i, datatype=7, count=1) for i, n in enumerate("xyz")
    ]
    message = SimpleNamespace(
        header=HEADER,
        height=1,
        width=2,
        fields=fields,
        is_bigendian=False,
        point_step=12,
        row_step=24,
        data=np.frombuffer(struct.pack("<6f", 1, 2, 3, 4, 5, 6), dtype=np.uint8),
    )
    vars(message).update(changes)
    return message


def test_a_single_row_needs_no_row_step() -> None:
    points = decode(cloud(row_step=0)).points

    assert points.tolist() == [[1, 2, 3], [4, 5, 6]]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"width": 3}, "24 bytes of data, expected 36"),
        ({"width": 3, "row_step": 12}, "24 bytes of data, expected 36"),
        ({"width": 1, "row_step": 12, "data": np.ones(23, np.uint8)}, "23 bytes .*, expected 12"),
        ({"width": 0, "row_step": 0, "data": np.ones(23, np.uint8)}, "23 bytes .*, expected 0"),
        ({"height": 0, "width": 0, "point_step": 0, "fields": []}, "24 bytes .*, expected 0"),
        ({"width": 2**32 - 1, "height": 2**32 - 1}, "24 bytes of data"),
        (
            {"point_step": 0, "row_step": 0, "data": np.empty(0, np.uint8)},
            "points that are 0 bytes apart",
        ),
        ({"height": 2, "width": 2, "row_step": 0}, "row_step 0"),
        ({"point_step": 8, "width": 3}, "field z ends at byte 12"),
        ({"fields": cloud().fields[:2]}, "no field z, expected x, y and z beside x, y"),
        ({"fields": []}, "it has no fields, expected x, y and z"),
        (
            {"fields": [*cloud().fields[:2], SimpleNamespace(name="z", offset=8, datatype=9)]},
            "field z has datatype 9",
        ),
    ],
)
def test_a_cloud_that_contradicts_itself_is_refused_before_memory_is_taken(
    changes: dict[str, object], words: str
) -> None:
    with pytest.raises(MalformedCloudError, match=words):
        decode(cloud(**changes))


def test_a_cloud_without_points_needs_no_fields() -> None:
    empty = cloud(width=0, fields=[], data=np.empty(0, np.uint8), point_step=0, row_step=0)

    assert decode(empty).points.shape == (0, 3)


def test_fields_that_are_not_needed_may_have_any_datatype() -> None:
    extra = SimpleNamespace(name="rgb", offset=0, datatype=77, count=1)

    assert decode(cloud(fields=[extra, *cloud().fields])).points.tolist() == [[1, 2, 3], [4, 5, 6]]


@pytest.mark.parametrize("more", [[], [("t", 32, 8)]])
def test_fields_that_offsets_set_beyond_their_points_are_read_where_they_fit(
    more: list[tuple[str, int, int]],
) -> None:
    # A converter multiplied the number of each field by its own size.
    listed = [("intensity", 0, 2), ("x", 4, 7), ("y", 8, 7), ("z", 12, 7), *more]
    fields = [SimpleNamespace(name=n, offset=at, datatype=d, count=1) for n, at, d in listed]
    form = "<Bfff" + "d" * len(more)
    data = b"".join(struct.pack(form, 7, k, 2.5, -k, *[1e9] * len(more)) for k in range(1, 41))
    step = struct.calcsize(form)
    packed = cloud(
        fields=fields,
        width=40,
        point_step=step,
        row_step=40 * step,
        data=np.frombuffer(data, np.uint8),
    )

    found = decode(packed)

    assert found.points.tolist() == [[k, 2.5, -k] for k in range(1, 41)]
    assert found.doubts == ("offsets of fields contradict point_step; the fields have no gaps",)


def test_of_two_fields_with_one_name_the_first_counts() -> None:
    again = SimpleNamespace(name="x", offset=8, datatype=7, count=1)

    assert decode(cloud(fields=[*cloud().fields, again])).points[:, 0].tolist() == [1, 4]


@pytest.mark.parametrize(("name", "is_ranged"), [("ring", True), ("line", True), ("rgb", False)])
def test_the_number_of_a_laser_tells_that_lasers_measured(name: str, is_ranged: bool) -> None:
    number = SimpleNamespace(name=name, offset=8, datatype=7, count=1)
    assert decode(cloud(fields=[*cloud().fields, number])).is_ranged == is_ranged


def test_a_cloud_tells_its_frame_and_time() -> None:
    part = decode(cloud())

    assert (part.frame_id, part.stamp) == ("map", 5.25)


def test_a_signalling_nan_is_a_nan_and_no_warning() -> None:
    signalling = struct.pack("<6I", 0x7F800001, 0, 0, 0xFF800001, 0, 0)
    points = decode(cloud(data=np.frombuffer(signalling, np.uint8))).points

    assert np.isnan(points[:, 0]).all()


@pytest.mark.parametrize("field", ["width", "fields", "header", "data"])
def test_a_cloud_of_another_definition_is_refused(field: str) -> None:
    message = cloud()
    delattr(message, field)

    with pytest.raises(MalformedCloudError, match="not laid out as sensor_msgs/msg/PointCloud2 is"):
        decode(message)
    with pytest.raises(MalformedCloudError):
        decode(cloud(**{field: "seven"}))


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_an_organised_cloud_is_read_as_recorded(encoding: str) -> None:
    rows = [[(1, 2, 3), (4, 5, 6)], [(7, 8, 9), (-1, -2, -3)]]
    data = b"".join(struct.pack("<hfd", *p) for row in rows for p in row)
    types = {"x": (0, 3), "y": (2, 7), "z": (6, 8)}
    fields = [{"name": n, "offset": o, "datatype": t, "count": 1} for n, (o, t) in types.items()]
    content = {
        "header": header(1_700_000_000, 500_000_000, "lidar"),
        "height": 2,
        "width": 2,
        "fields": fields,
        "point_step": 14,
        "row_step": 28,
        "data": np.frombuffer(data, np.uint8),
    }
    message = serialized(encoding, "sensor_msgs/msg/PointCloud2", content)

    part = decode(Deserializer().read(message))

    assert part.points.tolist() == [list(map(float, p)) for row in rows for p in row]
    assert (part.frame_id, part.stamp) == ("lidar", 1_700_000_000.5)


def flagged(dtype: str, *, is_big: bool, count: int) -> SimpleNamespace:
    points = np.random.default_rng(count).uniform(-20, 20, (count, 3)).astype(dtype)
    return cloud(
        width=count,
        row_step=12 * count,
        is_bigendian=is_big,
        data=np.frombuffer(points.tobytes(), np.uint8),
    )


@pytest.mark.parametrize("count", [3, 36, 2000])
@pytest.mark.parametrize("dtype", ["<f4", ">f4"])
def test_the_data_tells_its_byte_order_and_the_flag_is_doubted(dtype: str, count: int) -> None:
    is_big = dtype[0] == ">"
    right = decode(flagged(dtype, is_big=is_big, count=count))
    wrong = decode(flagged(dtype, is_big=not is_big, count=count))

    np.testing.assert_array_equal(right.points, wrong.points)
    assert np.abs(right.points).max() <= 20
    assert not right.doubts
    (doubt,) = wrong.doubts
    assert doubt.startswith("is_bigendian is set" if dtype == "<f4" else "is_bigendian is not set")


def test_a_flag_that_cannot_be_told_right_or_wrong_is_followed_and_doubted() -> None:
    one = struct.pack("<3f", 0, 0.5, 0)
    part = decode(cloud(width=1, row_step=12, is_bigendian=True, data=np.frombuffer(one, np.uint8)))

    assert part.points.tolist() == [[0, struct.unpack(">f", struct.pack("<f", 0.5))[0], 0]]
    assert "does not tell" in part.doubts[0]
    part = decode(cloud(width=1, row_step=12, data=np.frombuffer(one, np.uint8)))
    assert part.points.tolist() == [[0, 0.5, 0]]
    assert not part.doubts


def test_names_of_fields_may_be_capital_where_none_is_small() -> None:
    capital = cloud().fields
    for field in capital:
        field.name = field.name.upper()
    assert decode(cloud(fields=capital)).points.tolist() == [[1, 2, 3], [4, 5, 6]]
    # Beside small ones they are something else.
    other = SimpleNamespace(name="X", offset=4, datatype=7)
    assert decode(cloud(fields=[other, *cloud().fields])).points.tolist() == [[1, 2, 3], [4, 5, 6]]


def test_halves_that_are_declared_whole_are_read_as_halves() -> None:
    points = np.random.default_rng(3).uniform(-9, 9, (40, 3)).astype("<f2")
    fields = [SimpleNamespace(name=n, offset=2 * k, datatype=4) for k, n in enumerate("xyz")]
    data = np.frombuffer(points.tobytes(), np.uint8)

    part = decode(cloud(fields=fields, width=40, point_step=6, row_step=240, data=data))

    assert part.points.tolist() == points.astype(float).tolist()
    assert "hold halves" in part.doubts[0]


@pytest.mark.parametrize(
    "changes",
    [{"height": 0}, {"width": 0, "row_step": 0}, {"width": 1, "row_step": 12}, {"point_step": 0},
     {"height": 2, "width": 1, "row_step": 0}, {"height": 2, "width": 1, "row_step": 24}],
)  # fmt: skip
def test_points_that_sizes_do_not_declare_are_read_and_the_sizes_doubted(
    changes: dict[str, object],
) -> None:
    part = decode(cloud(**changes))

    assert part.points.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert len(part.doubts) == 1
