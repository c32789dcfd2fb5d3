"""Keyframes chosen by time and number.

How these tests could be cheated: by bounds that are right inside and off by one at their ends,
by choosing every N-th before the times, or by a second pass that goes on where the first ended.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mlscli.errors import UsageError
from mlscli.io.reading.recording import open_recording
from tests.helpers.bags import Sent, write_bag
from tests.helpers.keyframes import xs
from tests.helpers.texts import text


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"start": 1.0}, [2, 3, 4, 5]),
        ({"end": 1.0}, [0, 1, 2]),
        ({"start": 0.5, "end": 1.5}, [1, 2, 3]),
        ({"every": 2}, [0, 2, 4]),
        ({"start": 0.5, "every": 2}, [1, 3, 5]),
        ({"every": 99}, [0]),
    ],
)
def test_keyframes_are_chosen_by_time_and_number(
    timed: Path, options: dict[str, Any], expected: list[int]
) -> None:
    recording = open_recording(timed, **options)

    assert xs(recording) == expected
    assert xs(recording) == expected
    assert recording.tally.points_read == recording.tally.keyframes == len(expected)


def test_times_from_the_epoch_are_told_by_their_size(tmp_path: Path) -> None:
    clouds = [
        Sent(np.full((1, 3), float(k)), nanoseconds=(1_600_000_000 + k) * 10**9) for k in range(5)
    ]
    bag = write_bag(tmp_path / "a.bag", clouds)

    assert xs(open_recording(bag, start=1_600_000_001.0, end=1_600_000_003.0)) == [1, 2, 3]
    assert xs(open_recording(bag, start=3.0)) == [3, 4]
    assert xs(open_recording(bag, start=1_600_000_001.0, end=2.0)) == [1, 2]


def test_the_beginning_is_that_of_the_whole_flight(timed: Path, tmp_path: Path) -> None:
    later = text(tmp_path, "x,y,z,t\n9,0,0,103\n", "later.txt")

    assert xs(open_recording(timed, later, start=2.5)) == [5, 9]


def test_keyframes_to_expect_are_those_that_come(timed: Path) -> None:
    assert open_recording(timed, timed).expected_keyframes == 12
    assert open_recording(timed, every=4).expected_keyframes == 2
    assert open_recording(timed, start=1.0).expected_keyframes is None


def test_times_without_time_stamps_are_wrong_usage(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no time stamps"):
        xs(open_recording(text(tmp_path, "1 2 3\n"), start=1.0))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"up": "w"}, "`up` w: expected one of z, -z, y, -y, x, -x, auto"),
        ({"every": 0}, "`every` 0"),
        ({"start": 2.0, "end": 1.0}, "`start` 2.0 is after `end` 1.0"),
        ({"start": math.nan}, "`start` nan"),
        ({"crop": (0, 1, 0, 1, 2, 1)}, "zmin 2 is above zmax 1"),
        ({"crop": (0, 1, 0, 1)}, "expected six numbers"),
        ({"crop": (0, 1, 0, 1, 0, math.nan)}, "expected six numbers"),
        ({"frame": "/"}, "`frame`"),
    ],
)
def test_wrong_options_are_told_before_anything_is_read(
    options: dict[str, Any], words: str
) -> None:
    with pytest.raises(UsageError, match=words):
        open_recording("/no/such/file", **options)


def test_no_source_is_wrong_usage() -> None:
    with pytest.raises(UsageError, match="no source"):
        open_recording()
