"""Real clouds of one place are aligned as they lie, or refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mlscli.aligning.fit import align_maps
from mlscli.building.build import build_map
from mlscli.errors import InputError
from mlscli.geometry.similarity import Similarity
from mlscli.io.reading.recording import open_recording
from mlscli.runtime.arrays import Float64
from tests.helpers.yards import map_of_points, off


def points_of(path: Path, up: str = "z") -> Float64:
    (keyframe,) = open_recording(path, up=up).keyframes()
    return keyframe.points


def test_two_scans_of_an_office_lie_as_their_registration_says(shared_data: Path) -> None:
    # An office 20 m wide and 3 m high: coarse voxels cannot tell one of its rooms from another.
    first, second, registered = (
        points_of(shared_data / f"multilevel/unitree_ISR_scan_{name}.xyz")
        for name in ("01_raw", "02_raw", "02_registered")
    )
    found = align_maps(map_of_points(first, 0.25), map_of_points(second, 0.25), 1.0)
    away = np.linalg.norm(found.fit.points(second) - registered, axis=1)
    assert np.median(away) < 0.25


def test_a_cluttered_room_is_not_laid_into_a_larger_one(shared_data: Path) -> None:
    # Enlarged to twice its size, one half of a room that a drone saw lies well in the other.
    points = points_of(shared_data / "sparse/tello_kf_pointData.csv", "-y")
    ends = np.quantile(points[:, 0], (0.3, 0.7))
    chance = np.random.default_rng(9).random(len(points)) < 0.5
    moved = Similarity(-1.1, 1.7, (20.0, -8.0, 3.0))
    one = build_map(points[chance & (points[:, 0] <= ends[1])])
    other = points[~chance & (points[:, 0] >= ends[0])]
    try:
        found = align_maps(one, build_map(moved.points(other)))
    except InputError as error:
        assert "fit" in str(error)  # noqa: PT017
    else:
        assert off(found.fit, moved.inverse, moved.points(other)) < 3 * one.cell_size
