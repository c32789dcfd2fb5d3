"""PCD files as clouds.

How these tests could be cheated: by fields x y z in float, one after the other; by a compressor
that never repeats; by a header taken at its word. So files are written here by the format's
description, the compressed ones by a compressor of the test that draws literal runs and
repetitions at random; real files are compared with open3d; files are cut at many places.
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mlscli.errors import InputError
from mlscli.io.clouds.lzf import decompress
from mlscli.io.clouds.pcd import PcdCloud
from mlscli.runtime.arrays import Array
from tests.helpers.damage import cut, flipped, read_damaged
from tests.helpers.meshes import open3d
from tests.helpers.pcds import compressed, packed, pcd

REAL = [
    "hard/pcd_multi_count.pcd",
    "hard/pcd_padded_underscore_viewpoint.pcd",
    "hard/vio_outliers_1e33.pcd",
    "multilevel/als_bridge_samp21.pcd",
    "multilevel/als_bridge_samp21_ground.pcd",
    "multilevel/als_underpass_samp22.pcd",
    "multilevel/als_underpass_samp22_ground.pcd",
    "multilevel/footbridge_yup_dddmr_map.pcd",
]
UNKNOWN = str((float("nan"),) * 3)


def read(path: Path) -> tuple[list[Any], list[str]]:
    source = PcdCloud(path)
    return [cloud.points.tolist() for cloud in source.clouds()], list(source.losses)


def body_of(data: str, columns: list[Array]) -> bytes:
    """Return points as DATA says; each column (N,) or (N, COUNT)."""
    if data == "binary":
        rows = zip(*columns, strict=True)
        return b"".join(value.tobytes() for row in rows for value in row)
    if data == "binary_compressed":
        return packed(columns)
    table = np.column_stack([column.astype(object) for column in columns])
    return "".join(" ".join(map(repr, row)) + "\n" for row in table.tolist()).encode()


# Real files


@pytest.mark.parametrize("name", REAL)
def test_real_clouds_are_what_open3d_reads(shared_data: Path, name: str) -> None:
    cloud = open3d().io.read_point_cloud(str(shared_data / name))
    expected = np.asarray(cloud.points)

    ((found,), losses) = read(shared_data / name)

    # It holds the numbers of a text in float32.
    assert np.array(found).astype(np.float32).tolist() == expected.astype(np.float32).tolist()
    assert losses == []
    assert len(expected) > 0


def test_commas_and_capitals_are_no_obstacle(shared_data: Path) -> None:
    path = shared_data / "hard/pcd_comma_body.pcd"
    rows = path.read_text().partition("DATA ascii\n")[2].splitlines()

    assert read(path) == ([[[float(word) for word in row.split(",")] for row in rows]], [])


def test_points_count_where_width_and_height_do_not(shared_data: Path) -> None:
    path = shared_data / "hard/pcd_width0_height0.pcd"
    body = path.read_bytes().partition(b"DATA binary\n")[2]

    ((found,), losses) = read(path)

    assert found == np.frombuffer(body, "<f4").reshape(7729, 3).astype(float).tolist()
    assert losses == []
    assert "POINTS is taken" in PcdCloud(path).notes[0]


def test_a_file_without_points_has_an_empty_keyframe(shared_data: Path) -> None:
    assert read(shared_data / "hard/pcd_zero_points.pcd") == ([[]], [])


def test_the_viewpoint_is_where_the_craft_was(shared_data: Path, tmp_path: Path) -> None:
    source = PcdCloud(shared_data / "hard/pcd_padded_underscore_viewpoint.pcd")
    (cloud,) = source.clouds()

    assert cloud.position == (23.6795, -2.25992, 0)
    assert "VIEWPOINT" in source.notes[0]
    for viewpoint in ("0 0 0 1 0 0 0", "nan 1 2 1 0 0 0", "", "x", None):
        (tmp_path / "a.pcd").write_bytes(pcd("ascii", b"1 2 3\n4 5 6\n", VIEWPOINT=viewpoint))
        (cloud,) = PcdCloud(tmp_path / "a.pcd").clouds()
        assert str(cloud.position) == UNKNOWN


# Layouts


@pytest.mark.parametrize("data", ["ascii", "binary", "binary_compressed"])
@given(example=st.data())
@settings(
    deadline=None, max_examples=35, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_points_come_bit_for_bit_whatever_the_fields(
    tmp_path: Path, data: str, example: st.DataObject
) -> None:
    draw = example.draw
    count = draw(st.integers(0, 20))
    names = draw(
        st.permutations(["x", "y", "z", *draw(st.lists(st.sampled_from("_ab"), max_size=3))])
    )
    seed = draw(st.integers(0, 99))
    rng = np.random.default_rng(seed)
    columns, layout = {}, []
    for place, name in enumerate(names):
        kind = draw(st.sampled_from(["F4", "F8", "I1", "I2", "I4", "I8", "U1", "U2", "U4", "U8"]))
        width = 1 if name in "xyz" else draw(st.integers(0, 4))
        values = rng.integers(0, 4, (count, width)) * 13
        columns[name, place] = values.astype(f"<{kind.lower()}")
        layout.append((name, kind[1], kind[0], width))
    fields, sizes, types, counts = (
        " ".join(map(str, entry)) for entry in zip(*layout, strict=True)
    )
    content = pcd(
        data, body_of(data, list(columns.values())),
        FIELDS=fields, SIZE=sizes, TYPE=types, COUNT=counts, WIDTH=count, POINTS=count,
    )  # fmt: skip
    (tmp_path / "a.pcd").write_bytes(content)
    xyz = [next(c for (n, _), c in columns.items() if n == axis)[:, 0] for axis in "xyz"]

    (cloud,) = PcdCloud(tmp_path / "a.pcd").clouds()

    assert cloud.points.tolist() == np.column_stack(xyz).astype(float).tolist()


@given(st.binary(max_size=400), st.integers(1, 40), st.integers(0, 99))
@settings(deadline=None)
def test_what_was_compressed_comes_back(piece: bytes, times: int, seed: int) -> None:
    plain = piece * times
    data = np.frombuffer(compressed(plain, seed), np.uint8)

    back, used = decompress(data, len(plain))
    assert back.tobytes() == plain
    assert used == len(data)


@pytest.mark.parametrize("repetition", [b"\x20\x00", b"\x20\x03", b"\x3f\xff", b"\xe0\x00\x09"])
def test_what_repeats_bytes_before_the_first_ends_it(repetition: bytes) -> None:
    for literal in (b"", b"\x02abc"):
        data = np.frombuffer(literal + repetition + b"\x02xyz", np.uint8)
        plain = decompress(data, 1000)[0].tobytes()
        if repetition == b"\x20\x00" and literal:
            assert plain == b"abc" + b"ccc" + b"xyz"
        else:
            assert plain == literal[1:]


def test_entries_that_older_versions_lack_have_their_usual_values(tmp_path: Path) -> None:
    content = pcd(
        "ascii", b"1 2 3\n4 5 6\n", VERSION=None, COUNT=None, SIZE=None, TYPE=None, POINTS=None,
        VIEWPOINT=None, HEIGHT=None,
    )  # fmt: skip
    (tmp_path / "a.pcd").write_bytes(content.replace(b"FIELDS", b"COLUMNS"))

    assert read(tmp_path / "a.pcd") == ([[[1, 2, 3], [4, 5, 6]]], [])


def test_poses_are_no_points(tmp_path: Path) -> None:
    # As LIO-SAM keeps them, beside the cloud.
    names = "x y z intensity roll pitch yaw time"
    content = pcd("ascii", b"1 2 3 0 0 0 0 1\n" * 2, FIELDS=names, SIZE=None, TYPE=None, COUNT=None)
    (tmp_path / "transformations.pcd").write_bytes(content)
    with pytest.raises(InputError, match=r"transformations\.pcd: holds poses .* and no points"):
        read(tmp_path / "transformations.pcd")


def test_in_a_text_the_last_fields_need_no_size(tmp_path: Path) -> None:
    # SIZE, TYPE and COUNT have three values each.
    content = pcd("ascii", b"1 2 3 7\n4 5 6 8\n", FIELDS="x y z class")
    (tmp_path / "a.pcd").write_bytes(content)

    assert read(tmp_path / "a.pcd") == ([[[1, 2, 3], [4, 5, 6]]], [])


@pytest.mark.parametrize("data", ["ascii", "binary", "binary_compressed"])
def test_a_field_splits_the_cloud_by_keyframe(tmp_path: Path, data: str) -> None:
    xyz = [np.array([k, 0, 0], "<f4") for k in (1, 2, 3)]
    columns = [np.array([9, 4, 9], "<u2"), *xyz]
    content = pcd(
        data, body_of(data, columns), FIELDS="kf x y z", SIZE="2 4 4 4", TYPE="U F F F",
        COUNT="1 1 1 1", WIDTH=3, POINTS=3,
    )  # fmt: skip
    (tmp_path / "a.pcd").write_bytes(content)

    assert read(tmp_path / "a.pcd")[0] == [[[1, 2, 3], [0, 0, 0]], [[0, 0, 0]]]


# Faults


@pytest.mark.parametrize(
    ("entries", "words"),
    [
        ({"FIELDS": "x y"}, "SIZE 4 4 4', expected 2 whole numbers"),
        ({"FIELDS": None}, "found no FIELDS in the header"),
        ({"FIELDS": "x y h"}, r"FIELDS x \(F4 x 1\), y \(F4 x 1\), h .*expected one number x"),
        ({"COUNT": "1 1 2"}, "expected one number x, y and z"),
        ({"TYPE": "F F X"}, "expected one number x, y and z"),
        ({"SIZE": "4 4 3"}, "expected one number x, y and z"),
        ({"TYPE": "F F"}, "TYPE has 2 values for 3 FIELDS"),
        ({"POINTS": "-2"}, "POINTS -2', expected 1 whole number$"),
        ({"POINTS": "9" * 40}, "POINTS 9999"),
        (
            {"FIELDS": "x y z a", "TYPE": "F F F F", "SIZE": "4 4 4 8", "COUNT": "1 1 1 999999999"},
            "the field a has SIZE 8 and COUNT 999999999",
        ),
    ],
)  # fmt: skip
def test_a_header_that_cannot_be_read_is_named(
    tmp_path: Path, entries: dict[str, object], words: str
) -> None:
    (tmp_path / "a.pcd").write_bytes(pcd("ascii", b"1 2 3\n4 5 6\n", **entries))

    with pytest.raises(InputError, match=words) as error:
        read(tmp_path / "a.pcd")
    assert "a.pcd" in str(error.value)


@pytest.mark.parametrize("data", ["", "zipped"])
def test_data_of_another_kind_is_refused(tmp_path: Path, data: str) -> None:
    (tmp_path / "a.pcd").write_bytes(pcd(data, b""))

    with pytest.raises(InputError, match="expected DATA ascii, binary or binary_compressed"):
        read(tmp_path / "a.pcd")


@pytest.mark.parametrize("data", ["ascii", "binary"])
def test_a_promise_that_the_file_cannot_hold_is_a_loss(tmp_path: Path, data: str) -> None:
    columns = [np.array([k, k], "<f4") for k in (1, 2, 3)]
    body = body_of(data, columns)
    (tmp_path / "a.pcd").write_bytes(pcd(data, body, WIDTH=10**12, POINTS=10**12))

    found = read_damaged(tmp_path / "a.pcd", PcdCloud)

    assert found is not None
    assert found[0].tolist() == [[1, 2, 3], [1, 2, 3]]
    assert "999,999,999,998 of 1,000,000,000,000 points are missing" in found[1][0]


def test_a_compressed_size_that_cannot_be_is_refused(tmp_path: Path) -> None:
    for size, points in [(2**32 - 1, 2), (24, 10**12)]:
        body = struct.pack("<II", 20, size) + bytes(20)
        (tmp_path / "a.pcd").write_bytes(pcd("binary_compressed", body, POINTS=points))
        with pytest.raises(InputError, match=r"bytes of compressed points, expected"):
            read(tmp_path / "a.pcd")


def test_a_small_file_that_promises_four_gigabytes_costs_little(tmp_path: Path) -> None:
    points = (2**32 - 1) // 12
    body = struct.pack("<II", 10, 12 * points) + bytes(10)
    (tmp_path / "a.pcd").write_bytes(pcd("binary_compressed", body, WIDTH=points, POINTS=points))

    assert read_damaged(tmp_path / "a.pcd", PcdCloud) is None
    with pytest.raises(InputError, match="the compressed points are damaged: 10 of 10 bytes"):
        read(tmp_path / "a.pcd")
    (tmp_path / "a.pcd").write_bytes((tmp_path / "a.pcd").read_bytes()[:-1])

    found = read_damaged(tmp_path / "a.pcd", PcdCloud)

    assert found is not None
    assert len(found[0]) == 0
    assert "points are missing" in found[1][0]


@pytest.mark.parametrize("data", ["ascii", "binary", "binary_compressed"])
def test_of_a_cut_file_the_whole_points_come(tmp_path: Path, data: str) -> None:
    count = 150
    columns = [np.random.default_rng(k).normal(size=count).astype("<f4") for k in range(3)]
    label = np.arange(count).astype("<i4") % 7
    points = np.column_stack(columns).astype(float)
    content = pcd(
        data, body_of(data, [*columns, label]), FIELDS="x y z a", SIZE="4 4 4 4",
        TYPE="F F F I", COUNT="1 1 1 1", WIDTH=count, POINTS=count,
    )  # fmt: skip
    body = content.index(f"DATA {data}\n".encode()) + len(f"DATA {data}\n")
    rows = [pos for pos in range(body, len(content)) if content[pos : pos + 1] == b"\n"]
    for damaged in cut(content, 150):
        (tmp_path / "a.pcd").write_bytes(damaged)
        found = read_damaged(tmp_path / "a.pcd", PcdCloud)
        if len(damaged) < body - 1:
            assert found is None
            continue
        assert found is not None
        assert found[0].astype(np.float32).tolist() == points[: len(found[0])].tolist()
        assert bool(found[1]) == (len(found[0]) < count)
        if data == "binary":
            assert len(found[0]) == (len(damaged) - body) // 16
        elif data == "ascii":
            ended = sum(pos < len(damaged) for pos in rows)
            assert ended <= len(found[0]) <= ended + (ended == count - 1)


def test_of_a_cut_compressed_file_points_come_once_their_last_field_does(tmp_path: Path) -> None:
    columns = [np.random.default_rng(k).normal(size=90).astype("<f4") for k in range(3)]
    content = pcd("binary_compressed", packed(columns), WIDTH=90, POINTS=90)
    (tmp_path / "a.pcd").write_bytes(content[:-100])

    ((found,), losses) = read(tmp_path / "a.pcd")

    assert found == np.column_stack(columns)[: len(found)].astype(float).tolist()
    # 100 bytes fewer, 33 of 34 of which are literal.
    assert 64 <= len(found) <= 66
    assert "points are missing: the file ends before them" in losses[0]


@pytest.mark.parametrize("data", ["ascii", "binary", "binary_compressed"])
def test_a_flipped_bit_is_an_error_a_loss_or_wrong_numbers(tmp_path: Path, data: str) -> None:
    columns = [np.random.default_rng(k).integers(0, 9, 80).astype("<f4") for k in range(3)]
    content = pcd(data, body_of(data, columns), WIDTH=80, POINTS=80)
    header = content.index(b"DATA") + 5
    for damaged in flipped(content, 300, header):
        (tmp_path / "a.pcd").write_bytes(damaged)
        found = read_damaged(tmp_path / "a.pcd", PcdCloud)
        if found is not None and damaged[:header] == content[:header]:
            assert len(found[0]) == 80 or found[1]


@pytest.mark.parametrize("data", ["binary", "binary_compressed"])
@pytest.mark.parametrize("declared", [0, 1, 20, 35])
def test_points_beyond_those_declared_are_taken(tmp_path: Path, data: str, declared: int) -> None:
    columns = [np.random.default_rng(k).uniform(-9, 9, 36).astype("<f4") for k in range(3)]
    content = pcd(data, body_of(data, columns), WIDTH=declared, POINTS=declared)
    (tmp_path / "a.pcd").write_bytes(content)

    ((found,), losses) = read(tmp_path / "a.pcd")

    assert found == np.column_stack(columns).astype(float).tolist()
    assert not losses
    (note,) = PcdCloud(tmp_path / "a.pcd").notes
    points = "point" if declared == 1 else "points"
    assert f"its header declares {declared} {points}, and there are 36; all are taken" in note


def test_what_follows_the_points_and_is_none_is_left_out(tmp_path: Path) -> None:
    columns = [np.random.default_rng(k).uniform(-9, 9, 20).astype("<f4") for k in range(3)]
    content = pcd("binary", body_of("binary", columns), WIDTH=20, POINTS=20)
    for tail, lost in [
        (b"", False),
        (b"\n", False),
        (bytes(4096), False),
        (b"made by a program that signs its files, at some length " * 9, True),
        (content, True),
        (np.full(99, 1e30, "<f4").tobytes(), True),
        (np.full(99, 7e4, "<f4").tobytes(), True),
    ]:
        (tmp_path / "a.pcd").write_bytes(content + tail)
        ((found,), losses) = read(tmp_path / "a.pcd")
        assert found == np.column_stack(columns).astype(float).tolist()
        assert bool(losses) == lost, tail[:10]
        assert not lost or "what follows the 20 points" in losses[0]


def test_compressed_points_that_contradict_their_size_are_refused(tmp_path: Path) -> None:
    columns = [np.random.default_rng(k).integers(0, 4, 400).astype("<f4") for k in range(3)]
    content = pcd("binary_compressed", packed(columns), WIDTH=400, POINTS=400)
    begin = content.index(b"DATA binary_compressed\n") + 31
    # The lengths of steps, some of them; a wrong one moves all that follows.
    at, steps = begin, []
    while at < len(content):
        steps.append(at)
        control = content[at]
        at += control + 2 if control < 32 else 2 + (control >> 5 == 7)
    for place in steps[::7]:
        damaged = bytearray(content)
        damaged[place] ^= 1 if damaged[place] < 32 else 64
        (tmp_path / "a.pcd").write_bytes(damaged)
        with pytest.raises(InputError, match="the compressed points are damaged"):
            read(tmp_path / "a.pcd")
