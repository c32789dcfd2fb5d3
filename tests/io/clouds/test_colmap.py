"""COLMAP models.

How these tests could be cheated: by the last image of a track instead of the first by name, by
numbers of images taken for their order, by t instead of -R^T t, by skipping the blank line that
an image without features has. So models are written here by the format's description, with
numbers against the order of names, as text and as binary; the real one is parsed here once more.
"""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from mlscli.errors import InputError
from mlscli.io.clouds.colmap import ColmapModel
from mlscli.io.reading.formats import open_source
from mlscli.io.reading.recording import open_recording
from mlscli.runtime.arrays import Float64
from tests.helpers.damage import cut, flipped, read_damaged


class Image(NamedTuple):
    number: int
    name: str
    quaternion: Sequence[float]
    translation: Sequence[float]
    features: int = 0


class Point(NamedTuple):
    xyz: Sequence[float]
    track: Sequence[int]


S = math.sqrt(0.5)
# World to camera: turned by 90 degrees about z, (x, y, z) to (-y, x, z).
TURN = (S, 0.0, 0.0, S)
STILL = (1.0, 0.0, 0.0, 0.0)
IMAGES = [
    Image(3, "c.jpg", STILL, (1.0, 2.0, 3.0), 2),
    Image(9, "a.jpg", TURN, (1.0, 2.0, 3.0)),
    Image(1, "b 2.jpg", STILL, (0.0, 0.0, -5.0), 1),
]
POINTS = [
    Point((1.0, 0.0, 0.1), (3, 1)),
    Point((2.0, 0.0, 0.2), (3,)),
    Point((3.0, 0.0, 0.3), (1, 9, 3)),
    Point((4.0, 0.0, 0.4), ()),
    Point((5.0, 0.0, 0.5), (77,)),
]


def write_text(folder: Path, images: Sequence[Image] | None, points: Sequence[Point]) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    lines = [
        "# 3D point list with one line of data per point:",
        f"# Number of points: {len(points)}, mean track length: 2",
    ]
    for number, point in enumerate(points):
        track = " ".join(f"{image} {k}" for k, image in enumerate(point.track))
        lines.append(f"{number} {' '.join(map(repr, point.xyz))} 9 9 9 0.5 {track}")
    (folder / "points3D.txt").write_text("\n".join([*lines, ""]))
    if images is not None:
        lines = [
            "# Image list with two lines of data per image:",
            f"# Number of images: {len(images)}, mean",
        ]
        for image in images:
            pose = " ".join(map(repr, [*image.quaternion, *image.translation]))
            lines += [
                f"{image.number} {pose} 1 {image.name}",
                " ".join(["1.5 2.5 -1"] * image.features),
            ]
        (folder / "images.txt").write_text("\n".join([*lines, ""]))
    return folder


def write_binary(folder: Path, images: Sequence[Image] | None, points: Sequence[Point]) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    parts = [struct.pack("<Q", len(points))]
    for number, point in enumerate(points):
        parts.append(struct.pack("<Q3d3BdQ", number, *point.xyz, 9, 9, 9, 0.5, len(point.track)))
        parts += [struct.pack("<II", image, k) for k, image in enumerate(point.track)]
    (folder / "points3D.bin").write_bytes(b"".join(parts))
    if images is not None:
        parts = [struct.pack("<Q", len(images))]
        for image in images:
            pose = (*image.quaternion, *image.translation)
            parts.append(struct.pack("<I7dI", image.number, *pose, 1))
            parts.append(image.name.encode() + b"\0" + struct.pack("<Q", image.features))
            parts += [struct.pack("<ddQ", 1.5, 2.5, 2**64 - 1)] * image.features
        (folder / "images.bin").write_bytes(b"".join(parts))
    return folder


writers = pytest.mark.parametrize("write", [write_text, write_binary])


@writers
def test_a_point_belongs_to_the_first_image_by_name_that_saw_it(tmp_path: Path, write: Any) -> None:
    source = ColmapModel(write(tmp_path / "m", IMAGES, POINTS))

    clouds = list(source.clouds())

    # By name: a (9), b (1), c (3); points that no image saw are the last keyframe.
    assert [cloud.points[:, 0].tolist() for cloud in clouds] == [[3], [1], [2], [4, 5]]
    assert clouds[0].points.tolist() == [[3, 0, 0.3]]
    assert "2 of 5 points were seen by none of the images" in source.notes[0]
    assert list(source.losses) == []


@writers
def test_a_camera_is_where_its_pose_sees_zero(tmp_path: Path, write: Any) -> None:
    clouds = list(ColmapModel(write(tmp_path / "m", IMAGES, POINTS)).clouds())

    # R c + t = 0: of the turn, (-y, x, z) = (-1, -2, -3).
    np.testing.assert_allclose(clouds[0].position, (-2, 1, -3), atol=1e-12)
    np.testing.assert_allclose(clouds[1].position, (0, 0, 5), atol=1e-12)
    np.testing.assert_allclose(clouds[2].position, (-1, -2, -3), atol=1e-12)
    assert all(map(math.isnan, clouds[3].position))


@writers
def test_a_pose_that_is_none_leaves_the_place_unknown(tmp_path: Path, write: Any) -> None:
    for quaternion in [(0.0, 0, 0, 0), (math.nan, 0, 0, 1), (1e300, 1e300, 0, 0)]:
        model = write(tmp_path / "m", [Image(1, "a", quaternion, (1, 2, 3))], POINTS[:1])
        source = ColmapModel(model)
        (cloud,) = source.clouds()
        assert all(map(math.isnan, cloud.position))
        assert sum("1 of 1 image has no pose in numbers" in note for note in source.notes) == 1


@writers
def test_images_without_points_are_keyframes(tmp_path: Path, write: Any) -> None:
    source = ColmapModel(write(tmp_path / "m", IMAGES, POINTS[2:3]))

    assert [len(cloud.points) for cloud in source.clouds()] == [1, 0, 0]
    assert source.expected_keyframes == 3


@writers
def test_without_images_all_points_are_one_keyframe(tmp_path: Path, write: Any) -> None:
    source = ColmapModel(write(tmp_path / "m", None, POINTS))

    (cloud,) = source.clouds()

    assert cloud.points.tolist() == [list(point.xyz) for point in POINTS]
    assert "one keyframe" in source.notes[0]


# Where it lies


@writers
@pytest.mark.parametrize("place", [".", "sparse", "sparse/0", "0", "sparse/12"])
def test_the_folder_of_a_project_leads_to_its_only_model(
    tmp_path: Path, write: Any, place: str
) -> None:
    write(tmp_path / "m" / place, IMAGES, POINTS)

    assert open_source(tmp_path / "m").kind == "COLMAP model"
    assert len(list(open_source(tmp_path / "m").clouds())) == 4


def test_of_several_models_one_must_be_named(tmp_path: Path) -> None:
    write_binary(tmp_path / "m/sparse/0", IMAGES, POINTS)
    write_text(tmp_path / "m/sparse/1", IMAGES, POINTS)

    with pytest.raises(InputError, match=r"holds 2 COLMAP models.*sparse/0, .*sparse/1"):
        open_source(tmp_path / "m")


@writers
def test_the_file_of_points_leads_to_its_images(tmp_path: Path, write: Any) -> None:
    (file,) = write(tmp_path / "m", IMAGES, POINTS).glob("points3D.*")

    assert len(list(open_source(file).clouds())) == 4


def test_a_text_of_points_is_told_by_its_first_line(tmp_path: Path) -> None:
    write_text(tmp_path, None, POINTS)
    (tmp_path / "points3D.txt").rename(tmp_path / "cloud.xyz")

    (cloud,) = open_source(tmp_path / "cloud.xyz").clouds()

    assert cloud.points.tolist() == [list(point.xyz) for point in POINTS]


# The real model


def parsed(folder: Path) -> tuple[dict[int, tuple[str, Float64]], list[tuple[Float64, list[int]]]]:
    """Return each image's name and centre, and each point with the images that saw it."""
    images, points = {}, []
    with (folder / "images.bin").open("rb") as file:
        for _ in range(struct.unpack("<Q", file.read(8))[0]):
            number, w, x, y, z, *t, _ = struct.unpack("<I7dI", file.read(64))
            name = b"".join(iter(lambda: file.read(1), b"\0")).decode()
            file.seek(24 * struct.unpack("<Q", file.read(8))[0], 1)
            r = [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
            images[number] = name, -np.array(r).T @ np.array(t)
    with (folder / "points3D.bin").open("rb") as file:
        for _ in range(struct.unpack("<Q", file.read(8))[0]):
            _, *xyz, _, _, _, _, length = struct.unpack("<Q3d3BdQ", file.read(51))
            track = struct.unpack(f"<{2 * length}I", file.read(8 * length))
            points.append((np.array(xyz), list(track[::2])))
    return images, points


def test_the_real_model_is_what_a_plain_parser_reads(shared_data: Path) -> None:
    folder = shared_data / "sparse/colmap_pysfm"
    images, points = parsed(folder)
    order = sorted(images, key=lambda number: images[number][0])

    clouds = list(ColmapModel(folder).clouds())

    assert len(clouds) == 11
    for number, cloud in zip(order, clouds, strict=True):
        first = [min(track, key=order.index) for _, track in points]
        expected = [xyz.tolist() for (xyz, _), f in zip(points, first, strict=True) if f == number]
        assert cloud.points.tolist() == expected
        np.testing.assert_allclose(cloud.position, images[number][1], atol=1e-9)


def test_the_real_model_as_text_gives_the_same(shared_data: Path, tmp_path: Path) -> None:
    folder = shared_data / "sparse/colmap_pysfm"
    images, points = parsed(folder)
    expected = list(ColmapModel(folder).clouds())
    # The pose that a centre has where the camera is not turned.
    written = [Image(n, name, STILL, (-c).tolist(), 1) for n, (name, c) in images.items()]
    write_text(tmp_path, written, [Point(xyz.tolist(), track) for xyz, track in points])

    clouds = list(ColmapModel(tmp_path).clouds())

    assert [c.points.tolist() for c in clouds] == [c.points.tolist() for c in expected]
    np.testing.assert_allclose([c.position for c in clouds], [c.position for c in expected])


def test_the_route_is_turned_with_the_points(shared_data: Path) -> None:
    folder = shared_data / "sparse/colmap_pysfm"
    keyframes = list(open_recording(folder, up="-y").keyframes())

    for keyframe, cloud in zip(keyframes, ColmapModel(folder).clouds(), strict=True):
        x, y, z = cloud.position
        assert keyframe.position == (x, z, -y)


# Faults


def many(count: int = 60) -> tuple[list[Image], list[Point]]:
    rng = np.random.default_rng(1)
    images = [Image(k, f"{k:03}.jpg", STILL, (k, 0.0, 0.0), k % 3) for k in range(5)]
    return images, [
        Point(rng.normal(size=3).tolist(), rng.integers(0, 5, k % 4).tolist()) for k in range(count)
    ]


@writers
@pytest.mark.parametrize("stem", ["points3D", "images"])
def test_of_a_cut_model_what_is_whole_comes_and_the_rest_is_told(
    tmp_path: Path, write: Any, stem: str
) -> None:
    images, points = many()
    model = write(tmp_path / "m", images, points)
    (file,) = model.glob(f"{stem}.*")
    expected = {tuple(point.xyz) for point in points}
    content = file.read_bytes()
    for damaged in cut(content, 100):
        file.write_bytes(damaged)
        found = read_damaged(model, ColmapModel)
        if found is None:
            assert len(damaged) < 8
            continue
        came = set(map(tuple, found[0].tolist()))
        if stem == "images":
            assert came == expected
        elif came != expected:
            # All but the last, whose numbers a text may have lost the end of.
            assert len(came - expected) <= (0 if write is write_binary else 1)
            assert found[1] or not damaged or damaged.count(b"\n") < 2
        whole = content.count(b"\n", 0, len(damaged)) - 2
        if write is write_binary and stem == "points3D":
            ends = 8 + np.cumsum([51 + 8 * len(point.track) for point in points])
            assert len(came) == np.count_nonzero(ends <= len(damaged))
        elif stem == "points3D":
            assert len(came) >= whole


@writers
@pytest.mark.parametrize("stem", ["points3D", "images"])
def test_a_flipped_bit_is_an_error_a_loss_or_wrong_numbers(
    tmp_path: Path, write: Any, stem: str
) -> None:
    images, points = many()
    model = write(tmp_path / "m", images, points)
    (file,) = model.glob(f"{stem}.*")
    for damaged in flipped(file.read_bytes(), 200, 100):
        file.write_bytes(damaged)
        found = read_damaged(model, ColmapModel)
        assert found is None or len(found[0]) == 60 or found[1] or stem == "points3D"


@pytest.mark.parametrize("count", [2**64 - 1, 61])
def test_a_promise_that_the_file_cannot_hold_is_a_loss(tmp_path: Path, count: int) -> None:
    model = write_binary(tmp_path / "m", *many())
    for file in model.iterdir():
        file.write_bytes(struct.pack("<Q", count) + file.read_bytes()[8:])

    found = read_damaged(model, ColmapModel)

    assert found is not None
    assert len(found[0]) == 60
    assert f"of {count:,} images" in found[1][0]
    assert f"{count - 60:,} of {count:,} points" in found[1][1]


def test_a_track_longer_than_the_file_ends_it(tmp_path: Path) -> None:
    model = write_binary(tmp_path / "m", IMAGES, POINTS)
    content = bytearray((model / "points3D.bin").read_bytes())
    # The length of the first track.
    struct.pack_into("<Q", content, 8 + 43, 2**63 + 2)
    (model / "points3D.bin").write_bytes(content)

    found = read_damaged(model, ColmapModel)

    assert found is not None
    assert len(found[0]) == 0
    assert "5 of 5 points" in found[1][0]


def test_an_image_whose_name_may_have_lost_its_end_is_told(tmp_path: Path) -> None:
    model = write_text(tmp_path / "m", IMAGES[1:] + IMAGES[:1], POINTS)
    text = (model / "images.txt").read_text()
    (model / "images.txt").write_text(text[: text.index("c.jpg") + 3])
    source = ColmapModel(model)

    assert len(list(source.clouds())) == 3
    assert "1 of 3 images is missing" in source.losses[0]


def test_broken_lines_of_a_text_are_left_out_and_told(tmp_path: Path) -> None:
    model = write_text(tmp_path / "m", IMAGES, POINTS)
    text = (model / "points3D.txt").read_text()
    (model / "points3D.txt").write_text(text.replace("2.0 0.0 0.2", "2.0 zero 0.2"))
    text = (model / "images.txt").read_text()
    (model / "images.txt").write_text(text.replace("9 0.7", "nine 0.7"))
    source = ColmapModel(model)

    assert [cloud.points[:, 0].tolist() for cloud in source.clouds()] == [[1, 3], [], [4, 5]]
    assert "1 of 3 images is missing: the first broken line is 'nine 0.7" in source.losses[0]
    assert "1 of 5 points is missing: the first broken line is '1 2.0 zero" in source.losses[1]


def test_decimal_commas_in_a_text_are_named(tmp_path: Path) -> None:
    # As COLMAP writes it where the locale says so.
    model = write_text(tmp_path / "m", IMAGES, POINTS)
    for name in ("points3D.txt", "images.txt"):
        lines = (model / name).read_text().split("\n")
        lines = [each if each.startswith("#") else each.replace(".", ",") for each in lines]
        (model / name).write_text("\n".join(lines))

    losses = ColmapModel(model).losses

    assert len(losses) == 2
    assert all(re.search(r"\d,\d.*, expected decimal points$", loss) for loss in losses)


def test_a_broken_image_is_one_whatever_its_features(tmp_path: Path) -> None:
    model = write_text(tmp_path / "m", [image._replace(features=3) for image in IMAGES], POINTS)
    text = (model / "images.txt").read_text().replace("9 0.7", "nine 0.7")
    # Nothing but the lines themselves says how many there are.
    (model / "images.txt").write_text(text.replace("# Number of images", "# Images"))
    source = ColmapModel(model)

    assert [cloud.points[:, 0].tolist() for cloud in source.clouds()] == [[1, 3], [2], [4, 5]]
    assert "1 of 3 images is missing: the first broken line is 'nine 0.7" in source.losses[0]
