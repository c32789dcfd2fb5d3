"""PLY files as clouds.

How these tests could be cheated: by layouts that are usual, x y z first and in float; by a header
taken at its word, or a body at its length; by one line end. So layouts are drawn at random and
written here by the format's description, in all three encodings; other programs' files are read;
files are cut at many places, where just the whole vertices must come and the rest be told.
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mlscli.errors import InputError
from mlscli.io.clouds.plycloud import PlyCloud
from mlscli.io.writing.ply import write_ply
from mlscli.mesh import build_mesh
from mlscli.runtime.arrays import Float64
from tests.helpers.damage import cut, flipped, read_damaged
from tests.helpers.meshes import house, open3d
from tests.helpers.plys import ply

# The names of the format's description, and those that writers added, as struct writes them.
TYPES = {
    "char": "b", "uchar": "B", "short": "h", "ushort": "H", "int": "i", "uint": "I",
    "float": "f", "double": "d", "int8": "b", "uint8": "B", "int16": "h", "uint16": "H",
    "int32": "i", "uint32": "I", "float32": "f", "float64": "d",
    "int64": "q", "uint64": "Q", "half": "e", "float16": "e", "bool": "B",
}  # fmt: skip
COUNTS = [name for name, code in TYPES.items() if code in "bBhHiI"]


def read(path: Path) -> tuple[list[Any], list[str]]:
    source = PlyCloud(path)
    return [cloud.points.tolist() for cloud in source.clouds()], list(source.losses)


XYZ = ["property float x", "property float y", "property float z"]


# Layouts


def value(type_: str) -> st.SearchStrategy[Any]:
    code = TYPES[type_]
    if code == "e":
        return st.floats(-60_000, 60_000, width=16)
    if code in "fd":
        return st.floats(-1e6, 1e6, width=32 if code == "f" else 64)
    if type_ == "bool":
        return st.integers(0, 1)
    # Larger integers are no float64.
    bits = min(8 * struct.calcsize(f"={code}"), 53)
    low, high = (0, 2**bits - 1) if code.isupper() else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    return st.integers(low, high)


@st.composite
def written(draw: st.DrawFn, encoding: str) -> tuple[bytes, list[list[float]]]:
    """Draw a file whose vertices have any properties, and the points that it holds."""
    header, body, points = [], b"", []
    order = ">" if "big" in encoding else "<"
    for name in [*draw(st.lists(st.sampled_from(["face", "edge", "pose"]), max_size=2)), "vertex"]:
        extra = [f"p{k}" for k in range(draw(st.integers(0, 3)))]
        names = draw(st.permutations(extra + (list("xyz") if name == "vertex" else ["q"])))
        layout = [
            (
                draw(st.sampled_from(COUNTS)) if n[0] == "p" and draw(st.booleans()) else "",
                draw(st.sampled_from(sorted(TYPES))),
                n,
            )
            for n in names
        ]
        count = draw(st.integers(0, 4))
        header += ["comment element vertex 9", f"element {name} {count}", "obj_info x"]
        header += [
            f"property {f'list {length} ' if length else ''}{type_} {n}"
            for length, type_, n in layout
        ]
        for _ in range(count):
            row: list[tuple[str, float]] = []
            for length, type_, n in layout:
                if length:
                    items = draw(st.lists(value(type_), max_size=3))
                    row += [(TYPES[length], len(items)), *((TYPES[type_], i) for i in items)]
                else:
                    row.append((TYPES[type_], draw(value(type_))))
                    if name == "vertex" and n in "xyz":
                        points.append((n, row[-1][1]))
            if encoding == "ascii":
                body += " ".join(repr(number) for _, number in row).encode() + b"\n"
            else:
                body += b"".join(struct.pack(order + code, number) for code, number in row)
    rows = [dict(points[k : k + 3]) for k in range(0, len(points), 3)]
    return ply(encoding, *header, body=body), [[row[n] for n in "xyz"] for row in rows]


@pytest.mark.parametrize("encoding", ["ascii", "binary_little_endian", "binary_big_endian"])
@given(data=st.data())
@settings(
    deadline=None, max_examples=35, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_vertices_come_bit_for_bit_whatever_else_there_is(
    tmp_path: Path, encoding: str, data: st.DataObject
) -> None:
    content, points = data.draw(written(encoding))
    (tmp_path / "a.ply").write_bytes(content)

    (cloud,) = PlyCloud(tmp_path / "a.ply").clouds()

    assert cloud.points.tobytes() == np.array(points, dtype=np.float64).tobytes()


@pytest.mark.parametrize("ending", ["\n", "\r\n", "\r"])
def test_a_body_may_begin_with_what_ends_a_line(tmp_path: Path, ending: str) -> None:
    body = struct.pack("<fff", *np.frombuffer(b"\n\r\n\x40", "<f4").repeat(3))
    encoding = "binary_little_endian"
    content = ply(encoding, "element vertex 1", *XYZ, body=body, ending=ending)
    (tmp_path / "a.ply").write_bytes(content)

    clouds, losses = read(tmp_path / "a.ply")

    assert np.array(clouds[0]).astype("<f4").tobytes() == body
    assert losses == []


@pytest.mark.parametrize("ending", ["\n", "\r\n", "\r"])
def test_a_text_may_have_any_line_ends_and_blank_lines(tmp_path: Path, ending: str) -> None:
    body = ending.join(["1 2 3", "", "  4\t5 6 "]).encode()
    content = ply("ascii", "element vertex 2", *XYZ, body=body, ending=ending)
    (tmp_path / "a.ply").write_bytes(content)

    assert read(tmp_path / "a.ply") == ([[[1, 2, 3], [4, 5, 6]]], [])


def test_many_vertices_with_lists_come_bit_for_bit(tmp_path: Path) -> None:
    points = np.random.default_rng(2).normal(size=(70_001, 3)).astype("<f4")
    lists = [b"\0", b"\1abcd", b"\2abcdefgh"]
    body = b"".join(lists[k % 3] + point.tobytes() for k, point in enumerate(points))
    header = ["element vertex 70001", "property list uchar int l", *XYZ]
    (tmp_path / "a.ply").write_bytes(ply("binary_little_endian", *header, body=body))

    (cloud,) = PlyCloud(tmp_path / "a.ply").clouds()

    assert cloud.points.tobytes() == points.astype(float).tobytes()


def test_of_properties_with_one_name_the_first_number_is_taken(tmp_path: Path) -> None:
    header = ["element vertex 2", "property list uchar int x", *XYZ, "property float x"]
    body = b"".join(struct.pack("<Bifff f", 1, 9, k, 2, 3, 4) for k in (1, 5))
    (tmp_path / "a.ply").write_bytes(ply("binary_little_endian", *header, body=body))

    assert read(tmp_path / "a.ply")[0] == [[[1, 2, 3], [5, 2, 3]]]


def test_text_keeps_the_digits_that_float_cannot_hold(tmp_path: Path) -> None:
    body = b"572273.123 4498560.456 36.8425064\n"
    (tmp_path / "a.ply").write_bytes(ply("ascii", "element vertex 1", *XYZ, body=body))

    assert read(tmp_path / "a.ply")[0] == [[[572273.123, 4498560.456, 36.8425064]]]


@pytest.mark.parametrize("name", ["keyframe", "kf", "kf_id", "KeyFrame"])
@pytest.mark.parametrize("encoding", ["ascii", "binary_big_endian"])
def test_a_property_splits_the_cloud_by_keyframe(tmp_path: Path, name: str, encoding: str) -> None:
    rows = [(7, 1.0, 0.0, 0.0), (3, 2.0, 0.0, 0.0), (7, 3.0, 0.0, 0.0)]
    if encoding == "ascii":
        body = "".join(f"{k} {x} {y} {z}\n" for k, x, y, z in rows).encode()
    else:
        body = b"".join(struct.pack(">ifff", *row) for row in rows)
    content = ply(encoding, "element vertex 3", f"property int {name}", *XYZ, body=body)
    (tmp_path / "a.ply").write_bytes(content)

    assert read(tmp_path / "a.ply")[0] == [[[1, 0, 0], [3, 0, 0]], [[2, 0, 0]]]


# Files of other programs


def test_the_building_comes_number_by_number(shared_data: Path) -> None:
    path = shared_data / "multilevel/building_floors_cgal.ply"
    rows = path.read_text().partition("end_header\n")[2].splitlines()

    clouds, losses = read(path)

    assert clouds == [[[float(word) for word in row.split()[:3]] for row in rows]]
    assert losses == []


def random_points(count: int = 500) -> Float64:
    return np.random.default_rng(1).normal(size=(count, 3)) * 1e3


@pytest.mark.parametrize("encoding", ["ascii", "binary"])
def test_what_trimesh_writes_is_read(tmp_path: Path, encoding: str) -> None:
    box: Any = trimesh.creation.box()
    box.export(tmp_path / "box.ply", encoding=encoding, vertex_normal=True)

    ((vertices,), losses) = read(tmp_path / "box.ply")

    np.testing.assert_allclose(vertices, box.vertices, atol=1e-7)
    assert losses == []


@pytest.mark.parametrize("ascii_", [True, False])
def test_what_open3d_writes_is_read(tmp_path: Path, ascii_: bool) -> None:
    o3d = open3d()
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(random_points()))
    cloud.paint_uniform_color([0.1, 0.5, 1.0])
    o3d.io.write_point_cloud(str(tmp_path / "a.ply"), cloud, write_ascii=ascii_)

    ((found,), losses) = read(tmp_path / "a.ply")

    # As a text it holds six digits of each number.
    np.testing.assert_allclose(found, random_points(), rtol=5.1e-6 if ascii_ else 0)
    again = o3d.io.read_point_cloud(str(tmp_path / "a.ply"))
    assert found == np.asarray(again.points).tolist()
    assert losses == []


def test_an_exported_mesh_is_read_bit_for_bit(tmp_path: Path) -> None:
    mesh = build_mesh(house())
    write_ply(tmp_path / "a.ply", mesh)

    (cloud,) = PlyCloud(tmp_path / "a.ply").clouds()

    assert cloud.points.tobytes() == mesh.vertices.tobytes()


# Faults


@pytest.mark.parametrize(
    ("header", "words"),
    [
        (["element vertex 1", *XYZ[:2]], "x, y, expected a number x, y and z"),
        (["element vertex 1", *XYZ[:2], "property list uchar float z"], "expected a number x"),
        (["element vertex 1"], "has the properties none"),
        (["element face 1", "property list uchar int vertex_indices"], "no element vertex, .*face"),
        ([], "no element vertex, found no element at all"),
        (["element vertex -1", *XYZ], "a.ply:3: found 'element vertex -1'"),
        (["element vertex 1", "property real x"], "a.ply:4: found 'property real x'"),
        (["element vertex 1", "property list float int x"], "a.ply:4: found"),
        (["element vertex " + "9" * 5000, *XYZ], "a.ply:3: found 'element vertex 999"),
        (["property float x"], "a.ply:3: found 'property float x'"),
        (["format ebcdic 1.0"], "a.ply:3: found 'format ebcdic 1.0', .*binary_big_endian"),
    ],
)
def test_a_header_that_cannot_be_read_is_named(
    tmp_path: Path, header: list[str], words: str
) -> None:
    (tmp_path / "a.ply").write_bytes(ply("ascii", *header, body=b"1 2 3\n"))

    with pytest.raises(InputError, match=words):
        read(tmp_path / "a.ply")


@pytest.mark.parametrize("count", [10**12, 10**30])
@pytest.mark.parametrize("before", [[], ["element face 1", "property list uint int i"]])
def test_a_promise_that_the_file_cannot_hold_is_a_loss(
    tmp_path: Path, count: int, before: list[str]
) -> None:
    body = (bytes(4) if before else b"") + struct.pack("<6f", *range(6)) + bytes(5)
    header = [*before, f"element vertex {count}", *XYZ]
    (tmp_path / "a.ply").write_bytes(ply("binary_little_endian", *header, body=body))

    found = read_damaged(tmp_path / "a.ply", PlyCloud)

    assert found is not None
    assert found[0].tolist() == [[0, 1, 2], [3, 4, 5]]
    assert f"{count - 2:,} of {count:,} points" in found[1][0]


@pytest.mark.parametrize("length", [b"\xff\xff\xff\xff", b"\xff\xff\xff\x7f"])
def test_a_list_longer_than_the_file_ends_it(tmp_path: Path, length: bytes) -> None:
    header = ["element vertex 2", *XYZ, "property list uint double l"]
    body = struct.pack("<fffI", 1, 2, 3, 0) + struct.pack("<fff", 4, 5, 6) + length + bytes(64)
    (tmp_path / "a.ply").write_bytes(ply("binary_little_endian", *header, body=body))

    found = read_damaged(tmp_path / "a.ply", PlyCloud)

    assert found is not None
    assert found[0].tolist() == [[1, 2, 3]]
    assert "1 of 2 points is missing" in found[1][0]


def test_after_a_broken_element_no_vertex_is_guessed(tmp_path: Path) -> None:
    header = ["element face 2", "property list uint int l", "element vertex 1", *XYZ]
    body = struct.pack("<III", 1, 7, 2**31) + struct.pack("<fff", 1, 2, 3)
    (tmp_path / "a.ply").write_bytes(ply("binary_little_endian", *header, body=body))

    assert read(tmp_path / "a.ply")[0] == [[]]


def test_short_rows_of_the_next_element_are_not_joined_to_a_vertex(tmp_path: Path) -> None:
    header = ["element vertex 2", *XYZ, "element range_grid 8", "property list uchar int v"]
    body = b"1 2 3\n4 5 6\n" + b"0\n" * 6 + b"1 0\n1 1\n"
    (tmp_path / "a.ply").write_bytes(ply("ascii", *header, body=body))

    assert read(tmp_path / "a.ply") == ([[[1, 2, 3], [4, 5, 6]]], [])
    assert not PlyCloud(tmp_path / "a.ply").notes


def test_a_list_of_less_than_nothing_is_a_broken_row(tmp_path: Path) -> None:
    header = ["element vertex 3", "property list int int l", *XYZ]
    body = b"1 9 1 2 3\n-1 4 5 6 7\n-4 4 5 6\n"
    (tmp_path / "a.ply").write_bytes(ply("ascii", *header, body=body))

    found, losses = read(tmp_path / "a.ply")

    assert found == [[[1, 2, 3]]]
    assert "2 of 3 points are missing: the first is 2, found '-1 4 5 6 7'" in losses[0]


def test_a_row_without_all_its_numbers_is_no_point(tmp_path: Path) -> None:
    header = ["element vertex 4", *XYZ, "property float a"]
    for broken in (b"4 5 6", b"4 5\n6 0"):
        body = b"1 2 3 0\n" + broken + b"\n7 8 9 0\n"
        (tmp_path / "a.ply").write_bytes(ply("ascii", *header, body=body))
        clouds, losses = read(tmp_path / "a.ply")
        assert clouds == [[[1, 2, 3], [7, 8, 9]]]
        assert "2 of 4 points are missing: the first is 2, found '4 5" in losses[0]


def test_what_is_not_used_need_be_no_number(tmp_path: Path) -> None:
    header = ["element vertex 1", *XYZ, "property float a"]
    (tmp_path / "a.ply").write_bytes(ply("ascii", *header, body=b"1 2 3 x\n"))

    assert read(tmp_path / "a.ply") == ([[[1, 2, 3]]], [])


def test_broken_rows_are_left_out_and_told(tmp_path: Path) -> None:
    body = b"1 2 3\n4 x 6\n7 8\n9 9 9\n"
    (tmp_path / "a.ply").write_bytes(ply("ascii", "element vertex 4", *XYZ, body=body))

    clouds, losses = read(tmp_path / "a.ply")

    assert clouds == [[[1, 2, 3], [9, 9, 9]]]
    assert "2 of 4 points are missing: the first is 2, found '4 x 6', expected 3 num" in losses[0]


@pytest.mark.parametrize("encoding", ["ascii", "binary_little_endian"])
@pytest.mark.parametrize("tail", [[], ["property list uchar int l"]])
def test_of_a_cut_file_the_whole_vertices_come(
    tmp_path: Path, encoding: str, tail: list[str]
) -> None:
    points = np.round(random_points(200), 3).astype(np.float32)
    lists = [[7] * (k % 4) for k in range(200)]
    header = ["element vertex 200", *XYZ, *tail, "element face 1", "property int a"]
    rows = []
    for point, items in zip(points, lists, strict=True):
        if encoding == "ascii":
            words = [*point.tolist(), *([len(items), *items] if tail else [])]
            rows.append(" ".join(map(repr, words)).encode() + b"\n")
        else:
            extra = struct.pack(f"<B{len(items)}i", len(items), *items) if tail else b""
            rows.append(point.astype("<f4").tobytes() + extra)
    begin = len(ply(encoding, *header, body=b""))
    ends = begin + np.cumsum([len(row) for row in rows])
    content = ply(
        encoding, *header, body=b"".join(rows) + (b"1\n" if encoding == "ascii" else bytes(4))
    )
    for damaged in cut(content, 150):
        (tmp_path / "a.ply").write_bytes(damaged)
        found = read_damaged(tmp_path / "a.ply", PlyCloud)
        if len(damaged) < begin:
            assert found is None
            continue
        assert found is not None
        if encoding == "ascii" and ends[-2] < len(damaged) < ends[-1]:
            continue  # The last row of all may lack its line's end.
        whole = int(np.count_nonzero(ends <= len(damaged)))
        assert found[0].tolist() == points[:whole].astype(float).tolist()
        assert bool(found[1]) == (whole < 200)


@pytest.mark.parametrize("encoding", ["ascii", "binary"])
def test_a_flipped_bit_is_an_error_a_loss_or_one_wrong_number(
    tmp_path: Path, encoding: str
) -> None:
    cloud: Any = trimesh
    cloud.PointCloud(random_points(60)).export(tmp_path / "whole.ply", encoding=encoding)
    ((expected,), _) = read(tmp_path / "whole.ply")
    content = (tmp_path / "whole.ply").read_bytes()
    for damaged in flipped(content, 200, content.index(b"end_header")):
        (tmp_path / "a.ply").write_bytes(damaged)
        found = read_damaged(tmp_path / "a.ply", PlyCloud)
        if found is None or damaged.index(b"end_header") != content.index(b"end_header"):
            continue
        assert len(found[0]) == 60 or found[1] or b"vertex 60" not in damaged
        if damaged.startswith(content[: content.index(b"end_header")]) and not found[1]:
            assert np.count_nonzero(np.any(found[0] != expected, axis=1)) <= 1


@pytest.mark.parametrize("declared", [0, 20])
@pytest.mark.parametrize("after", ["", "element face 0\nproperty list uchar int i\n"])
def test_vertices_beyond_those_declared_are_taken(
    tmp_path: Path, declared: int, after: str
) -> None:
    points = np.random.default_rng(1).uniform(-9, 9, (36, 3)).astype("<f4")
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {declared}\n" + "".join(
        f"property float {axis}\n" for axis in "xyz"
    )
    content = (header + after + "end_header\n").encode() + points.tobytes()
    (tmp_path / "a.ply").write_bytes(content)
    cloud = PlyCloud(tmp_path / "a.ply")

    ((found,), losses) = [c.points.tolist() for c in cloud.clouds()], cloud.losses
    assert found == points.astype(float).tolist()
    assert not losses
    assert f"its header declares {declared} points, and there are 36" in cloud.notes[0]
    # Where something else is declared to follow, what follows is that.
    if after:
        (tmp_path / "a.ply").write_bytes(content.replace(b"face 0", b"face 9"))
        cloud = PlyCloud(tmp_path / "a.ply")
        assert sum(len(c.points) for c in cloud.clouds()) == declared
