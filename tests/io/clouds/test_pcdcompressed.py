"""Damage in compressed PCDs, which have no checksum.

How these tests could be cheated: by refusing whatever is strange, so clouds of many kinds, by
several encoders and by none that is known, must be read without a word; by looking for the one byte
that a test changes, so any byte is changed at random and shares are counted; by giving up files of
which most is whole. The encoder of the tests writes what Open3D does, byte for byte.
"""

from __future__ import annotations

import random
import struct
from pathlib import Path

import numpy as np
import pytest

from mlscli.errors import InputError
from mlscli.io.clouds.pcd import PcdCloud
from mlscli.io.plausibility.repetitions import repeats_as_encoded
from mlscli.runtime.arrays import Array, Float64
from tests.helpers.meshes import open3d
from tests.helpers.pcds import compressed, encoded, pcd

LIBLZF, PCL = (16, 5, 2), (13, 1, 1)


def terrain(count: int = 1500, seed: int = 1) -> list[Array]:
    """Return x, y, z of a line-by-line scan, with noise."""
    rng = np.random.default_rng(seed)
    place = np.arange(count)
    x, y = place % 50 * 0.4 - 10, place // 50 * 0.4 + 2
    z = 3 + np.sin(x / 3) + 0.5 * np.cos(y)
    return [(axis + rng.normal(0, 0.01, count)).astype("<f4") for axis in (x, y, z)]


def shuffled(columns: list[Array]) -> list[Array]:
    order = np.random.default_rng(2).permutation(len(columns[0]))
    return [column[order] for column in columns]


def rounded(columns: list[Array], step: float) -> list[Array]:
    return [(np.round(column.astype(float) / step) * step).astype("<f4") for column in columns]


def outlying(columns: list[Array]) -> list[Array]:
    """Return points of which some lie far away, along their ray."""
    far = np.where(np.arange(len(columns[0])) % 40, 1.0, 37.0).astype("<f4")
    return [column * far for column in columns]


CLOUDS = {
    "scan": terrain(),
    "shuffled": shuffled(terrain()),
    "millimetres": rounded(shuffled(terrain()), 0.001),
    "voxels": rounded(terrain(), 0.25),
    "utm": [column + np.float32(offset) for column, offset in zip(
        rounded(terrain(), 0.01), (512_000, 5_400_000, 300), strict=True)],
    "outliers": outlying(terrain()),
    "colours": [*terrain(), (np.arange(1500) // 7 % 5 * 0.2).astype("<f4")],
}  # fmt: skip


def write(path: Path, columns: list[Array], body: bytes | None = None) -> Path:
    plain = b"".join(column.tobytes() for column in columns)
    body = encoded(plain) if body is None else body
    count, fields = len(columns[0]), ["x", "y", "z", "intensity"][: len(columns)]
    entries = {
        "FIELDS": " ".join(fields), "SIZE": " ".join("4" for _ in fields),
        "TYPE": " ".join("F" for _ in fields), "COUNT": " ".join("1" for _ in fields),
        "WIDTH": count, "POINTS": count,
    }  # fmt: skip
    packed = struct.pack("<II", len(body), len(plain)) + body
    path.write_bytes(pcd("binary_compressed", packed, **entries))
    return path


def read(path: Path) -> tuple[Float64, list[str]]:
    source = PcdCloud(path)
    (cloud,) = source.clouds()
    assert not source.notes
    return cloud.points, list(source.losses)


def points_of(columns: list[Array]) -> Float64:
    return np.stack(columns[:3], axis=1).astype(float)


@pytest.mark.parametrize("encoder", [LIBLZF, PCL, (16, 1, 1), (14, 5, 264)])
@pytest.mark.parametrize("name", CLOUDS)
def test_what_any_encoder_wrote_is_read_without_a_word(
    tmp_path: Path, name: str, encoder: tuple[int, int, int]
) -> None:
    columns = CLOUDS[name]
    plain = b"".join(column.tobytes() for column in columns)

    found, losses = read(write(tmp_path / "a.pcd", columns, encoded(plain, *encoder)))

    assert found.tolist() == points_of(columns).tolist()
    assert losses == []


@pytest.mark.parametrize("name", CLOUDS)
def test_so_is_what_an_unknown_encoder_wrote(tmp_path: Path, name: str) -> None:
    columns = CLOUDS[name]
    plain = b"".join(column.tobytes() for column in columns)

    found, losses = read(write(tmp_path / "a.pcd", columns, compressed(plain)))

    assert found.tolist() == points_of(columns).tolist()
    assert losses == []


def test_the_encoder_of_these_tests_writes_what_open3d_does(tmp_path: Path) -> None:
    library = open3d()
    columns = CLOUDS["millimetres"]
    cloud = library.geometry.PointCloud(library.utility.Vector3dVector(points_of(columns)))
    library.io.write_point_cloud(str(tmp_path / "o.pcd"), cloud, compressed=True)
    _, _, body = (tmp_path / "o.pcd").read_bytes().partition(b"DATA binary_compressed\n")

    assert body[8:] == encoded(b"".join(column.tobytes() for column in columns))


@pytest.mark.parametrize(
    ("name", "least", "most"),
    [("voxels", 0.9, 0.07), ("utm", 0.8, 0.12), ("millimetres", 0.65, 0.3), ("scan", 0.25, 0.35)],
)
def test_a_changed_byte_seldom_moves_points_unnoticed(
    tmp_path: Path, name: str, least: float, most: float
) -> None:
    columns = CLOUDS[name]
    expected = points_of(columns)
    body = encoded(b"".join(column.tobytes() for column in columns))
    dice, noticed, moved, garbage, times = random.Random(3), 0, 0, 0, 150
    for _ in range(times):
        damaged = bytearray(body)
        damaged[dice.randrange(len(body))] ^= dice.randrange(1, 256)
        try:
            found, losses = read(write(tmp_path / "a.pcd", columns, bytes(damaged)))
        except InputError:
            noticed += 1
            continue
        if losses:
            noticed += 1
            kept = set(map(tuple, expected.tolist()))
            garbage += sum(tuple(point) not in kept for point in found.tolist()) > 5
        else:
            cell = float(np.ptp(expected, axis=0).max()) / 100
            moved += bool((~(np.abs(found - expected) <= cell)).any())

    assert noticed >= least * times
    assert moved <= most * times
    assert not garbage


def distances(body: bytearray) -> list[int]:
    """Return the offsets of the bytes that say how far back each step repeats."""
    at, found = 0, []
    while at < len(body):
        control = body[at]
        at += control + 2 if control < 32 else 3 if control >= 224 else 2
        found += [at - 1] * (control >= 32)
    return found


def test_a_byte_of_what_repeats_is_the_end_of_trust(tmp_path: Path) -> None:
    columns = CLOUDS["voxels"]
    body = bytearray(encoded(b"".join(column.tobytes() for column in columns)))
    # What lies 8 bytes farther back, or nearer, is another number.
    body[distances(body)[400]] ^= 8

    with pytest.raises(InputError, match="repetitions are not as an encoder writes them"):
        read(write(tmp_path / "a.pcd", columns, bytes(body)))


def test_damage_behind_the_coordinates_is_told_and_they_are_taken(tmp_path: Path) -> None:
    columns = [*terrain(9000), rounded(terrain(9000), 0.25)[2]]
    body = bytearray(encoded(b"".join(column.tobytes() for column in columns)))
    body[distances(body)[-100]] ^= 8

    found, losses = read(write(tmp_path / "a.pcd", columns, bytes(body)))

    assert found.tolist() == points_of(columns).tolist()
    assert len(losses) == 1
    assert "is damaged behind the coordinates" in losses[0]


def test_a_wrong_exponent_and_what_repeats_it_are_left_out(tmp_path: Path) -> None:
    columns = terrain()
    # Two points in one place, the second of which repeats the bytes of the first.
    for column in columns:
        column[701] = column[700]
    wrong = [column.copy() for column in columns]
    for row in (700, 701):
        wrong[1].view(np.uint8)[4 * row + 3] ^= 64

    found, losses = read(write(tmp_path / "a.pcd", wrong))

    expected = np.delete(points_of(columns), [700, 701], axis=0)
    assert found.tolist() == expected.tolist()
    assert losses == [
        f"{tmp_path / 'a.pcd'}: 2 of 1,500 points are damaged, 2 by coordinates of another order "
        "of magnitude than all others, and left out"
    ]


@pytest.mark.parametrize("rows", [slice(0, 40), slice(3, 4)])
def test_points_that_lie_far_away_are_no_damage(tmp_path: Path, rows: slice) -> None:
    columns = [column.copy() for column in terrain()]
    # Many in one coordinate, or one along its ray.
    for column in columns[: 1 if rows.stop == 40 else 3]:
        column[rows] *= np.float32(1e6)

    found, losses = read(write(tmp_path / "a.pcd", columns))

    assert found.tolist() == points_of(columns).tolist()
    assert losses == []


@pytest.mark.parametrize("seed", [94, 185, 211, 272, 277])
def test_a_handful_of_repetitions_tells_no_encoder(seed: int) -> None:
    rng = np.random.default_rng(seed)
    count = int(rng.integers(20, 120))
    plain = b"".join(rng.integers(-9, 9, count).astype(t).tobytes() for t in ("i1", "i1", "i2"))
    body = np.frombuffer(compressed(plain, seed), np.uint8)

    found = repeats_as_encoded(body, np.frombuffer(plain, np.uint8), len(plain))

    assert found.value is True
