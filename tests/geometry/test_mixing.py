"""Many rows have the hashes that each has alone, and those that splitmix64 says.

How one could cheat: one hash for many rows and another for few; a hash that no other program has.
"""

from __future__ import annotations

import numpy as np

from mlscli.geometry.surroundings import hashed


def test_rows_have_the_same_hash_alone_and_among_many() -> None:
    points = np.random.default_rng(1).normal(size=(5_000, 3))
    points[::7, 1], points[1::7, 2] = 0.0, -0.0
    alone = np.concatenate([hashed(row[None].T) for row in points[:500]])
    np.testing.assert_array_equal(hashed(points.T)[:500], alone)
    np.testing.assert_array_equal(hashed((points + 0.0).T)[:500], alone)
    assert len(np.unique(alone)) == 500


def test_the_hash_of_zero_is_the_first_number_of_splitmix64_from_seed_0() -> None:
    assert hashed([np.zeros(1)]).tolist() == [0xE220A8397B1DCDAF]
    assert hashed([np.zeros(4096)]).tolist()[-1] == 0xE220A8397B1DCDAF
