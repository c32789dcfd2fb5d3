"""OpenSfM and OpenDroneMap reconstructions.

How these tests could be cheated: by shots in the order of the file, by points of the last shot in
tracks.csv, by one version of it, by the first reconstruction of several. So shots stand in no
order, rows of tracks in any, and rotations are checked by Rodrigues' formula.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mlscli.errors import InputError
from mlscli.io.clouds.opensfm import OpenSfmReconstruction
from mlscli.io.reading.formats import open_source
from mlscli.io.reading.recording import open_recording
from mlscli.runtime.arrays import Float64
from tests.helpers.damage import cut, flipped, read_damaged

QUARTER = math.pi / 2
SHOTS: dict[str, Any] = {
    "c.jpg": {"rotation": [0, 0, 0], "translation": [1, 2, 3], "capture_time": 30.5},
    "a.jpg": {"rotation": [0, 0, QUARTER], "translation": [1, 2, 3], "capture_time": 40.5},
    "b.jpg": {"rotation": [0, 0, 0], "translation": [0, 0, -5], "capture_time": 20.5},
}
POINTS: dict[str, Any] = {
    "11": {"coordinates": [1.0, 0.0, 0.1], "color": [1, 2, 3]},
    "7": {"coordinates": [2.0, 0.0, 0.2], "color": [1, 2, 3]},
    "5": {"coordinates": [3.0, 0.0, 0.3], "color": [1, 2, 3]},
    "4": {"coordinates": [4.0, 0.0, 0.4], "color": [1, 2, 3]},
}
SEEN = [("a.jpg", "11"), ("c.jpg", "11"), ("a.jpg", "7"), ("c.jpg", "5"), ("b.jpg", "5")]
# What follows shot and point: feature, x, y, [scale], colour, [segmentation, instance].
HEADS = ["", "OPENSFM_TRACKS_VERSION_v1\n", "OPENSFM_TRACKS_VERSION_v2\n"]
TAILS = ["4\t.1\t.2\t9\t8\t7", "4\t.1\t.2\t.01\t9\t8\t7", "4\t.1\t.2\t.01\t9\t8\t7\t-1\t-1"]


def write(folder: Path, document: Any = None, version: int | None = 2) -> Path:
    """Write a reconstruction, and its tracks in a version, or none; return its file."""
    folder.mkdir(parents=True, exist_ok=True)
    document = [{"cameras": {}, "shots": SHOTS, "points": POINTS}] if document is None else document
    (folder / "reconstruction.json").write_text(json.dumps(document))
    if version is not None:
        rows = [f"{shot}\t{point}\t{TAILS[version]}\n" for shot, point in SEEN]
        rows.insert(2, f"never.jpg\t4\t{TAILS[version]}\n")
        (folder / "tracks.csv").write_text(HEADS[version] + "".join(rows))
    return folder / "reconstruction.json"


@pytest.mark.parametrize("version", [0, 1, 2])
def test_a_point_belongs_to_the_first_shot_by_time_that_saw_it(
    tmp_path: Path, version: int
) -> None:
    source = OpenSfmReconstruction(write(tmp_path, version=version))

    clouds = list(source.clouds())

    assert [cloud.points[:, 0].tolist() for cloud in clouds] == [[3], [1], [2], [4]]
    assert clouds[0].points.tolist() == [[3, 0, 0.3]]
    assert [cloud.stamp for cloud in clouds[:3]] == [20.5, 30.5, 40.5]
    assert source.time_span() == (20.5, 40.5)
    assert "1 of 4 points was seen by none of the images" in source.notes[0]
    assert list(source.losses) == []


def test_shots_without_a_time_go_by_name(tmp_path: Path) -> None:
    for time in ({}, {"capture_time": 0}, {"capture_time": None}):
        shots = {
            name: {k: v for k, v in shot.items() if k != "capture_time"} | time
            for name, shot in SHOTS.items()
        }
        path = write(tmp_path, [{"shots": shots, "points": POINTS}])
        clouds = list(OpenSfmReconstruction(path).clouds())
        assert [cloud.points[:, 0].tolist() for cloud in clouds] == [[1, 2], [3], [], [4]]
        assert all(math.isnan(cloud.stamp) for cloud in clouds)


def test_a_camera_is_where_its_pose_sees_zero(tmp_path: Path) -> None:
    clouds = list(OpenSfmReconstruction(write(tmp_path)).clouds())

    np.testing.assert_allclose(clouds[0].position, (0, 0, 5), atol=1e-12)
    np.testing.assert_allclose(clouds[1].position, (-1, -2, -3), atol=1e-12)
    # R c + t = 0: turned by 90 degrees about z, (-y, x, z) = (-1, -2, -3).
    np.testing.assert_allclose(clouds[2].position, (-2, 1, -3), atol=1e-12)
    assert all(map(math.isnan, clouds[3].position))


@pytest.mark.parametrize(
    "pose",
    [
        {},
        {"rotation": [0, 0], "translation": [1, 2, 3]},
        {"rotation": [0, 0, 0], "translation": "abc"},
        {"rotation": [0, 0, 0], "translation": [1, None, 3]},
        {"rotation": [10**400, 0, 0], "translation": [1, 2, 3]},
    ],
)
def test_a_pose_that_is_none_leaves_the_place_unknown(tmp_path: Path, pose: dict[str, Any]) -> None:
    path = write(tmp_path, [{"shots": {"a.jpg": pose}, "points": {"11": POINTS["11"]}}])

    (cloud,) = OpenSfmReconstruction(path).clouds()

    assert all(map(math.isnan, cloud.position))


def test_without_tracks_all_points_are_one_keyframe(tmp_path: Path) -> None:
    source = OpenSfmReconstruction(write(tmp_path, version=None))

    (cloud,) = source.clouds()

    assert cloud.points.tolist() == [point["coordinates"] for point in POINTS.values()]
    assert "no tracks.csv" in source.notes[0]


def test_of_several_reconstructions_the_one_with_most_shots_is_taken(tmp_path: Path) -> None:
    small = {"shots": {"z.jpg": SHOTS["a.jpg"]}, "points": {str(k): POINTS["7"] for k in range(9)}}
    large = {"shots": SHOTS, "points": POINTS}
    source = OpenSfmReconstruction(write(tmp_path, [small, large]))

    assert sum(len(cloud.points) for cloud in source.clouds()) == 4
    assert "2 reconstructions" in source.notes[0]
    assert "most shots, 3, and 4 points" in source.notes[0]


@pytest.mark.parametrize("place", [".", "opensfm"])
def test_the_folder_of_a_project_leads_to_the_reconstruction(tmp_path: Path, place: str) -> None:
    write(tmp_path / "m" / place)

    assert len(list(open_source(tmp_path / "m").clouds())) == 4


def test_it_is_told_by_what_the_json_holds(tmp_path: Path) -> None:
    write(tmp_path).rename(tmp_path / "cloud.txt")
    assert open_source(tmp_path / "cloud.txt").kind == "OpenSfM reconstruction"

    (tmp_path / "other.json").write_text('{"points": [[1, 2, 3]]}')
    with pytest.raises(InputError, match="a JSON file, which cannot be read"):
        open_source(tmp_path / "other.json")


# The real reconstruction


def centre(shot: dict[str, Any]) -> Float64:
    """Return where a shot was taken, by Rodrigues' formula."""
    vector = np.array(shot["rotation"])
    angle = np.linalg.norm(vector)
    x, y, z = vector / angle
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    rotation = np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k
    position: Float64 = -rotation.T @ np.array(shot["translation"])
    return position


def test_the_real_one_has_its_points_and_cameras(shared_data: Path) -> None:
    folder = shared_data / "sparse/opensfm_berlin"
    (document,) = json.loads((folder / "reconstruction.json").read_text())
    seen: dict[str, set[str]] = {}
    for row in (folder / "tracks.csv").read_text().splitlines()[1:]:
        seen.setdefault(row.split("\t")[1], set()).add(row.split("\t")[0])

    clouds = list(open_source(folder).clouds())

    assert [cloud.stamp for cloud in clouds] == [1401101762.384, 1401101771.489, 1401101790.953]
    for name, cloud in zip(["01.jpg", "02.jpg", "03.jpg"], clouds, strict=True):
        expected = [
            point["coordinates"]
            for number, point in document["points"].items()
            if min(seen[number] & document["shots"].keys()) == name
        ]
        assert cloud.points.tolist() == expected
        np.testing.assert_allclose(cloud.position, centre(document["shots"][name]), atol=1e-9)


def test_a_part_of_the_flight_can_be_read_by_time(shared_data: Path) -> None:
    recording = open_recording(shared_data / "sparse/opensfm_berlin", start=5, end=10)

    (keyframe,) = recording.keyframes()

    assert keyframe.stamp == 1401101771.489


# Faults


@pytest.mark.parametrize(
    ("document", "words"),
    [
        ([], "found an empty list, expected a reconstruction"),
        ([{"shots": {}}], "without points"),
        ([{"shots": [], "points": {}}], "without shots"),
        ([7], "without shots"),
        ("shots", "without shots"),
        ([{"shots": {}, "points": {"9": {}}}], "point 9: found {}, expected coordinates: three"),
        ([{"shots": {}, "points": {"9": None}}], "point 9: found None"),
        ([{"shots": {}, "points": {"9": {"coordinates": [1, 2]}}}], "point 9: .*three numbers"),
        ([{"shots": {}, "points": {"9": {"coordinates": [1, 2, "x"]}}}], "point 9: .*three numb"),
        ([{"shots": {}, "points": {"9": {"coordinates": [1, 2, 10**400]}}}], "point 9: .*three"),
    ],
)
def test_what_is_no_reconstruction_is_named(tmp_path: Path, document: Any, words: str) -> None:
    with pytest.raises(InputError, match=words) as error:
        list(OpenSfmReconstruction(write(tmp_path, document)).clouds())
    assert "reconstruction.json" in str(error.value)


def test_a_text_nested_without_end_is_refused(tmp_path: Path) -> None:
    path = write(tmp_path)
    path.write_text('[{"shots": ' + "[" * 200_000)

    with pytest.raises(InputError, match="no whole JSON"):
        list(OpenSfmReconstruction(path).clouds())


def test_of_a_cut_file_an_error_says_where(tmp_path: Path) -> None:
    path = write(tmp_path)
    for damaged in cut(path.read_bytes(), 60):
        path.write_bytes(damaged)
        assert read_damaged(path, OpenSfmReconstruction) is None


def test_tracks_that_are_cut_or_broken_are_told(tmp_path: Path) -> None:
    path = write(tmp_path)
    tracks = tmp_path / "tracks.csv"
    for damaged in cut(tracks.read_bytes(), 60):
        tracks.write_bytes(damaged)
        found = read_damaged(path, OpenSfmReconstruction)
        assert found is not None
        assert sorted(found[0][:, 0].tolist()) == [1, 2, 3, 4]
        row = damaged.rpartition(b"\n")[2]
        is_head = row.startswith(b"OPENSFM_TRACKS_VERSION")
        assert bool(found[1]) == (len(row) > 0 and row.count(b"\t") < 7 and not is_head)


def test_a_flipped_bit_is_an_error_or_wrong_numbers(tmp_path: Path) -> None:
    path = write(tmp_path)
    for damaged in flipped(path.read_bytes(), 300, 300):
        path.write_bytes(damaged)
        found = read_damaged(path, OpenSfmReconstruction)
        assert found is None or len(found[0]) <= 4
