"""Similarities that keep z up.

Ways to pass without being right: an inverse that undoes the matrix alone and not the points.
"""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from mlscli.geometry.similarity import Similarity

SIMILARITIES = st.builds(
    Similarity, st.floats(-9, 9), st.floats(0.01, 100), st.tuples(*[st.floats(-1e3, 1e3)] * 3)
)


@given(SIMILARITIES)
def test_the_inverse_takes_points_back_and_the_matrix_tells_all(similarity: Similarity) -> None:
    points = np.array([(1.0, 2.0, 3.0), (-4.0, 0.5, -6.0)])
    moved = similarity.points(points)
    assert np.allclose(similarity.inverse.points(moved), points, atol=1e-6)
    homogeneous = np.column_stack((points, np.ones(2)))
    assert np.allclose(homogeneous @ similarity.matrix.T, np.column_stack((moved, np.ones(2))))
    again = Similarity.of(similarity.matrix)
    assert again is not None
    assert np.allclose(again.points(points), moved)


def test_a_matrix_that_tilts_shears_mirrors_or_is_none_is_no_similarity() -> None:
    tilt, shear, mirror, flat = np.eye(4), np.eye(4), np.eye(4), np.diag((1.0, 1.0, 0.0, 1.0))
    tilt[1:3, 1:3] = np.array([(0.8, -0.6), (0.6, 0.8)])
    shear[0, 1] = 0.1
    mirror[0, 0] = -1
    nan = np.full((4, 4), np.nan)
    for matrix in (tilt, shear, mirror, flat, nan, np.eye(3), np.empty(0)):
        assert Similarity.of(matrix) is None
