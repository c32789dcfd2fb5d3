"""Recordings brought onto a map of another frame.

Ways to pass without being right: to move the points and not the craft; to move before z is turned
up; to forget with which transform the recording was read, so it is read again from the map's meta.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mlscli.errors import InputError, UsageError
from mlscli.geometry.similarity import Similarity
from mlscli.geometry.up import axes_matrix
from mlscli.io.reading.recording import open_recording
from mlscli.io.reading.transform import onto, read_transform, transform_of
from mlscli.maps.recorded import TURN

FIT = Similarity(0.5, 2.0, (1.0, -2.0, 3.0))
UP = {"from": np.block([[axes_matrix("-y"), np.zeros((3, 1))], [np.zeros((1, 3)), 1.0]]).tolist()}


def written(folder: Path, **more: Any) -> Path:
    path = folder / "onto.json"
    path.write_text(json.dumps({"transform": FIT.matrix.tolist(), "frame_id": "site", **more}))
    return path


def test_points_and_craft_are_moved_once_z_points_up(tmp_path: Path) -> None:
    cloud = tmp_path / "cloud.csv"
    cloud.write_text("x,y,z,cx,cy,cz\n1,2,3,4,5,6\n7,8,9,4,5,6\n")
    still = open_recording(cloud, up="-y")
    moved = open_recording(cloud, up="-y", transform=written(tmp_path, **UP))
    (one,), (other,) = still.keyframes(), moved.keyframes()
    assert np.array_equal(other.points, FIT.points(one.points))
    assert np.array_equal(other.position, FIT.points(np.array([one.position]))[0])
    assert moved.frame_id == "site"
    assert moved.map_from_recording.tolist() == np.eye(4).tolist()
    (again,) = open_recording(cloud, **moved.options).keyframes()
    assert np.array_equal(again.points, other.points)


def test_a_recording_that_is_turned_upright_otherwise_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"`transform`: .*turned upright in another way"):
        open_recording(np.ones((3, 3)), transform=written(tmp_path, **UP))


def test_the_crop_is_in_the_frame_that_the_transform_leads_to(tmp_path: Path) -> None:
    points = np.array([(0.0, 0.0, 0.0), (50.0, 0.0, 0.0)])
    crop = (0.0, 2.0, -3.0, 0.0, 2.0, 4.0)
    (kept,) = open_recording(points, transform=written(tmp_path), crop=crop).keyframes()
    assert kept.points.tolist() == [[1.0, -2.0, 3.0]]


def test_a_map_that_was_aligned_before_comes_the_whole_way() -> None:
    first = onto(FIT, {}, "site", {})
    second = onto(FIT, {}, "town", {"reading": {"transform": first.to_dict()}})
    points = np.array([(1.0, 2.0, 3.0)])
    assert np.allclose(second.fit.points(points), FIT.points(FIT.points(points)))
    assert second.frame_id == "town"


def test_the_turn_of_the_map_that_it_leads_to_is_kept() -> None:
    turn = {TURN: UP["from"]}
    assert read_transform(onto(FIT, turn, "site", {}).to_dict()).turn.tolist() == UP["from"]
    assert transform_of({"reading": {"up": "y"}}) is None


@pytest.mark.parametrize(
    ("held", "fault"),
    [
        ("{", "is no JSON"),
        ("[" * 100_000, "is no JSON"),
        ("[]", "has no key transform"),
        ('{"yaw": 1}', "has no key transform"),
        ('{"transform": [[1, 0], [0, 1]]}', "must be a turn about z"),
        ('{"transform": "x"}', "must be a turn about z"),
        (json.dumps({"transform": np.diag((1, 1, -1, 1)).tolist()}), "must be a turn about z"),
        (json.dumps({"transform": np.eye(4).tolist(), "frame_id": 3}), "frame_id holds 3"),
        (json.dumps({"transform": np.eye(4).tolist(), "from": 3}), "must be a rotation"),
    ],
)
def test_a_file_that_holds_no_transform_is_refused(tmp_path: Path, held: str, fault: str) -> None:
    path = tmp_path / "onto.json"
    path.write_text(held)
    with pytest.raises(InputError, match=fault):
        open_recording(np.ones((3, 3)), transform=path)


def test_a_file_that_is_missing_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"onto\.json: cannot be read: No such file"):
        open_recording(np.ones((3, 3)), transform=tmp_path / "onto.json")


def test_a_file_that_is_none_is_refused_without_waiting(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "onto.json")
    with pytest.raises(InputError, match=r"onto\.json: is a FIFO"):
        open_recording(np.ones((3, 3)), transform=tmp_path / "onto.json")


def test_a_recording_comes_to_lie_where_the_other_map_does_on_earth(tmp_path: Path) -> None:
    place = {"crs": "EPSG:32632", "offset": [5.0, 6.0, 7.0], "source": "a test"}
    own = {"georeference": place | {"crs": "EPSG:2056"}}
    transform = onto(FIT, {"georeference": place}, "site", own).to_dict()
    cloud = tmp_path / "cloud.csv"
    cloud.write_text("x,y,z\n1,2,3\n7,8,9\n")
    moved = open_recording(cloud, transform=transform)
    assert moved.georeference == ("EPSG:32632", (5.0, 6.0, 7.0), "a test")
    # It is read again from the map's meta. Of a map that lies nowhere, that of its own is not it.
    assert open_recording(cloud, **moved.options).georeference == moved.georeference
    local = onto(FIT, {}, "site", own).to_dict()
    assert open_recording(cloud, transform=local).georeference is None
    with pytest.raises(InputError, match=r"georeference holds .* it must be an object of crs"):
        read_transform(transform | {"georeference": {"crs": "here"}})
