"""The way back from the frame of a map to that of its recording.

How these tests could be cheated: by a turn that is its own inverse, or without a shift.
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mlscli.errors import InputError
from mlscli.maps.recorded import TURN, as_recorded, turn_of

WHOLE = np.eye(4)
WHOLE[:3, :3] = Rotation.from_euler("xyz", [100, 20, -50], degrees=True).as_matrix()
WHOLE[:3, 3] = (-513_000.25, 5_403_000.5, 300)


def test_points_come_back_from_where_the_turn_took_them() -> None:
    meta = json.loads(json.dumps({TURN: WHOLE.tolist()}))
    recorded = np.random.default_rng(1).normal(size=(100, 3)) * 50 + (5000, -800, 20)
    mapped = recorded @ WHOLE[:3, :3].T + WHOLE[:3, 3]

    assert turn_of(meta).tolist() == WHOLE.tolist()
    assert np.abs(mapped - recorded).max() > 1000
    np.testing.assert_allclose(as_recorded(mapped, meta), recorded, atol=1e-8)


def test_a_map_that_says_nothing_was_not_turned() -> None:
    points = np.array([[1.0, -2.0, 3.0]])

    assert turn_of({}).tolist() == np.eye(4).tolist()
    assert as_recorded(points, {}).tobytes() == points.tobytes()


def changed(row: int, column: int, value: float) -> list[list[float]]:
    turn = WHOLE.copy()
    turn[row, column] = value
    return [[float(number) for number in line] for line in turn]


@pytest.mark.parametrize(
    "held",
    [
        None, 5, "turned", {}, [], [[1, 0, 0]], WHOLE[:3].tolist(), [WHOLE.tolist()],
        [["a", 0, 0, 0], *WHOLE[1:].tolist()], [[1, 0], *WHOLE[1:].tolist()],
        changed(0, 0, 2.0), changed(1, 1, float("nan")), changed(0, 3, float("inf")),
        changed(3, 0, 1.0), changed(3, 3, 2.0),
        # A mirror image is no turn.
        (np.diag([1.0, 1.0, -1.0, 1.0])).tolist(),
    ],
)  # fmt: skip
def test_what_is_no_turn_is_an_error_that_says_what_was_found(held: Any) -> None:
    for call in (turn_of, lambda meta: as_recorded(np.zeros((1, 3)), meta)):
        with pytest.raises(InputError, match=r"meta: map_from_recording holds .*; it must be") as e:
            call({TURN: held})
        assert "\n" not in str(e.value)
