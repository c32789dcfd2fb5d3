"""LAS and LAZ files as clouds.

How these tests could be cheated: by one point format, by float32 or an offset that is left out,
by points that laspy scales here and there alike. So the whole numbers in the file are parsed here
and scaled by the format's description; what a cut leaves is counted in records.
"""

from __future__ import annotations

import io
import math
import struct
from pathlib import Path

import laspy
import lazrs
import numpy as np
import pytest

from mlscli.errors import InputError
from mlscli.io import unpacking
from mlscli.io.clouds.las import LasCloud
from tests.helpers.damage import cut, flipped, read_damaged
from tests.helpers.las import parsed, read, write


@pytest.mark.parametrize("point_format", range(11))
def test_points_of_any_format_come_bit_for_bit(tmp_path: Path, point_format: int) -> None:
    expected = parsed(write(tmp_path / "a.las", point_format=point_format))

    assert read(tmp_path / "a.las") == ([expected.tolist()], [])
    assert len(expected) == 1000


def test_points_that_take_no_bytes_are_read_up_to_a_bound(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(unpacking, "ALWAYS", 100_000)
    monkeypatch.setattr(unpacking, "RATIO", 20)
    las = laspy.LasData(laspy.LasHeader(point_format=6, version="1.4"))
    las.X, las.Y, las.Z = np.zeros((3, 20_000), dtype=np.int32)
    path = tmp_path / "a.laz"
    las.write(path)
    ((points,), losses) = read(path)
    most = unpacking.most_unpacked(path.stat().st_size)
    assert len(points) == most // 30 < 20_000
    assert unpacking.excess(path.stat().st_size) in losses[0]


@pytest.mark.parametrize("point_format", [0, 1, 2, 3, 6, 7, 8])
def test_compressed_points_come_bit_for_bit(tmp_path: Path, point_format: int) -> None:
    expected = parsed(write(tmp_path / "a.las", 60_000, point_format))
    write(tmp_path / "a.laz", 60_000, point_format)

    assert read(tmp_path / "a.laz") == ([expected.tolist()], [])


def test_the_wall_is_what_laspy_reads_within_the_bounds_stated(shared_data: Path) -> None:
    path = shared_data / "multilevel/drone_odm_defect_wall.laz"
    las = laspy.read(path)

    (cloud,) = LasCloud(path).clouds()

    assert cloud.points.tolist() == np.column_stack([las.x, las.y, las.z]).tolist()
    assert len(cloud.points) == 79_892
    # The bounds are those of the points before they were rounded to the millimetre.
    np.testing.assert_allclose(cloud.points.min(axis=0), las.header.mins, rtol=0, atol=5.1e-4)
    np.testing.assert_allclose(cloud.points.max(axis=0), las.header.maxs, rtol=0, atol=5.1e-4)


@pytest.mark.parametrize("name", ["a.las", "a.laz"])
@pytest.mark.parametrize("point_format", [1, 7])
def test_withheld_points_are_left_out_and_told(
    tmp_path: Path, name: str, point_format: int
) -> None:
    withheld = np.arange(1000) % 3 == 0
    flags = {"withheld": withheld.astype(np.uint8), "synthetic": np.ones(1000, np.uint8)}
    expected = parsed(write(tmp_path / "a.las", point_format=point_format, **flags))
    write(tmp_path / name, point_format=point_format, **flags)

    clouds, losses = read(tmp_path / name)

    assert clouds == [expected[~withheld].tolist()]
    assert losses == []
    assert "334 points are flagged as withheld" in LasCloud(tmp_path / name).notes[0]


def test_an_extra_dimension_splits_the_cloud_by_keyframe(tmp_path: Path) -> None:
    keyframe = np.array([5, 2, 5, 5], dtype=np.uint16)
    points = parsed(write(tmp_path / "a.las", 4, keyframe=keyframe)).tolist()

    assert read(tmp_path / "a.las")[0] == [[points[0], points[2], points[3]], [points[1]]]


def test_a_file_without_points_has_an_empty_keyframe(tmp_path: Path) -> None:
    write(tmp_path / "a.las", 0)

    assert read(tmp_path / "a.las") == ([[]], [])


# Faults


@pytest.mark.parametrize("layer", range(1, 11))
def test_a_layer_larger_than_the_file_costs_little(tmp_path: Path, layer: int) -> None:
    content = bytearray(write(tmp_path / "a.laz", 300, 7).read_bytes())
    (begin,) = struct.unpack_from("<I", content, 96)
    # After the place of the table, and the first point, 36 bytes, stand the number of points and
    # the layers' sizes.
    sizes = begin + 8 + 36
    assert struct.unpack_from("<I", content, sizes) == (300,)
    struct.pack_into("<I", content, sizes + 4 * layer, 2**32 - 1)
    (tmp_path / "a.laz").write_bytes(content)

    found = read_damaged(tmp_path / "a.laz", LasCloud)

    assert found is not None
    assert len(found[0]) == 0
    assert "300 of 300 points" in found[1][0]


def test_a_table_of_chunks_that_cannot_be_costs_nothing(tmp_path: Path) -> None:
    expected = parsed(write(tmp_path / "a.las", 300))
    content = bytearray(write(tmp_path / "a.laz", 300).read_bytes())
    (begin,) = struct.unpack_from("<I", content, 96)
    (table,) = struct.unpack_from("<q", content, begin)
    struct.pack_into("<I", content, table + 4, 2**32 - 1)
    (tmp_path / "a.laz").write_bytes(content)

    found = read_damaged(tmp_path / "a.laz", LasCloud)

    assert found is not None
    assert found[0].tolist() == expected.tolist()


def with_chunks_of_any_size(tmp_path: Path, point_format: int) -> bytes:
    """Return a compressed file whose chunks have 100, 50 and 150 points; a.las holds the same."""
    plain = write(tmp_path / "a.las", 300, point_format).read_bytes()
    (begin,) = struct.unpack_from("<I", plain, 96)
    (size,) = struct.unpack_from("<H", plain, 105)
    content = write(tmp_path / "a.laz", 300, point_format).read_bytes()
    packing = lazrs.LazVlr.new_for_compression(point_format, 0, True)
    out = io.BytesIO()
    out.write(content[: struct.unpack_from("<I", content, 96)[0] - len(packing.record_data())])
    out.write(packing.record_data())
    compressor = lazrs.LasZipCompressor(out, packing)
    for first, last in [(0, 100), (100, 150), (150, 300)]:
        points = plain[begin + size * first : begin + size * last]
        compressor.compress_many(np.frombuffer(points, np.uint8))
        if last < 300:
            compressor.finish_current_chunk()
    compressor.done()
    return out.getvalue()


@pytest.mark.parametrize("point_format", [3, 7])
def test_chunks_may_have_any_size(tmp_path: Path, point_format: int) -> None:
    content = with_chunks_of_any_size(tmp_path, point_format)
    (tmp_path / "a.laz").write_bytes(content)

    assert read(tmp_path / "a.laz") == ([parsed(tmp_path / "a.las").tolist()], [])


@pytest.mark.parametrize("point_format", [3, 7])
def test_chunks_of_any_size_need_their_table(tmp_path: Path, point_format: int) -> None:
    content = with_chunks_of_any_size(tmp_path, point_format)
    (begin,) = struct.unpack_from("<I", content, 96)
    (table,) = struct.unpack_from("<q", content, begin)
    many = content[: table + 4] + b"\xff" * 4 + content[table + 8 :]
    nowhere = content[:begin] + struct.pack("<q", 2**40) + content[begin + 8 :]
    for damaged in (content[: table + 4], many, nowhere):
        (tmp_path / "a.laz").write_bytes(damaged)
        with pytest.raises(InputError, match="the table of its chunks"):
            read(tmp_path / "a.laz")


@pytest.mark.parametrize("name", ["a.las", "a.laz"])
def test_of_a_cut_file_the_points_before_the_cut_come(tmp_path: Path, name: str) -> None:
    expected = parsed(write(tmp_path / "a.las", 700)).tolist()
    content = write(tmp_path / name, 700).read_bytes()
    (begin,) = struct.unpack_from("<I", content, 96)
    before = 0
    for damaged in cut(content, 60):
        (tmp_path / name).write_bytes(damaged)
        found = read_damaged(tmp_path / name, LasCloud)
        if len(damaged) < begin:
            assert found is None
            continue
        assert found is not None
        came = len(found[0])
        assert found[0].tolist() == expected[:came]
        if came < 700:
            assert f"{700 - came:,} of 700 points" in found[1][0]
        if name == "a.las":
            assert came == (len(damaged) - begin) // 34
        assert came >= before
        before = came
    assert before >= 699


def test_of_a_cut_compressed_cloud_no_chunk_before_the_cut_is_lost(
    shared_data: Path, tmp_path: Path
) -> None:
    path = shared_data / "multilevel/drone_odm_defect_wall.laz"
    ((expected,), _) = read(path)
    content = path.read_bytes()
    for share, least in [(0.999, 79_000), (0.9, 50_000), (0.5, 25_000)]:
        (tmp_path / "a.laz").write_bytes(content[: int(share * len(content))])
        found = read_damaged(tmp_path / "a.laz", LasCloud)
        assert found is not None
        assert found[0].tolist() == expected[: len(found[0])]
        assert least <= len(found[0]) < 79_892
        assert "points" in found[1][0]


@pytest.mark.parametrize("name", ["a.las", "a.laz"])
def test_a_flipped_bit_is_an_error_a_loss_or_wrong_numbers(tmp_path: Path, name: str) -> None:
    content = write(tmp_path / name, 300).read_bytes()
    (begin,) = struct.unpack_from("<I", content, 96)
    count = content[107:111]
    for damaged in flipped(content, 70, begin):
        (tmp_path / name).write_bytes(damaged)
        found = read_damaged(tmp_path / name, LasCloud)
        if found is not None and damaged[107:111] == count:
            notes = LasCloud(tmp_path / name).notes
            assert len(found[0]) == 300 or found[1] or "withheld" in notes[0]


@pytest.mark.parametrize(
    ("name", "count"), [("a.las", 301), ("a.las", 2**32 - 1), ("a.laz", 2**32 - 1)]
)
def test_a_promise_that_the_file_cannot_hold_is_a_loss(
    tmp_path: Path, name: str, count: int
) -> None:
    content = bytearray(write(tmp_path / name, 300).read_bytes())
    struct.pack_into("<I", content, 107, count)
    (tmp_path / name).write_bytes(content)

    found = read_damaged(tmp_path / name, LasCloud)

    assert found is not None
    assert 290 <= len(found[0]) <= 300
    assert f"of {count:,} points" in found[1][0]


@pytest.mark.parametrize("point_format", [0, 1, 2, 3])
@pytest.mark.parametrize("more", [1, 11, 5000])
def test_no_point_is_made_of_the_bits_that_end_a_chunk(
    tmp_path: Path, point_format: int, more: int
) -> None:
    for count in (5, 36, 300, 301, 302):
        expected = parsed(write(tmp_path / "b.las", count, point_format)).tolist()
        content = bytearray(write(tmp_path / "a.laz", count, point_format).read_bytes())
        struct.pack_into("<I", content, 107, count + more)
        (tmp_path / "a.laz").write_bytes(content)

        (found,), losses = read(tmp_path / "a.laz")

        assert found == expected[: len(found)]
        assert len(found) >= count - 5
        assert len(losses) == 1


@pytest.mark.parametrize(
    ("place", "layout", "value", "words"),
    [
        (96, "<I", 2**32 - 1, "ends at byte .*, before its points"),
        (94, "<H", 2**16 - 1, "do not fit"),
        (104, "<B", 77, "cannot be read"),
        (105, "<H", 1, "cannot be read"),
        (131, "<d", 0, r"found scales of 0\.0, .* expected numbers other than 0"),
        (147, "<d", math.nan, "found scales of .*, nan, expected"),
    ],
)
def test_a_header_that_cannot_be_is_refused(
    tmp_path: Path, place: int, layout: str, value: int, words: str
) -> None:
    content = bytearray(write(tmp_path / "a.laz", 300).read_bytes())
    struct.pack_into(layout, content, place, value)
    (tmp_path / "a.laz").write_bytes(content)

    with pytest.raises(InputError, match=words):
        read(tmp_path / "a.laz")


def test_points_wider_than_their_packing_are_refused(tmp_path: Path) -> None:
    content = bytearray(write(tmp_path / "a.laz", 300).read_bytes())
    items = content.index(b"laszip encoded") + 52 + 32
    struct.pack_into("<H", content, items + 4, 2**16 - 1)
    (tmp_path / "a.laz").write_bytes(content)

    assert read_damaged(tmp_path / "a.laz", LasCloud) is None


def test_a_panic_of_the_decompressor_is_a_loss_and_prints_nothing(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    content = bytearray(write(tmp_path / "flight.laz", point_format=0).read_bytes())
    # The record of LASzip lists no items of which a point is made.
    record = content.index(b"laszip encoded") + 52
    struct.pack_into("<H", content, record + 32, 0)
    (tmp_path / "flight.laz").write_bytes(content)
    keyframes, losses = read(tmp_path / "flight.laz")
    assert not any(keyframes)
    assert "LazItem" in losses[0]
    assert capfd.readouterr().err == ""


def test_a_point_far_outside_the_bounds_is_damaged(tmp_path: Path) -> None:
    expected = parsed(write(tmp_path / "a.las", 300)).tolist()
    content = bytearray((tmp_path / "a.las").read_bytes())
    (begin,) = struct.unpack_from("<I", content, 96)
    content[begin + 34 * 7 + 3] ^= 0x40
    (tmp_path / "a.las").write_bytes(content)

    ((found,), (loss,)) = read(tmp_path / "a.las")
    assert found == expected[:7] + expected[8:]
    assert "1 of 300 points is damaged" in loss


def test_records_that_were_never_written_are_lost(tmp_path: Path) -> None:
    east = np.random.default_rng(2).integers(1000, 10**6, 300)
    expected = parsed(write(tmp_path / "a.las", 300, X=east)).tolist()
    content = bytearray((tmp_path / "a.las").read_bytes() + bytes(20 * 34))
    struct.pack_into("<I", content, 107, 320)
    (tmp_path / "a.las").write_bytes(content)

    assert read(tmp_path / "a.las") == (
        [expected],
        [
            f"{tmp_path / 'a.las'}: 20 of 320 points are damaged: some lie outside the bounds "
            "that the header states"
        ],
    )


@pytest.mark.parametrize("name", ["a.las", "a.laz"])
@pytest.mark.parametrize("end", [-(2**31), 2**31 - 1])
def test_points_whose_coordinates_did_not_fit_when_they_were_written_are_lost(
    tmp_path: Path, name: str, end: int
) -> None:
    north = np.random.default_rng(2).integers(1000, 10**6, 300)
    north[100:] = end
    expected = parsed(write(tmp_path / "b.las", 300, Y=north))[:100].tolist()
    (points,), (loss,) = read(write(tmp_path / name, 300, Y=north))

    assert points == expected
    assert "200 of 300 points are damaged: a coordinate is the last that 32 bits hold" in loss


@pytest.mark.parametrize("point_format", [3, 7])
def test_of_damaged_compressed_points_hardly_any_is_mapped_that_was_not_there(
    tmp_path: Path, point_format: int
) -> None:
    expected = {tuple(p) for p in parsed(write(tmp_path / "b.las", 3000, point_format)).tolist()}
    content = write(tmp_path / "a.laz", 3000, point_format).read_bytes()
    begin = struct.unpack_from("<I", content, 96)[0] + 8
    (table,) = struct.unpack_from("<q", content, begin - 8)
    for place in range(begin + 40, table - 40, (table - begin) // 25):
        damaged = bytearray(content)
        damaged[place] ^= 0x10
        (tmp_path / "a.laz").write_bytes(damaged)
        found = read_damaged(tmp_path / "a.laz", LasCloud)
        if found is not None:
            assert sum(tuple(p) not in expected for p in found[0].tolist()) <= 2
            assert found[1] or len(found[0]) == 3000
