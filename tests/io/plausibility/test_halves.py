"""Halves that were declared as whole numbers.

How these tests could be cheated: by taking all numbers of 16 bits for halves, or by looking at one
axis or one type only. So scenes are of both types and byte orders, with no returns among them, and
the millimetres of depth cameras and numbers over the whole range must pass.
"""

from __future__ import annotations

import numpy as np
import pytest

from mlscli.io.plausibility.halves import unveiled
from mlscli.runtime.arrays import Array, Float64, Int64

GENERATOR = np.random.default_rng(1)
ROOM = GENERATOR.uniform([-9, -4, 0.1], [9, 4, 3], (400, 3))


def declared(points: Float64, dtype: str) -> list[Array]:
    """Return halves as numbers of a type of 16 bits."""
    return [axis.astype(dtype[0] + "f2").view(dtype) for axis in points.T]


@pytest.mark.parametrize("dtype", ["<u2", "<i2", ">u2"])
@pytest.mark.parametrize("missing", [np.nan, 0.0])
def test_halves_of_a_room_are_found_and_read(dtype: str, missing: float) -> None:
    points = ROOM.copy()
    points[::3] = missing
    columns = declared(points, dtype)

    found = unveiled(columns)

    assert "hold halves" in found.note
    assert found.value is not None
    read = np.stack(found.value, axis=1)
    np.testing.assert_allclose(read.astype(float), points, rtol=1e-3)


def test_halves_without_signs_are_told_and_left() -> None:
    columns = declared(np.abs(ROOM), "<u2")

    found = unveiled(columns)

    assert found.value is columns
    assert "may be halves" in found.note


@pytest.mark.parametrize(
    "numbers",
    [
        GENERATOR.integers([0, 0, 400], [640, 480, 9000], (400, 3)),
        GENERATOR.integers(-9000, 9000, (400, 3)),
        GENERATOR.integers(0, 65536, (400, 3)),
        GENERATOR.integers([9000, 9000, 0], [20000, 20000, 8000], (400, 3)),
        np.zeros((400, 3)),
        np.full((9, 3), 9000),
    ],
)
@pytest.mark.parametrize("dtype", ["<u2", "<i2"])
def test_whole_numbers_are_left_without_a_word(numbers: Int64, dtype: str) -> None:
    columns = [axis.astype(np.int64).astype(dtype) for axis in numbers.T]

    assert unveiled(columns) == (columns, "", "")


def test_other_types_are_no_halves() -> None:
    columns = [axis.astype("<f4") for axis in ROOM.T]

    assert unveiled(columns) == (columns, "", "")
