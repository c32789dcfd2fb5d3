"""Longitudes and latitudes, told from lengths.

How these tests could be cheated: by whatever is small. So there are poles, models in kilometres and
rooms in metres, which are lengths.
"""

from __future__ import annotations

import numpy as np
import pytest

from mlscli.io.plausibility.degrees import are_lengths
from mlscli.io.plausibility.finding import right


@pytest.mark.parametrize(
    ("low", "high"),
    [
        ((8.54321, 47.37654, 410), (8.54328, 47.37659, 413)),
        ((47.37654, 8.54321, 410), (47.37659, 8.54328, 413)),
        ((-122.41, 37.77, 3), (-122.40, 37.78, 60)),
        ((151.2, -33.86, 10), (151.21, -33.85, 40)),
    ],
)
def test_a_scene_far_higher_than_wide_at_a_place_on_the_earth_is_in_degrees(
    low: tuple[float, ...], high: tuple[float, ...]
) -> None:
    found = are_lengths(np.array(low), np.array(high))

    assert "as longitude and latitude do" in found.note


@pytest.mark.parametrize(
    ("low", "high"),
    [
        ((0, 0, 0), (10, 6, 3)),
        ((-0.02, -0.02, 0), (0.02, 0.02, 6)),  # a pole at the origin
        ((8.0, 47.0, 0), (8.3, 47.2, 12)),  # a wall's end in a large frame
        ((8.0, 47.0, 0), (8.01, 47.01, 0.02)),  # small
        ((465_000, 5_247_000, 400), (465_000.01, 5_247_000.01, 403)),
        ((8, 47, 1), (8, 47, 3)),  # all above one another
    ],
)
def test_other_scenes_are_in_lengths(low: tuple[float, ...], high: tuple[float, ...]) -> None:
    assert are_lengths(np.array(low), np.array(high)).note == ""


def test_coordinates_as_large_as_numbers_are_lengths() -> None:
    assert are_lengths(np.full(3, -1.7e308), np.full(3, 1.7e308)) == right(True)
