"""Scans of a planar laser.

How these tests could be cheated: by taking angles from the last beam backwards or from
angle_max, or by dropping beams so that indices no longer tell the angle.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from mlscli.io.messages.decoding import Deserializer
from mlscli.io.messages.registry import CLOUD_TYPES, CloudPart
from tests.helpers.ros import ENCODINGS, header, serialized

SCAN = "sensor_msgs/msg/LaserScan"


def decode(encoding: str, **changes: Any) -> CloudPart:
    content = {
        "header": header(2, 250_000_000, "laser"),
        "angle_min": 0.0,
        # A wrong last angle changes nothing.
        "angle_max": 77.0,
        "angle_increment": 0.5,
        "range_min": 1.0,
        "range_max": 8.0,
        **changes,
    }
    (part,) = CLOUD_TYPES[SCAN](Deserializer().read(serialized(encoding, SCAN, content)))
    return part


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_beams_become_points_by_their_index(encoding: str) -> None:
    part = decode(encoding, ranges=[2, 4, 3])

    expected = [[r * math.cos(a), r * math.sin(a), 0] for r, a in [(2, 0), (4, 0.5), (3, 1)]]
    np.testing.assert_allclose(part.points, expected, rtol=1e-15)
    assert part.points.dtype == np.float64
    assert (part.frame_id, part.stamp) == ("laser", 2.25)
    assert part.is_ranged


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_angles_are_computed_in_float64_from_the_recorded_ones(encoding: str) -> None:
    increment = float(np.float32(0.00436))
    part = decode(encoding, angle_min=-1.5, angle_increment=0.00436, ranges=[5.0] * 700)

    angle = -1.5 + 699 * increment
    np.testing.assert_allclose(
        part.points[699], [5 * math.cos(angle), 5 * math.sin(angle), 0], rtol=1e-14
    )


def test_each_scan_goes_by_its_own_angles() -> None:
    scans = [
        decode("cdr", angle_min=low, angle_increment=step, ranges=[2.0] * count).points
        for low, step, count in [(0, 0.5, 3), (0.1, 0.5, 3), (0, 0.25, 3), (0, 0.5, 4), (0, 0.5, 3)]
    ]

    angles = [np.arctan2(points[:, 1], points[:, 0]).round(6).tolist() for points in scans]
    assert angles == [[0, 0.5, 1], [0.1, 0.6, 1.1], [0, 0.25, 0.5], [0, 0.5, 1, 1.5], [0, 0.5, 1]]


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_beams_that_hit_nothing_are_no_numbers_and_keep_their_place(encoding: str) -> None:
    ranges = [0.99, 1.0, 8.0, 8.01, math.inf, -math.inf, math.nan, 0.0, 2.0]

    points = decode(encoding, ranges=ranges).points

    missing = [0, 3, 4, 5, 6, 7]
    assert np.isnan(points[missing]).all()
    np.testing.assert_allclose(np.hypot(*points[[1, 2, 8], :2].T), [1, 8, 2])


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_an_infinite_range_is_none_whatever_the_limit(encoding: str) -> None:
    points = decode(encoding, ranges=[math.inf, 3], range_max=math.inf).points

    assert np.isnan(points[0]).all()
    assert points[1, 0] == 3 * math.cos(0.5)


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_a_scan_without_beams_is_an_empty_cloud(encoding: str) -> None:
    assert decode(encoding).points.shape == (0, 3)


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_angles_that_contradict_each_other_are_told(encoding: str) -> None:
    told = decode(encoding, angle_max=77.0, ranges=[2, 4, 3])
    untold = decode(encoding, angle_max=1.0, ranges=[2, 4, 3])

    assert told.points.tolist() == untold.points.tolist()
    assert [bool(part.doubts) for part in (told, untold)] == [True, False]
